"""How good a forecast is: its scores beside the errors of three simple ones."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.figure import Figure

from ..errors import InputError
from ..fit import Fit
from ..model import ProgramData
from ..motion.dataset import skeleton_of
from ..motion.joining import split
from ..plots import forecast_plot
from ..prediction import Scores, score
from .baselines import constant_velocity, hold, nearest
from .forecast import Forecast, angle_error, angles_of
from .outcome import (
    anatomy_of,
    anatomy_of_motion,
    channels_of,
    chosen_angles,
    features_drawn,
    one_clip,
)

SHOWN = 6


@dataclass(frozen=True)
class ForecastScores:
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


def forecast_scores(fit: Fit, clip: xr.Dataset, result: Forecast) -> ForecastScores | None:
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
    return ForecastScores(score(ahead, true), per_frame, baselines)


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


def forecast_picture(
    fit: Fit, clip: xr.Dataset, result: Forecast, joints: Sequence[str] = (), count: int = SHOWN
) -> Figure:
    """Draw anatomical angles in degrees: context, forecast with its band, and what happened.

    The title tells the clip, and of the angles shown the mean absolute error over the frames
    forecast and how often the band held. Where the body has no limbs that are known by their
    names, the model's angles that move most are drawn.

    Parameters
    ----------
    fit
        The model that forecast.
    clip
        The clip, as long as it is.
    result
        The forecast.
    joints
        Which angles: words of their names, such as ``left knee`` or ``hip flexion``. Those that
        move most where empty.
    count
        Number of angles shown where none is named.

    Raises
    ------
    InputError
        If there is no such angle.
    """
    length, context = result.context + result.horizon, result.context
    drawn = anatomy_of(result.mixture, result.to_motion)
    truth: dict[str, np.ndarray] = {}
    if drawn:
        truth = anatomy_of_motion(clip)
    elif joints:
        raise InputError(
            f"clip {one_clip(clip)!r}", "no limb of its body is known by its name",
            "Leave the joints out, or name joints as in LeftKnee and LeftElbow",
        )  # fmt: skip
    else:
        drawn, truth = _feature_angles(fit, clip, result)
    names = list(drawn)
    if joints:
        names = chosen_angles(names, joints)
    else:
        most = np.argsort([-float(drawn[name].mean(axis=0).std()) for name in names])
        names = [names[i] for i in sorted(most[:count])]
    each = np.stack([drawn[name] for name in names], axis=-1)
    low, middle, high = np.quantile(each, (0.05, 0.5, 0.95), axis=0)
    true = np.full((length, len(names)), np.nan)
    shown = min(length, clip.sizes["frame"])
    true[:shown] = np.stack([truth[name][:shown] for name in names], axis=-1)
    return forecast_plot(
        np.arange(length) / float(clip.attrs["frame_rate"]),
        true,
        middle,
        (low, high),
        context,
        names,
        title=_title(one_clip(clip), true[context:], middle[context:], low[context:],
                     high[context:]),
    )  # fmt: skip


def _title(
    clip: str, true: np.ndarray, middle: np.ndarray, low: np.ndarray, high: np.ndarray
) -> str:
    """Say how far off the angles shown are, as far as that is known."""
    known = np.isfinite(true)
    if not known.any():
        return f"{clip}: forecast, what happened is not known"
    error = float(np.abs(middle - true)[known].mean())
    held = float(((low <= true) & (true <= high))[known].mean())
    return f"{clip}: mean error {error:.1f} degrees, the 90% band held {held:.0%}"


def _feature_angles(
    fit: Fit, clip: xr.Dataset, result: Forecast
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return the model's own angles in degrees: values drawn (S, N), and what happened."""
    known, columns = angles_of(fit, clip, result.context)
    labels = channels_of(result.prediction, skeleton_of(result.motion)).labels
    drawn = features_drawn(result.mixture)[:, :, columns]
    names = [str(labels[column]) for column in columns]
    return (
        {name: np.degrees(drawn[:, :, i]) for i, name in enumerate(names)},
        {name: np.degrees(known[:, i]) for i, name in enumerate(names)},
    )
