"""Forecasts of the multifactor study's test clips as distributions, kept and scored."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from ..files import replacing
from ..fit import Fit
from ..prediction import Mixture, score
from ..tasks.forecast import forecast, truth
from ..tasks.posterior_forecast import forecast_posterior
from .multifactor import LONG

FIGURES = {
    "mean_error": "error",
    "crps": "crps",
    "log_score": "log_score",
    "coverage90": "coverage90",
}


def at_mode(fit: Fit, clip: str, motion: xr.Dataset) -> Mixture:
    """Forecast a test clip's angles at the highest mode alone, a mixture of one."""
    given, horizon = LONG[clip]
    mode = forecast(fit, motion, given=given, horizon=horizon)
    whole = Mixture(mode.mixture.mean[:1], mode.mixture.sd[:1], np.ones(1))
    return _ahead(whole, fit, given)


def averaged(fit: Fit, clip: str, motion: xr.Dataset, seed: int) -> Mixture:
    """Forecast a test clip's angles, averaged over the posterior."""
    given, horizon = LONG[clip]
    found = forecast_posterior(fit, motion, given=given, horizon=horizon, seed=seed)
    return _ahead(found.mixture, fit, given)


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
    given, horizon = LONG[clip]
    true = truth(fit, motion, given, horizon)
    assert true is not None, "the study's clips go on long enough"
    return score(mixture, true[:, : mixture.mean.shape[2]]).figures()


def means(per_clip: Mapping[str, Mapping[str, Mapping[str, float]]]) -> dict[str, Any]:
    """Average {clip: {kind: scores}} over the clips: {figure: {kind: mean}}."""
    clips = list(per_clip.values())
    return {
        figure: {kind: float(np.mean([clip[kind][field] for clip in clips])) for kind in clips[0]}
        for figure, field in FIGURES.items()
    }


def _ahead(mixture: Mixture, fit: Fit, given: int) -> Mixture:
    return mixture.part(slice(given, None), slice(fit.training.encoding.n_angles))
