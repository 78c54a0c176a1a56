"""Settings that training clips must choose: forecasts of a subject that training left out.

Test clips are mostly of subjects that nobody trained on. So each training subject's
clips are left out in turn, the model is fitted to the others, and the clips left out
are forecast as test clips are. No test clip has a part in it.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from ...fit import Fit
from ...motion import concat, split
from ...programs import forget_programs
from ...tasks.forecast import forecast
from ...tasks.forecast_scores import ForecastScores, forecast_scores

# Frames of context and predicted: those of the long prediction, and for short clips (runs)
# those that the paper has for its short ones.
LENGTHS = ((25, 40), (13, 20))

Train = Callable[[str, xr.Dataset], Fit]


def leave_subjects_out(models: tuple[str, ...], motion: xr.Dataset, train: Train) -> dict[str, Any]:
    """Forecast the clips of every subject by fits to the others.

    Parameters
    ----------
    models
        Names of the study's models.
    motion
        The training clips.
    train
        Fits a model, by name, to clips.

    Returns
    -------
    ``error`` and ``coverage90``, {clip: {model: ...}}, and ``means``, {model: mean error}.
    """
    parts = split(motion)
    subject = {clip: str(part["subject"].values[0]) for clip, part in parts.items()}
    scores: dict[str, dict[str, ForecastScores]] = {clip: {} for clip in parts}
    for left in dict.fromkeys(subject.values()):
        # Fits to fewer frames compile anew.
        forget_programs()
        others = concat([part for clip, part in parts.items() if subject[clip] != left])
        for name in models:
            fit = train(name, others)
            for clip in parts:
                if subject[clip] == left:
                    scores[clip][name] = _score(fit, parts[clip])
    return {
        "error": {c: {n: s.error for n, s in row.items()} for c, row in scores.items()},
        "coverage90": {c: {n: s.coverage90 for n, s in row.items()} for c, row in scores.items()},
        "means": {
            name: float(np.mean([row[name].error for row in scores.values()])) for name in models
        },
    }


def choose(found: Mapping[str, Any]) -> str:
    """Name the model of the smallest mean error."""
    return min(found["means"], key=found["means"].__getitem__)


def lengths_of(clip: xr.Dataset) -> tuple[int, int]:
    """Return the numbers of frames of context and predicted that a clip has room for."""
    return next(pair for pair in LENGTHS if sum(pair) <= clip.sizes["frame"])


def _score(fit: Fit, clip: xr.Dataset) -> ForecastScores:
    context, horizon = lengths_of(clip)
    found = forecast_scores(fit, clip, forecast(fit, clip, context=context, horizon=horizon))
    assert found is not None, "the lengths are those the clip has room for"
    return found
