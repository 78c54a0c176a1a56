"""How a new clip's unknowns are dealt with in forecasts of the six-clip study.

The multifactor study forecasts eight test clips by fits to six clips (`studies.multifactor`).
Nearly all of the error is the pace of the new clip. Tried here, with the model's other defaults:
unknowns at their modes or averaged over, contexts that count for fewer outputs than they have
(`Multifactor.context_weight`), and speeds that wander (`Circle.wander_sd`). Training people are
left out in turn, and the highest log score chooses; the test clips are forecast by all variants,
and have no part in the choice.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from ...fit import Fit
from ...inference.optimisation.map import fit_map
from ...models.multifactor import Circle, Multifactor
from ...motion import concat, split
from ...prediction import score
from ...programs import forget_programs
from ...tasks.forecast import angles_of, forecast
from ..boards.harness import Board
from ..boards.scoring import baseline
from ..fits import multifactor_of
from ..multifactor.left_out import lengths_of
from ..multifactor.study import LONG, MAX_STEPS, TRAINING, read_clips, training_motion
from ..posterior.new_people import no_larger
from ..stages import Say, Stages

# Settings that the training does not depend on.
VIEWS: dict[str, dict[str, Any]] = {
    "at the mode": {"unknown_draws": 0, "context_weight": 1.0},
    "averaged": {"unknown_draws": 32, "context_weight": 1.0},
    **{
        f"averaged, contexts count {weight:g}": {"unknown_draws": 32, "context_weight": weight}
        for weight in (0.3, 0.1, 0.05)
    },
    "averaged, speed wanders": {"unknown_draws": 32, "context_weight": 1.0, "wander_sd": 0.1},
}

# What a model has to beat (`studies.boards`), each told by the training clips' angles alone.
SIMPLE = ("hold", "nearest", "ridge", "autoregression", "cycle", "mixed", "mixed smoothly")

Rows = dict[str, dict[str, dict[str, float]]]


def reproduce(data: Path | None, out: Path, say: Say = print, seed: int = 0) -> dict[str, Any]:
    """Choose on training people left out, forecast the test clips, write ``pace.json``.

    Parameters
    ----------
    data
        Folder that holds ``cmu/``; where None as in `bayesmotion.motion.datasets.public.cmu`.
    out
        Folder for the results.
    say
        Called with a line after every stage.
    seed
        Of the initial values, and of draws.
    """
    stages = Stages(out / "pace.json", plan(seed), say)
    motion, clips = training_motion(data), read_clips(list(LONG), data)
    stages.read(training=motion, **clips)
    stages.do("left_out", work=partial(left_out, motion, seed))
    stages.do("chosen", work=lambda: choose(stages.result["left_out"]))
    stages.do("test", work=partial(tested, motion, clips, seed))
    return stages.result


def plan(seed: int = 0) -> dict[str, Any]:
    """The settings of the study."""
    return {
        "training": list(TRAINING),
        "test": {clip: list(frames) for clip, frames in LONG.items()},
        "views": VIEWS,
        "simple": list(SIMPLE),
        "max_steps": MAX_STEPS,
        "seed": seed,
    }


def left_out(motion: xr.Dataset, seed: int) -> Rows:
    """Return scores {view: {clip: ...}} of every person's clips, by fits to the others."""
    parts = split(motion)
    subject = {clip: str(part["subject"].values[0]) for clip, part in parts.items()}
    found: Rows = {}
    for left in dict.fromkeys(subject.values()):
        forget_programs()
        others = concat([part for clip, part in parts.items() if subject[clip] != left])
        fit = _train(others, seed)
        own = {clip: part for clip, part in parts.items() if subject[clip] == left}
        for view, rows in scored(fit, own, {c: lengths_of(p) for c, p in own.items()}).items():
            found.setdefault(view, {}).update(rows)
    return found


def tested(motion: xr.Dataset, clips: Mapping[str, xr.Dataset], seed: int) -> Rows:
    """Return scores {view: {clip: ...}} of the test clips by the fit to all training clips."""
    forget_programs()
    return scored(_train(motion, seed), clips, LONG)


def scored(
    fit: Fit, clips: Mapping[str, xr.Dataset], lengths: Mapping[str, tuple[int, int]]
) -> Rows:
    """Return the scores of forecasts of clips by a fit, seen by every view."""
    found: Rows = {}
    for view, settings in VIEWS.items():
        seen = replace(fit, model=seen_by(multifactor_of(fit)[0], settings))
        found[view] = {c: _scores(seen, part, *lengths[c]) for c, part in clips.items()}
    return found | simple(fit, clips, lengths)


def seen_by(model: Multifactor, settings: Mapping[str, Any]) -> Multifactor:
    """Return a model that sees new clips by the settings of a view."""
    own = {name: value for name, value in settings.items() if name != "wander_sd"}
    return replace(model, content=Circle(wander_sd=settings.get("wander_sd", 0.0)), **own)


def simple(
    fit: Fit, clips: Mapping[str, xr.Dataset], lengths: Mapping[str, tuple[int, int]]
) -> Rows:
    """Return the scores of simple forecasts of the angles, told by the clips that a fit saw."""
    whole = {c: angles_of(fit, p, p.sizes["frame"])[0] for c, p in split(fit.motion).items()}
    rate = float(fit.motion.attrs["frame_rate"])
    found: Rows = {name: {} for name in SIMPLE}
    for clip, part in clips.items():
        context, horizon = lengths[clip]
        true = angles_of(fit, part.isel(frame=slice(context + horizon)), context)[0]
        board = Board("six clips", whole, {clip: true}, context, rate, "radians")
        for name in SIMPLE:
            told = baseline(board, name)(true[:context].copy(), horizon)
            found[name][clip] = score(told, true[context:]).figures()
    return found


def choose(found: Rows) -> str:
    """Return the view of the highest mean log score over the clips left out."""
    return max(VIEWS, key=lambda view: np.mean([c["log_score"] for c in found[view].values()]))


def _train(motion: xr.Dataset, seed: int) -> Fit:
    model = no_larger(Multifactor(), motion)
    return fit_map(model, motion, seed=seed, keep=1, max_steps=MAX_STEPS)


def _scores(fit: Fit, clip: xr.Dataset, context: int, horizon: int) -> dict[str, float]:
    predicted = forecast(fit, clip, context=context, horizon=horizon)
    true, columns = angles_of(fit, clip.isel(frame=slice(context + horizon)), context)
    return score(predicted.mixture.part(slice(context, None), columns), true[context:]).figures()
