"""The multifactor model on a board of channels: every training clip is a take with its own style.

The content is a circle whose pace is learned, and the one style factor is ``take``, whose levels
are the clips: a clip to forecast is a take that nobody knows. It is fitted and forecast by the
public verbs.
"""

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ...errors import MotionWarning
from ...fit import Fit
from ...inference.methods import MAP, fit
from ...models.multifactor import Circle, Factor, Multifactor
from ...prediction import Mixture
from ...programs import forget_programs
from ...tasks.forecast import forecast
from ..fits import multifactor_of
from .channels import channel_motion
from .harness import Board, Clips, Method, clip_scores

FACTOR = "take"


class View(NamedTuple):
    """How new takes are seen by a fit: settings that the fit itself does not depend on.

    new_levels, novel_dims
        Of `Factor`.
    wander_sd
        Of `Circle`.
    context_weight
        Of `Multifactor`.
    """

    new_levels: str = "population"
    novel_dims: int = 0
    wander_sd: float = 0.0
    context_weight: float = 1.0


def take_model(size: int, view: View) -> Multifactor:
    """Return the model with style vectors of a size."""
    return seen_by(Multifactor(factors=(Factor(FACTOR, size),), align_heading=False,
                               lengths="file"), view)  # fmt: skip


def seen_by(model: Multifactor, view: View) -> Multifactor:
    """Return a model that sees new takes by a view."""
    changed: dict[str, Any] = {"new_levels": view.new_levels, "novel_dims": view.novel_dims}
    factors = tuple(replace(factor, **changed) for factor in model.style_factors)
    content = Circle("learned", view.wander_sd)
    return replace(model, factors=factors, content=content, context_weight=view.context_weight)


def train(clips: Clips, frame_rate: float, model: Multifactor, max_steps: int, seed: int) -> Fit:
    """Fit the model to training clips by its mode."""
    labels = {name: {FACTOR: name} for name in clips}
    motion = channel_motion(clips, frame_rate, labels)
    with warnings.catch_warnings():
        # Whether it has converged stands in the results.
        warnings.simplefilter("ignore", MotionWarning)
        method = MAP(initial=2, keep=1, max_steps=max_steps)
        return fit(model, motion, method=method, seed=seed)


def method_of(found: Fit, frame_rate: float, view: View | None = None) -> Method:
    """Return the forecast of a fit, in degrees, as boards ask for it."""
    if view is not None:
        model, _ = multifactor_of(found)
        found = replace(found, model=seen_by(model, view))

    def method(context: np.ndarray, horizon: int) -> Mixture:
        clip = channel_motion({"clip": context}, frame_rate)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MotionWarning)
            told = forecast(found, clip, context=len(context), horizon=horizon)
        labels = list(told.prediction.data.observed()["feature"].values)
        columns = np.array([labels.index(f"c{i:02d}/rx") for i in range(context.shape[1])])
        ahead = told.mixture.part(slice(len(context), None), columns)
        return ahead.rescaled(np.zeros(len(columns)), np.full(len(columns), 180.0 / np.pi))

    return method


def folds_of(clips: Clips, count: int) -> Iterator[tuple[Clips, Clips]]:
    """Give training clips and those left out together: every `count`-th, so that all are once."""
    names = list(clips)
    for first in range(count):
        left = names[first::count]
        yield {n: c for n, c in clips.items() if n not in left}, {n: clips[n] for n in left}


def left_out(
    board: Board,
    size: int,
    views: Mapping[str, View],
    *,
    folds: int,
    max_steps: int,
    seed: int,
    say: Any = print,
) -> dict[str, dict[str, dict[str, float]]]:
    """Return scores {view: {clip: ...}} of training clips, by fits to the clips of other folds."""
    found: dict[str, dict[str, dict[str, float]]] = {name: {} for name in views}
    for others, left in folds_of(board.train, folds):
        forget_programs()
        apart = replace(board, train=others, test=left)
        one = train(others, board.frame_rate, take_model(size, View()), max_steps, seed)
        for name, view in views.items():
            method = method_of(one, board.frame_rate, view)
            for clip, y in left.items():
                told = method(y[: board.context].copy(), apart.horizon(clip))
                found[name][clip] = clip_scores(apart, clip, told)
        say(f"{', '.join(left)} left out: "
            + ", ".join(f"{name} {np.mean([each[c]['mse'] for c in left]):.2f}"
                        for name, each in found.items()))  # fmt: skip
    return found
