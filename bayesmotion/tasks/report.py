"""How good a forecast is: its scores beside the errors of three simple ones."""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.figure import Figure

from ..fit import Fit
from ..model import ProgramData
from ..motion.joining import split
from ..plots import forecast_plot
from ..prediction import Scores, score
from .baselines import constant_velocity, hold, nearest
from .forecast import Forecast, angle_error, angles_of

SHOWN = 6


@dataclass(frozen=True)
class Report:
    """A forecast held against what happened.

    scores
        Error, CRPS, log score and coverage of the predicted angles, in radians.
    per_frame
        (horizon,) norm of the error over the angles, frame by frame.
    baselines
        Mean errors of three simple forecasts: hold, constant_velocity, nearest.
    """

    scores: Scores
    per_frame: Float[np.ndarray, " horizon"]
    baselines: dict[str, float]

    @property
    def error(self) -> float:
        """Mean over the predicted frames of the norm over the angles, in radians."""
        return self.scores.error

    @property
    def coverage90(self) -> float:
        """Share of the angles that lie in the forecast's 90 % interval."""
        return self.scores.coverage90


def report(fit: Fit, clip: xr.Dataset, result: Forecast) -> Report | None:
    """Hold a forecast against what happened; None if the clip does not go on long enough.

    Parameters
    ----------
    fit
        The model that forecast.
    clip
        The whole clip.
    result
        The forecast.
    """
    context, length = result.context, result.context + result.horizon
    if clip.sizes["frame"] < length:
        return None
    angles, columns = angles_of(fit, clip.isel(frame=slice(length)), context)
    true = angles[context:]
    per_frame = angle_error(result.mean[context:, columns], true)
    data = result.prediction.data
    ((name, _),) = data.observed().data_vars.items()
    units = data.units()[str(name)]
    baselines = {
        label: float(angle_error(units.natural(y)[:, columns], true).mean())
        for label, y in _baselines(fit, data, context, result.horizon).items()
    }
    ahead = result.mixture.part(slice(context, None), columns)
    return Report(score(ahead, true), per_frame, baselines)


def _baselines(fit: Fit, data: ProgramData, context: int, horizon: int) -> dict[str, np.ndarray]:
    """Return the scaled features that the three simple forecasts predict."""
    y = _filled(data)[:context]
    training = {
        clip: _filled(fit.model.prepare(part, fit.training))
        for clip, part in split(fit.motion).items()
    }
    return {
        "hold": hold(y, horizon),
        "constant_velocity": constant_velocity(y, horizon),
        "nearest": nearest(y, horizon, training),
    }


def _filled(data: ProgramData) -> Float[np.ndarray, "n d"]:
    """Return scaled features, their mean in training (zero) where they are missing."""
    ((_, observed),) = data.observed().data_vars.items()
    return np.where(np.isfinite(observed.values), observed.values, 0.0)


def forecast_picture(fit: Fit, clip: xr.Dataset, result: Forecast, count: int = SHOWN) -> Figure:
    """Draw the angles that move most: context, forecast with its band, and what happened.

    Parameters
    ----------
    fit
        The model that forecast.
    clip
        The clip, as long as it is.
    result
        The forecast.
    count
        Number of angles shown.
    """
    length = result.context + result.horizon
    known, columns = angles_of(fit, clip, result.context)
    true = np.full((length, len(columns)), np.nan)
    true[: len(known)] = known[:length]
    mean, sd = result.mean[:, columns], result.sd[:, columns]
    most = np.argsort(-np.nanstd(mean, axis=0))[: min(count, len(columns))]
    ((_, observed),) = result.prediction.data.observed().data_vars.items()
    names = [str(label) for label in observed[observed.dims[1]].values[columns[most]]]
    times = np.arange(length) / float(clip.attrs["frame_rate"])
    return forecast_plot(times, true[:, most], mean[:, most], sd[:, most], result.context, names)
