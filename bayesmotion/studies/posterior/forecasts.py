"""Forecasts of the multifactor study's test clips as distributions, kept and scored."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from ...files import replacing
from ...fit import Fit
from ...prediction import Mixture, score
from ...tasks.forecast import angles_of, forecast
from ..fits import multifactor_of
from ..multifactor.study import LONG
from .averaged import forecast_posterior

FIGURES = {
    "mean_error": "error",
    "crps": "crps",
    "log_score": "log_score",
    "coverage90": "coverage90",
}


def at_mode(fit: Fit, clip: str, motion: xr.Dataset) -> Mixture:
    """Forecast a test clip's angles at the highest mode alone."""
    context, horizon = LONG[clip]
    found = forecast(fit, motion, context=context, horizon=horizon)
    mixture = found.mixture
    # A t process is a mixture of normals of each mode.
    parts = len(mixture.weight) // len(found.prediction.weight)
    mode = Mixture(mixture.mean[:parts], mixture.sd[:parts], np.full(parts, 1.0 / parts))
    return _ahead(mode, fit, context)


def averaged(fit: Fit, clip: str, motion: xr.Dataset, seed: int) -> Mixture:
    """Forecast a test clip's angles, averaged over the posterior."""
    context, horizon = LONG[clip]
    found = forecast_posterior(fit, motion, context=context, horizon=horizon, seed=seed)
    return _ahead(found.mixture, fit, context)


def kept(path: Path, make: Callable[[], Mixture]) -> Mixture:
    """Read a forecast that is there, else make it and keep it."""
    if path.is_file():
        with np.load(path) as arrays:
            return Mixture(arrays["mean"], arrays["sd"], arrays["weight"])
    found = make()
    with replacing(path) as temporary:
        np.savez(temporary, mean=found.mean, sd=found.sd, weight=found.weight)
    return found


def scores(mixture: Mixture, fit: Fit, clip: str, motion: xr.Dataset) -> dict[str, float]:
    """Score a forecast of a test clip's angles."""
    context, horizon = LONG[clip]
    true, _ = angles_of(fit, motion.isel(frame=slice(context + horizon)), context)
    return score(mixture, true[context:]).figures()


def means(per_clip: Mapping[str, Mapping[str, Mapping[str, float]]]) -> dict[str, Any]:
    """Average {clip: {kind: scores}} over the clips: {figure: {kind: mean}}."""
    clips = list(per_clip.values())
    return {
        figure: {kind: float(np.mean([clip[kind][field] for clip in clips])) for kind in clips[0]}
        for figure, field in FIGURES.items()
    }


def _ahead(mixture: Mixture, fit: Fit, context: int) -> Mixture:
    return mixture.part(slice(context, None), multifactor_of(fit)[1].angles)
