"""Synthesis: motions nobody recorded, from a model of styles and a phase.

A motion is a path of styles and phases: the styles of any combination of levels (a missing
cell of the grid), styles drawn from a Gaussian fitted to the learned ones, or a factor that
changes along a line. The step of the phase follows from the styles, and poses are what the
trained process predicts: the model says both (`verbs.MovesByStyle`).

All of that is done for every draw of the fit. The phases of the motion are those of the mean
step, so that draws of slightly different pace do not blur it; poses are the mixture over the
draws at these phases.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Float

from ..catalogue import lacking
from ..errors import InputError
from ..fit import Fit
from ..inference.draws import draw_keys, stacked
from ..inference.predicting import DRAWS
from ..model import ProgramData
from ..models.multifactor.encoding import PoseEncoding
from ..motion.dataset import skeletons
from ..motion.kinematics import positions
from ..prediction import Mixture
from ..verbs import MovesByStyle, StyleFactor
from .cautions import cautions, warn
from .outcome import Channels, OfMixture, one_clip, units_of

# Of every draw the style vector of every frame; with novel dimensions or without.
Styles = Mapping[str, Float[np.ndarray, "s n q"]]


@runtime_checkable
class StyleData(ProgramData, Protocol):
    """Training motions of labelled styles."""

    @property
    def encoding(self) -> PoseEncoding:
        """How poses become features."""
        ...

    @property
    def levels(self) -> dict[str, list[str]]:
        """For each factor the names of the known levels."""
        ...


@dataclass(frozen=True, repr=False)
class Synthesis(OfMixture):
    """A synthesised motion.

    motion
        The mean over the draws as a Motion, on the floor.
    styles
        For each factor the style vector of every draw and frame (S, N, Q).
    phase
        (N,) phase of every frame in radians, running on.
    mixture
        Features (N, D) in their own units, over the draws.
    samples
        Joint draws of all features (J, N, D), as many of every draw of the fit.
    channels
        How the features are told of.
    messages
        What is not to be believed of it, in sentences.
    """

    motion: xr.Dataset
    styles: Styles
    phase: Float[np.ndarray, " n"]
    mixture: Mixture
    samples: Float[np.ndarray, "j n d"]
    channels: Channels
    messages: tuple[str, ...]

    def __repr__(self) -> str:
        """Return how long the motion is, over how many draws, and what is not to be believed."""
        frames, rate = self.motion.sizes["frame"], float(self.motion.attrs["frame_rate"])
        draws = len(self.mixture.weight)
        told = f"Synthesis of {frames} frames at {rate:g} a second, the mean of {draws} draws"
        return "\n".join([told, *(f"  warning: {text}" for text in self.messages)])

    def draws(self, count: int = 10, seed: int = 0) -> list[xr.Dataset]:
        """Return draws of the whole motion, all of them different.

        Parameters
        ----------
        count
            At most so many: there are `samples` of `synthesize` of every draw of the fit.
        seed
            Of the choice among them.
        """
        random = np.random.default_rng(seed)
        chosen = random.permutation(len(self.samples))[:count]
        return [self.channels.to_motion(self.samples[one]) for one in chosen]

    def to_dataset(self) -> xr.Dataset:
        """Return the motion with its uncertainty, frame by frame.

        Returns
        -------
        ``mean`` and ``sd`` (frame, channel) and ``quantiles`` (quantile, frame, channel) of the
        features in their own units and of anatomical angles in degrees (`tasks.outcome`);
        `bm.write` writes them as .nc or .csv.
        """
        attrs = {"draws": len(self.mixture.weight)}
        return self.channels.table(self.mixture, self.motion, one_clip(self.motion), attrs)


def synthesize(
    fit: Fit,
    levels: Mapping[str, str],
    seconds: float,
    *,
    draws: int = DRAWS,
    samples: int = 0,
    phase: float = 0.0,
) -> Synthesis:
    """Make the motion of one combination of levels, recorded or not.

    Parameters
    ----------
    fit
        A fit of a model of styles and a phase, such as `Multifactor` with content on a circle.
    levels
        A level of every factor, such as ``{"subject": "02", "gait": "run"}``.
    seconds
        Length of the motion.
    draws
        At most so many draws of the fit.
    samples
        How many motions are drawn of every draw of the fit, for `Synthesis.draws`.
    phase
        Phase of the first frame, in radians.

    Raises
    ------
    InputError
        If the model is another, a level is unknown or missing, or the step that follows from
        the styles is not positive.

    Warns
    -----
    MotionWarning
        If the fit's draws are not to be trusted.
    """
    made = _Draws(fit, draws, samples)
    styles = {name: made.level(name, levels.get(name, "")) for name in made.factors}
    n = made.frames(seconds)
    paths = {name: np.repeat(style[:, None], n, axis=1) for name, style in styles.items()}
    return made.motion(paths, "-".join(levels.values()), levels, phase)


def transition(
    fit: Fit,
    levels: Mapping[str, str],
    factor: str,
    path: tuple[str, ...],
    seconds: float,
    *,
    draws: int = DRAWS,
    samples: int = 0,
) -> Synthesis:
    """Move one factor along straight lines through the levels of `path`, in equal times.

    Parameters
    ----------
    fit, seconds, draws, samples
        As of `synthesize`.
    levels
        The levels of the other factors, which stay.
    factor, path
        The factor that changes, and its levels on the way, at least one.
    """
    made = _Draws(fit, draws, samples)
    n = made.frames(seconds)
    corners = np.stack([made.level(factor, level) for level in path], axis=1)
    where = np.linspace(0.0, len(path) - 1.0, n)
    first = np.minimum(where.astype(int), max(len(path) - 2, 0))
    share = (where - first)[None, :, None]
    following = np.minimum(first + 1, len(path) - 1)
    moving = (1.0 - share) * corners[:, first] + share * corners[:, following]
    paths = {
        name: np.repeat(made.level(name, levels.get(name, ""))[:, None], n, axis=1)
        for name in made.factors
        if name != factor
    }
    clip = f"{'-'.join(levels.values())}: {' to '.join(path)}"
    return made.motion({**paths, factor: moving}, clip, levels)


def sampled(
    fit: Fit, seconds: float, seed: int, *, draws: int = DRAWS, samples: int = 0
) -> Synthesis:
    """Make a motion with every factor's style drawn from the learned ones' Gaussian.

    Every draw has its own Gaussian; the same weights of the learned vectors are drawn for all.

    Parameters
    ----------
    fit, seconds, draws, samples
        As of `synthesize`.
    seed
        Of the styles.
    """
    made = _Draws(fit, draws, samples)
    n = made.frames(seconds)
    paths = {}
    for index, name in enumerate(made.factors):
        learned = made.learned(name)
        mean, count = learned.mean(axis=1, keepdims=True), learned.shape[1]
        away = (learned - mean) / np.sqrt(max(count - 1, 1))
        white = np.random.default_rng(1000 * seed + index).normal(size=count)
        style = mean[:, 0] + np.einsum("l,slq->sq", white, away)
        paths[name] = np.repeat(style[:, None], n, axis=1)
    return made.motion(paths, f"sample {seed}", {})


def of_styles(
    fit: Fit, styles: Styles, *, clip: str, draws: int = DRAWS, phase: float = 0.0
) -> Synthesis:
    """Make the motion of any path of styles.

    Parameters
    ----------
    fit, draws, phase
        As of `synthesize`.
    styles
        For each factor the style vector of every draw and frame (S, N, Q), those in their novel
        dimensions behind the trained ones, or without these: zero.
    clip
        Name of the motion.

    Raises
    ------
    InputError
        As `synthesize`, and if vectors have another size.
    """
    return _Draws(fit, draws).motion(styles, clip, {}, phase)


def step_map(fit: Fit, draws: int = DRAWS) -> Float[np.ndarray, "..."]:
    """Return the map from style vectors to the step, one axis a factor, of each draw."""
    return _Draws(fit, draws).step_map


def styles_of(fit: Fit) -> dict[str, list[str]]:
    """Return the factors of a fit that synthesis can use, and their levels.

    Raises
    ------
    InputError
        If the model has no styles and phase.
    """
    model, training = _styled(fit)
    return {factor.name: training.levels[factor.name] for factor in model.moved_by()}


def _styled(fit: Fit) -> tuple[MovesByStyle, StyleData]:
    model = fit.model
    if not isinstance(model, MovesByStyle):
        raise lacking(model.name, "it has no styles to make motions of", MovesByStyle)
    training = fit.training
    assert isinstance(training, StyleData), "styles are those of labelled motions"
    return model, training


class _Draws:
    """The draws of a fit that synthesis is averaged over."""

    def __init__(self, fit: Fit, draws: int, samples: int = 0) -> None:
        self.model, self.training = _styled(fit)
        self.style_factors: Sequence[StyleFactor] = self.model.moved_by()
        self.fit, self.samples = fit, samples
        values, _ = stacked(fit, draws)
        self.values = {name: np.asarray(value) for name, value in values.items()}

    @property
    def factors(self) -> list[str]:
        """Names of the factors."""
        return [factor.name for factor in self.style_factors]

    def learned(self, factor: str) -> Float[np.ndarray, "s l q"]:
        """Return the learned style vectors of all levels."""
        return self.values[f"style_{factor}"]

    def level(self, factor: str, level: str) -> Float[np.ndarray, "s q"]:
        """Return the learned style vectors of a level."""
        levels = self.training.levels
        if factor not in levels or level not in levels[factor]:
            known = ", ".join(levels.get(factor, [])) or "none"
            raise InputError(
                "synthesis", f"{factor} {level!r} is not in the training clips", f"Known: {known}"
            )
        return self.learned(factor)[:, levels[factor].index(level)]

    def frames(self, seconds: float) -> int:
        """Return a length in frames."""
        n = round(seconds * self.training.encoding.frame_rate)
        if n < 2:
            raise InputError("synthesis", f"{seconds} seconds are {n} frames", "Ask for more")
        return n

    @property
    def step_map(self) -> Float[np.ndarray, "..."]:
        """Return the map of `step_map`."""
        return self.model.step_map(self.training.data[0], self.values)

    def phases(self, styles: Styles, n: int, phase: float) -> Float[np.ndarray, " n"]:
        """Return the phase of every frame, at the mean step of the draws."""
        step = np.repeat(self.step_map[:, None], n, axis=1)
        for factor in self.style_factors:
            known = styles[factor.name][..., : factor.size]
            step = np.einsum("snq...,snq->sn...", step, known)
        mean = step.mean(axis=0)
        if not np.all(mean > 0):
            raise InputError(
                "synthesis",
                f"the styles lead to a step of {mean.min():.3f} radians a frame",
                "Choose styles nearer to the learned ones",
            )
        return phase + np.concatenate([[0.0], np.cumsum(mean[:-1])])

    def motion(
        self, styles: Styles, clip: str, labels: Mapping[str, str], phase: float = 0.0
    ) -> Synthesis:
        """Make the motion of a path of styles."""
        padded = self._padded(styles)
        n = next(iter(padded.values())).shape[1]
        angle = self.phases(styles, n, phase)
        keys = draw_keys(0, {name: jnp.asarray(value) for name, value in self.values.items()})
        mean, variance, drawn = self.model.features_of_styles(
            self.training.data[0], self.values, padded, angle, keys, self.samples
        )
        encoding = self.training.encoding
        means = encoding.unscaled(np.asarray(mean))
        climb = _climb(means.mean(axis=0))
        count = len(means)
        sds = np.sqrt(np.asarray(variance)) * encoding.sd
        mixture = Mixture(means - climb, sds, np.full(count, 1.0 / count))
        bodies = skeletons(self.fit.motion)
        name = _skeleton_with(self.fit.motion, labels)
        body = next(iter(bodies.values())) if name is None else bodies[name]

        def to_motion(features: Float[np.ndarray, "n d"]) -> xr.Dataset:
            return _on_floor(
                encoding.motion(
                    encoding.scaled(features), body, clip=clip, start=np.zeros(3),
                    labels=dict(labels), source="synthesised",
                )
            )  # fmt: skip

        names = encoding.layout.labels
        messages = cautions(self.fit)
        warn("the motion", messages, stacklevel=4)
        samples = encoding.unscaled(np.concatenate(np.asarray(drawn))) - climb
        return Synthesis(
            to_motion(mixture.means()), styles, angle, mixture, samples,
            Channels(names, units_of(names, body), to_motion, scale=encoding.in_units_of(body)),
            messages,
        )  # fmt: skip

    def _padded(self, styles: Styles) -> dict[str, np.ndarray]:
        """Return styles with their novel dimensions."""
        lacking = [name for name in self.factors if name not in styles]
        if lacking:
            raise InputError("synthesis", f"no style for {', '.join(lacking)}", "Give every factor")
        out = {}
        for factor in self.style_factors:
            given, whole = styles[factor.name], factor.size + factor.novel
            size = given.shape[-1]
            if size not in (factor.size, whole):
                raise InputError(
                    f"styles of {factor.name!r}",
                    f"they have {size} entries, trained ones {factor.size}",
                    f"Give {factor.size}, or {whole} with the novel dimensions",
                )
            out[factor.name] = np.pad(given, ((0, 0), (0, 0), (0, whole - size)))
        return out


def _climb(features: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " d"]:
    """Return the mean climb: the root's height is a sum of velocities, and drifts."""
    out = np.zeros(features.shape[1])
    out[-2] = features[1:, -2].mean()
    return out


def _on_floor(motion: xr.Dataset) -> xr.Dataset:
    """Put the lowest joint of the motion at height zero."""
    lowest = float(positions(motion).sel(space="y").min())
    root = motion["root_position"].copy()
    root.loc[{"space": "y"}] -= lowest
    return motion.assign(root_position=root)


def _skeleton_with(motion: xr.Dataset, labels: Mapping[str, str]) -> str | None:
    """Name the skeleton of a level, by the first label whose levels have one skeleton each."""
    bodies = motion["skeleton"].values
    for name, level in labels.items():
        of_clips = motion[name].values
        found = {one: set(bodies[of_clips == one].tolist()) for one in set(of_clips.tolist())}
        if all(len(names) == 1 for names in found.values()):
            return found[level].pop()
    return None
