"""Forecast: what follows the first frames of a clip nobody has seen.

The new clip's own unknowns (subject, gait, and phase and step, or its latent
path) are estimated by the trained model's program from the frames given, from
many starts. They go on by the dynamics, and all frames are predicted, conditioned
on the training frames and on the frames given. The forecast is the mixture of what all
modes found predict, by the posterior mass about each (`clip_modes`).

Its bands are those of a point estimate: they leave out how unsure the trained parameters
are, and how unsure the clip's unknowns are about each mode.
`posterior_forecast` averages over both.
"""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Float

from ..errors import InputError
from ..fit import Fit
from ..inference.optimise import Optimum
from ..models.poses import Frames, frames_of
from ..motion.dataset import skeleton_of
from ..motion.features import check_one_clip
from ..prediction import Mixture
from .clip_modes import Modes, modes_of, predict, search
from .plausible import warn_of_forecast


@dataclass(frozen=True)
class Forecast:
    """A forecast of one clip.

    motion
        The given frames and the predicted mean, as a Motion.
    mixture
        Predicted features (given + horizon, D) in their own units, a normal distribution
        for every mode of the clip's unknowns, the highest first.
    modes
        The modes.
    given, horizon
        Numbers of frames.
    optimum
        What the search over the clip's unknowns found.
    """

    motion: xr.Dataset
    mixture: Mixture
    modes: Modes
    given: int
    horizon: int
    optimum: Optimum

    @property
    def mean(self) -> Float[np.ndarray, "n d"]:
        """Predicted features in their own units."""
        return self.mixture.means()

    @property
    def sd(self) -> Float[np.ndarray, "n d"]:
        """Their standard deviations."""
        return self.mixture.sds()

    @property
    def values(self) -> dict[str, np.ndarray]:
        """The new clip's sites at the mode of the most posterior mass."""
        return self.modes.values[int(np.argmax(self.mixture.weight))]


def forecast(
    fit: Fit,
    motion: xr.Dataset,
    *,
    given: int,
    horizon: int,
    labels: dict[str, str] | None = None,
    max_steps: int = 400,
) -> Forecast:
    """Forecast `horizon` frames of a clip from its first `given` frames.

    Parameters
    ----------
    fit
        A fitted model.
    motion
        The clip; frames after the first `given` are not looked at.
    given, horizon
        Numbers of frames, at least 2 and 1.
    labels
        What is known of the clip, for example ``{"subject": "02"}``; a factor that
        is not named is estimated.
    max_steps
        At most so many L-BFGS steps.

    Raises
    ------
    InputError
        If the clip has fewer than `given` frames, another frame rate or other joints,
        or a label is not one of the trained levels.

    Warns
    -----
    MotionWarning
        If the pace or the style found lies outside those of training, or the body forecast
        sinks through the floor or bends its joints as no training clip does.
    """
    new = new_clip(fit, motion, given=given, horizon=horizon, labels=labels)
    optimum = search(fit, new.seen, max_steps=max_steps)
    modes, mixture = predict(fit, new.whole, modes_of(fit, new.seen, optimum))
    future = new.motion(fit, motion, mixture.means())
    found = Forecast(future, mixture, modes, given, horizon, optimum)
    warn_of_forecast(fit, new.seen, found.values, mixture.means(), future, given)
    return found


@dataclass(frozen=True)
class NewClip:
    """A clip nobody has seen, as the program is given it.

    name
        Of the clip.
    y
        (given, D) scaled features of the frames given.
    heading
        Taken out of the clip, in radians.
    seen, whole
        The frames given, and those together with the frames to come (all NaN).
    """

    name: str
    y: Float[np.ndarray, "n d"]
    heading: float
    seen: Frames
    whole: Frames

    def motion(self, fit: Fit, motion: xr.Dataset, mean: Float[np.ndarray, "m d"]) -> xr.Dataset:
        """Make the frames given and the features predicted for the others into a Motion."""
        encoding, given = fit.training.encoding, len(self.y)
        shown = encoding.scaled(mean)
        shown[:given] = self.y
        return encoding.motion(
            shown,
            skeleton_of(motion),
            clip=f"{self.name} forecast",
            start=motion["root_position"].values[0],
            heading=self.heading,
            source=f"forecast from the first {given} frames of {self.name}",
        )


def new_clip(
    fit: Fit, motion: xr.Dataset, *, given: int, horizon: int, labels: dict[str, str] | None = None
) -> NewClip:
    """Make the first frames of a clip into what the trained program is given.

    Raises
    ------
    InputError
        As `forecast`.
    """
    clip = check_one_clip(motion)
    if given < 2 or horizon < 1 or motion.sizes["frame"] < given:
        raise InputError(
            f"clip {clip!r}",
            f"{given} frames given and {horizon} to forecast, the clip has {motion.sizes['frame']}",
            "Give at least 2 frames that the clip has, and forecast at least 1",
        )
    past = motion.isel(frame=slice(given))
    encoding = fit.training.encoding
    heading = encoding.heading(past)
    features = encoding.features(past, heading)
    y, told = encoding.scaled(features), encoding.told(features)
    seen = _new_frames(fit, clip, told, labels or {}, given)
    longer = np.concatenate([told, np.full((horizon, y.shape[1]), np.nan)])
    whole = _new_frames(fit, clip, longer, labels or {}, given)
    return NewClip(clip, y, heading, seen, whole)


def _new_frames(fit: Fit, clip: str, y: np.ndarray, labels: dict[str, str], length: int) -> Frames:
    levels = fit.training.levels
    for factor, label in labels.items():
        if label not in levels.get(factor, []):
            raise InputError(
                f"clip {clip!r}",
                f"{factor} {label!r} is not in the training clips",
                f"Use one of {', '.join(levels.get(factor, [])) or 'no label'}, or leave it out",
            )
    # Levels that were unknown in training clips keep their places among the trained ones.
    known = {
        factor: [*names, *(f"\0{i}" for i in range(count - len(names)))]
        for (factor, names), count in zip(levels.items(), fit.training.frames.levels, strict=True)
    }
    given = {factor: {clip: labels.get(factor, "")} for factor in levels}
    return frames_of(
        {clip: y}, given, known, fit.training.frames.missing, length,
        frame_rate=fit.training.encoding.frame_rate,
    )  # fmt: skip


def angle_error(
    predicted: Float[np.ndarray, "n d"], true: Float[np.ndarray, "n d"], n_angles: int
) -> Float[np.ndarray, " n"]:
    """Error of each frame in the paper's unit: the norm over the angular features, in radians."""
    return np.linalg.norm((predicted - true)[:, :n_angles], axis=1)


def truth(
    fit: Fit, motion: xr.Dataset, given: int, horizon: int
) -> Float[np.ndarray, "n d"] | None:
    """Features of the frames a forecast is about, None if the clip does not go on so long."""
    if motion.sizes["frame"] < given + horizon:
        return None
    encoding = fit.training.encoding
    heading = encoding.heading(motion.isel(frame=slice(given)))
    return encoding.features(motion, heading)[given : given + horizon]
