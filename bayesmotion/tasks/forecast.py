"""Forecast: what follows the first frames of a clip nobody has seen.

The new clip's own unknowns (subject, gait, and phase and step, or its latent
path) are estimated by the trained model's program from the frames given, from
many starts. They go on by the dynamics, and all frames are predicted, conditioned
on the training frames and on the frames given.
"""

from dataclasses import dataclass, replace
from functools import partial

import jax
import numpy as np
import xarray as xr
from jaxtyping import Float

from ..errors import InputError
from ..fit import Fit
from ..inference.density import ProgramDensity
from ..inference.mode import stack
from ..inference.optimise import Optimum, maximise
from ..models.multifactor import Multifactor
from ..models.new_clips import extend, new_clip_starts
from ..models.poses import Frames, frames_of
from ..models.predicting import Given, Prediction
from ..models.starts import search_roots
from ..motion.dataset import skeleton_of
from ..motion.features import check_one_clip

KEEP = 4


@dataclass(frozen=True)
class Forecast:
    """A forecast of one clip.

    motion
        The given and the predicted frames, as a Motion.
    mean
        (given + horizon, D) predicted features in their own units.
    sd
        (given + horizon, D) their standard deviations.
    values
        The new clip's estimated sites.
    given, horizon
        Numbers of frames.
    optimum
        What the search over the clip's unknowns found.
    """

    motion: xr.Dataset
    mean: Float[np.ndarray, "n d"]
    sd: Float[np.ndarray, "n d"]
    values: dict[str, np.ndarray]
    given: int
    horizon: int
    optimum: Optimum


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
    """
    new = new_clip(fit, motion, given=given, horizon=horizon, labels=labels)
    optimum = infer(fit, new.seen, max_steps=max_steps)
    values = ProgramDensity(fit.model).natural(optimum.best(), (new.seen, fit.trained))
    natural = {name: np.asarray(value) for name, value in values.items()}
    going_on = extend(fit.model, natural, fit.trained, given + horizon)
    predicted = _predict(fit.model, new.whole, going_on, fit.trained)
    mean = fit.training.encoding.unscaled(np.asarray(predicted.mean))
    sd = np.sqrt(np.asarray(predicted.variance())) * fit.training.encoding.spread
    future = new.motion(fit, motion, mean)
    return Forecast(future, mean, sd, natural, given, horizon, optimum)


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
    y = encoding.scaled(encoding.features(past, heading))
    seen = _new_frames(fit, clip, y, labels or {}, given)
    longer = np.concatenate([y, np.full((horizon, y.shape[1]), np.nan)])
    whole = _new_frames(fit, clip, longer, labels or {}, given)
    return NewClip(clip, y, heading, seen, whole)


def unstrayed(model: Multifactor) -> Multifactor:
    """Give the model that a new clip's unknowns are estimated by (`Multifactor.freedom`).

    It is the same for all degrees of freedom, so that they share a compilation.
    """
    return replace(model, freedom=None)


def infer(fit: Fit, frames: Frames, *, max_steps: int = 400) -> Optimum:
    """Estimate a new clip's own sites by the mode of their density, from many starts."""
    density = ProgramDensity(unstrayed(fit.model))
    starts = new_clip_starts(fit.model, frames, fit.training.frames, fit.values(), fit.trained)
    first = stack([density.real(start, (frames, fit.trained)) for start in starts])
    roots = search_roots(fit.model, frames, starts[0], fit.trained)
    data = (frames, fit.trained)
    return maximise(
        density, first, data, max_steps=max_steps, keep=KEEP, roots=roots, together=KEEP
    )


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
    rate, missing = fit.training.encoding.frame_rate, fit.training.frames.missing
    return frames_of({clip: y}, given, known, missing, length, frame_rate=rate)


@partial(jax.jit, static_argnames="model")
def _predict(model: Multifactor, frames: Frames, values: dict, given: Given) -> Prediction:
    return model.predict(frames, values, given)


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
