"""Forecast: what follows the first frames of a clip nobody has seen.

The context frames are followed by frames of which nothing is known, and all are predicted
(`inference.predicting`): for every draw of the trained model the clip's own unknowns
(subject, gait, and phase and step, or its latent path) are taken at their modes given the
context, and the forecast is the mixture over draws and modes. Of a point estimate its
intervals leave out how unsure the trained model is.

What is not to be believed of a forecast is told, in a sentence each (`doubts`): what the model
says itself of the clip (`model.TellsNovelty`: a pace or a style unlike every trained one);
joints bend as in no training clip; the body sinks below where the context frames stood.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple, overload

import numpy as np
import xarray as xr
from jaxtyping import Float

from ..catalogue import lacking
from ..errors import InputError
from ..fit import Fit
from ..inference.modes import trained_model
from ..inference.predicting import DRAWS, Prediction, predict
from ..model import AngleData, Fittable, Model, MotionData, ProgramData, TellsNovelty
from ..motion.dataset import label_names, skeleton_of
from ..motion.features import check_one_clip
from ..motion.joining import lengthened
from ..motion.kinematics import poses
from ..motion.resampling import Filter, at_rate
from ..prediction import Mixture
from .cautions import cautions, warn
from .outcome import OfMixture, channels_of, chosen_samples, made_by, one_clip

# Body heights that the lowest joint may sink below the lowest of the context frames.
SINKS = 0.05
# Of the range of an angle in training, and radians, that it may go beyond it.
BEYOND, BEYOND_RADIANS = 0.5, 0.1
NAMED = 3


@dataclass(frozen=True, repr=False)
class Forecast(OfMixture):
    """A forecast of one clip.

    prediction
        Of the context frames and those that follow them.
    mixture
        Predicted features (context + horizon, D) in their own units.
    motion
        The context frames and the predicted mean, as a Motion.
    context, horizon
        Numbers of frames.
    messages
        What is not to be believed of it, in sentences.
    """

    prediction: Prediction
    mixture: Mixture
    motion: xr.Dataset
    context: int
    horizon: int
    messages: tuple[str, ...]

    def __repr__(self) -> str:
        """Return what was forecast, and what is not to be believed of it."""
        told = f"Forecast of {self.horizon} frames from {self.context}: {self.prediction!r}"
        return "\n".join([told, *(f"  warning: {text}" for text in self.messages)])

    @property
    def values(self) -> dict[str, np.ndarray]:
        """The clip's own unknowns at the mode of most weight."""
        return self.prediction.mode

    def draws(self, count: int = 10, seed: int = 0) -> list[xr.Dataset]:
        """Return draws of the whole clip as motions, all of them different.

        There are `samples` of `forecast` of every component: a draw of the trained model with
        one mode of the clip's unknowns.

        Parameters
        ----------
        count
            At most so many.
        seed
            Of the choice among them, by the weights of their components.
        """
        return [self.to_motion(one) for one in chosen_samples(self.prediction, count, seed)]

    def to_motion(self, features: Float[np.ndarray, "n d"]) -> xr.Dataset:
        """Return the clip with what is seen of it, and these features for what is not."""
        return self.prediction.motion({next(iter(self.prediction.sites)): features})

    def to_dataset(self) -> xr.Dataset:
        """Return what is forecast, frame by frame, behind the context.

        Returns
        -------
        ``mean`` and ``sd`` (frame, channel) and ``quantiles`` (quantile, frame, channel) of the
        features in their own units and of anatomical angles in degrees (`tasks.outcome`);
        `bm.write` writes them as .nc or .csv.
        """
        name = one_clip(self.motion).removesuffix(" forecast")
        attrs = {"context": self.context, **made_by(self.prediction)}
        channels = channels_of(self.prediction, skeleton_of(self.motion))
        return channels.table(
            self.mixture, self.motion, name, attrs, frames=slice(self.context, None)
        )


@overload
def forecast(
    fit: Fit,
    clip: xr.Dataset,
    *,
    context: int,
    horizon: int,
    labels: dict[str, str] | None = None,
    draws: int = DRAWS,
    samples: int = 1,
    seed: int = 0,
    filter: Filter = "lowpass",
) -> Forecast: ...


@overload
def forecast(
    fit: Fit,
    clip: Mapping[str, xr.Dataset],
    *,
    context: int,
    horizon: int,
    labels: dict[str, str] | None = None,
    draws: int = DRAWS,
    samples: int = 1,
    seed: int = 0,
    filter: Filter = "lowpass",
) -> dict[str, Forecast]: ...


def forecast(
    fit: Fit,
    clip: xr.Dataset | Mapping[str, xr.Dataset],
    *,
    context: int,
    horizon: int,
    labels: dict[str, str] | None = None,
    draws: int = DRAWS,
    samples: int = 1,
    seed: int = 0,
    filter: Filter = "lowpass",
) -> Forecast | dict[str, Forecast]:
    """Forecast `horizon` frames of a clip from its first `context` frames.

    Parameters
    ----------
    fit
        A fit of a model of motions, by any method.
    clip
        Motion of one clip; frames after the first `context` have no part in the forecast, they
        only tell whether the clip trained the fit. Several clips by
        name, as `bm.split` gives them, are forecast one after the other.
    context, horizon
        Numbers of frames at the fit's rate, at least 1 of each; of one frame no velocity is known.
    labels
        What is known of the clip, for example ``{"subject": "02"}``; a label that is not
        named is estimated, whatever the clip says of it.
    draws
        At most so many draws of the fit.
    samples
        How many motions are drawn of every component, for `Forecast.draws`.
    seed
        Of random parts.
    filter
        Of a clip of another frame rate, which is brought to the fit's: as of `bm.resample`.

    Returns
    -------
    The forecast; of several clips those of all, by name.

    Raises
    ------
    InputError
        If the clip has fewer than `context` frames or other joints, a label is not one of
        training, or the model does not predict motions.

    Warns
    -----
    MotionWarning
        If the clip has another frame rate or trained the fit, the fit's draws are not to be
        trusted, the pace or the style found is unlike those of training, or the body forecast
        sinks through the floor or bends its joints as no training clip does.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> model, walks = bm.example("multifactor")
    >>> fit = bm.fit(model, walks, method=bm.MAP(max_steps=50), seed=0)
    >>> clip = bm.split(walks)["ann-run"]
    >>> future = bm.forecast(fit, clip, context=10, horizon=5)
    >>> all_of_them = bm.forecast(fit, bm.split(walks), context=10, horizon=5)
    """
    how = Settings(context, horizon, labels, draws, samples, seed, fit.frame_rate, filter)
    if isinstance(clip, xr.Dataset):
        return _of_clip(fit, clip, how)
    return {name: _of_clip(fit, one, how) for name, one in clip.items()}


class Settings(NamedTuple):
    """What is asked of a forecast, as in `forecast`; `rate` is that of its frames."""

    context: int
    horizon: int
    labels: dict[str, str] | None
    draws: int
    samples: int
    seed: int
    rate: float
    filter: Filter


def _of_clip(fit: Fit, clip: xr.Dataset, how: Settings) -> Forecast:
    """Forecast one clip."""
    context, horizon = how.context, how.horizon
    name = _site(fit)
    check_labels(fit, how.labels or {})
    given, resampled = at_rate(clip, how.rate, context=context, filter=how.filter)
    past = context_of(given, context=context, horizon=horizon, labels=how.labels)
    prediction = predict(
        fit, lengthened(past, horizon), draws=how.draws, samples=how.samples, seed=how.seed
    )
    mixture = prediction.site(name)
    assert isinstance(mixture, Mixture), "values of motions are normal"
    motion = prediction.motion({name: mixture.means()})
    messages = [
        *resampled,
        # A training clip is known by all its frames: filters differ where a clip ends.
        *cautions(fit, at_rate(clip, how.rate, filter=how.filter)[0]),
        *doubts(fit.model, fit.training, prediction, mixture.means()[context:], motion, context),
    ]
    messages = list(dict.fromkeys(messages))
    warn("the forecast", messages, stacklevel=4)
    return Forecast(prediction, mixture, motion, context, horizon, tuple(messages))


def context_of(
    clip: xr.Dataset, *, context: int, horizon: int, labels: dict[str, str] | None = None
) -> xr.Dataset:
    """Return the context frames of a clip with what is known of it; other labels are empty.

    Parameters
    ----------
    clip, context, horizon, labels
        As of `forecast`.

    Raises
    ------
    InputError
        If there are not so many frames.
    """
    name, frames = check_one_clip(clip), clip.sizes["frame"]
    if context < 1 or horizon < 1 or frames < context:
        raise InputError(
            f"clip {name!r}",
            f"{context} frames of context and {horizon} to forecast, the clip has {frames}",
            "Give at least 1 frame that the clip has, and forecast at least 1",
        )
    texts = {**dict.fromkeys(label_names(clip), ""), **(labels or {}), "clip": f"{name} forecast"}
    coords = {label: ("frame", np.full(context, text)) for label, text in texts.items()}
    return clip.isel(frame=slice(context)).assign_coords(coords)


def angle_error(
    predicted: Float[np.ndarray, "n d"], true: Float[np.ndarray, "n d"]
) -> Float[np.ndarray, " n"]:
    """Return the error of each frame in the paper's unit: the norm over the angles, in radians."""
    return np.linalg.norm(predicted - true, axis=1)


def angles_of(fit: Fit, clip: xr.Dataset, context: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a clip's angles (N, A) in radians, and which columns of its features they are.

    Those that never change in training are left out. Its heading, where that is taken out, is
    told by the context frames, as for a forecast.

    Raises
    ------
    InputError
        If the model's data have no angles.
    """
    there = xr.DataArray(np.arange(clip.sizes["frame"]) < context, dims="frame")
    roots = clip["root_position"].where(there)
    data = fit.model.prepare(clip.assign(root_position=roots), fit.training)
    if not isinstance(data, AngleData):
        raise lacking(fit.model.name, "what it predicts has no joint angles", AngleData)
    ((name, values),) = data.observed().data_vars.items()
    units, scaled = data.units()[str(name)], values.values
    columns = np.asarray(data.angles)
    columns = columns[np.isfinite(scaled[:, columns]).all(axis=0)]
    return units.natural(scaled)[:, columns], columns


def check_labels(fit: Fit, labels: dict[str, str]) -> None:
    """Refuse labels that no training clip has."""
    for label, level in labels.items():
        known = fit.labels.get(label, [])
        if level not in known:
            raise InputError(
                "labels of the clip",
                f"{label} {level!r} is not in the training clips",
                f"Use one of {', '.join(known) or 'no label'}, or leave it out",
            )


def _site(fit: Fit) -> str:
    """Return the one site that forecasts are of; refuse models of anything but motions."""
    data = fit.training
    rows = {str(name): len(values) for name, values in data.observed().data_vars.items()}
    if not isinstance(data, MotionData) or [*rows.values()] != [fit.motion.sizes.get("frame")]:
        raise lacking(fit.model.name, "it does not predict the frames of motions", AngleData)
    return next(iter(rows))


def doubts(
    model: Fittable,
    training: ProgramData,
    prediction: Prediction,
    ahead: Float[np.ndarray, "h d"],
    motion: xr.Dataset,
    context: int,
) -> list[str]:
    """Return, in a sentence each, what is not to be believed of a forecast.

    Parameters
    ----------
    model, training
        The trained model, and what it was trained on.
    prediction
        Of the clip.
    ahead
        (horizon, D) features forecast, in their own units.
    motion
        Context and forecast as a Motion.
    context
        Number of context frames.
    """
    messages = [*bending(training, ahead), *sinking(motion, context)]
    if isinstance(model, TellsNovelty) and isinstance(model, Model):
        draw = {name: value[prediction.mode_draw] for name, value in prediction.trained.items()}
        trained = trained_model(model, training.data[0], draw)
        messages += model.novelty(trained, prediction.data.data[0], prediction.mode)
    return messages


def bending(training: ProgramData, ahead: Float[np.ndarray, "h d"]) -> Iterator[str]:
    """Tell of joints that bend farther than in any training clip."""
    if not isinstance(training, AngleData):
        return
    ((name, observed),) = training.observed().data_vars.items()
    units = training.units()[str(name)]
    seen = np.isfinite(observed.values).any(axis=0)
    columns = np.asarray(training.angles)
    columns = columns[seen[columns]]
    angles = units.natural(observed.values)[:, columns]
    low, high = np.nanmin(angles, axis=0), np.nanmax(angles, axis=0)
    room = BEYOND * (high - low) + BEYOND_RADIANS
    over = np.maximum(low - ahead[:, columns], ahead[:, columns] - high).max(axis=0)
    out = [i for i in np.argsort(room - over) if over[i] > room[i]]
    if out:
        labels = observed[observed.dims[1]].values[columns]
        names = [f"{labels[i]} by {over[i]:.1f} rad" for i in out[:NAMED]]
        more = f" and {len(out) - NAMED} more" if len(out) > NAMED else ""
        yield f"joints bend farther than in training: {', '.join(names)}{more}"


def sinking(motion: xr.Dataset, context: int) -> Iterator[str]:
    """Tell of a body that sinks below where the context frames stood."""
    skeleton = skeleton_of(motion)
    where, _ = poses(skeleton, motion["angle"].values, motion["root_position"].values)
    rest, _ = poses(skeleton, np.zeros((1, len(skeleton.dofs))), np.zeros((1, 3)))
    low, height = where[..., 1].min(axis=1), float(np.ptp(rest[0], axis=0).max())
    before, after = low[:context][np.isfinite(low[:context])], low[context:]
    if len(before) and (sunk := float(before.min() - after.min()) / height) > SINKS:
        yield f"the body sinks {sunk:.0%} of its height below where the context frames stood"
