"""How good a forecast is: its error beside three plain ones, and how often its band holds."""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.figure import Figure

from ..fit import Fit
from ..motion.joining import split
from ..plots import forecast_plot
from .baselines import constant_velocity, hold, nearest
from .forecast import Forecast, angle_error, truth
from .posterior_forecast import PosteriorForecast

LEVEL = 0.9
SHOWN = 6


@dataclass(frozen=True)
class Report:
    """A forecast held against what happened.

    error
        Mean over the predicted frames of the norm over the angular features, in radians.
    per_frame
        (horizon,) the same frame by frame.
    baselines
        Mean errors of three plain forecasts: hold, constant_velocity, nearest.
    coverage90
        Share of the angular features that lie in the forecast's 90 % interval.
    """

    error: float
    per_frame: Float[np.ndarray, " horizon"]
    baselines: dict[str, float]
    coverage90: float


def report(
    fit: Fit, past: xr.Dataset, motion: xr.Dataset, result: Forecast | PosteriorForecast
) -> Report | None:
    """Hold a forecast against what happened; None if the clip does not go on long enough.

    Parameters
    ----------
    fit
        The model that forecast.
    past
        The given frames, as the forecast saw them.
    motion
        The whole clip.
    result
        The forecast.
    """
    given, horizon = result.given, result.horizon
    true = truth(fit, motion, given, horizon)
    if true is None:
        return None
    encoding = fit.training.encoding
    n = encoding.n_angles
    per_frame = angle_error(result.mean[given:], true, n)
    ahead = result.mixture.part(slice(given, None), slice(n))
    inside = np.abs(ahead.probability(true[:, :n]) - 0.5) <= LEVEL / 2
    baselines = {
        name: float(angle_error(encoding.unscaled(y), true, n).mean())
        for name, y in _baselines(fit, past, given, horizon).items()
    }
    return Report(float(per_frame.mean()), per_frame, baselines, float(inside.mean()))


def _baselines(fit: Fit, past: xr.Dataset, given: int, horizon: int) -> dict[str, np.ndarray]:
    """Give the scaled features that the three plain forecasts predict."""
    encoding = fit.training.encoding

    def scaled(part: xr.Dataset, seen: xr.Dataset) -> np.ndarray:
        y = encoding.scaled(encoding.features(part, encoding.heading(seen)))
        # A clip's first frame has no velocity; the next frame's stands in.
        return np.where(np.isfinite(y), y, np.concatenate([y[1:2], y[:-1]]))

    y = scaled(past, past)[:given]
    training = {clip: scaled(part, part) for clip, part in split(fit.motion).items()}
    return {
        "hold": hold(y, horizon),
        "constant_velocity": constant_velocity(y, horizon),
        "nearest": nearest(y, horizon, training),
    }


def forecast_picture(
    fit: Fit, motion: xr.Dataset, result: Forecast | PosteriorForecast, count: int = SHOWN
) -> Figure:
    """Draw the angles that move most: given, forecast with its band, and what happened.

    Parameters
    ----------
    fit
        The model that forecast.
    motion
        The clip, as long as it is.
    result
        The forecast.
    count
        Number of angles shown.
    """
    encoding = fit.training.encoding
    n, length = encoding.n_angles, result.given + result.horizon
    known = encoding.features(motion, encoding.heading(motion.isel(frame=slice(result.given))))
    true = np.full((length, n), np.nan)
    true[: len(known)] = known[:length, :n]
    most = np.argsort(-np.nanstd(result.mean[:, :n], axis=0))[: min(count, n)]
    names = [encoding.layout.labels[i] for i in most]
    times = np.arange(length) / encoding.frame_rate
    mean, sd = result.mean[:, most], result.sd[:, most]
    return forecast_plot(times, true[:, most], mean, sd, result.given, names)
