"""Several views of the same frames, made into what a shared latent model is given.

A data set of views has one variable (frame, feature) for every view, such as sound and
face, and the text coordinate ``clip`` on ``frame``; frames of a clip follow each other.
Every column is scaled to zero mean and unit spread over the training frames.

The view that holds the back-constraint is looked at through a window: frame t sees the
frames t - w to t + w of its clip, those farther off less, by exp(-(lag / taper)^2 / 2);
beyond its ends the first and the last frame of a clip go on. Features count less the later
they stand, by exp(-(number / lifter)^2 / 2): of cepstra those that tell fine detail of the
spectrum. Principal components of these windows, each of the size it has, are what the map
gets.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from ..errors import InputError
from ..gp.linalg import AnyArray
from ..priors.dynamics import Steps, steps_of


class Views(NamedTuple):
    """Frames of all clips, one after another, as the program sees them.

    y
        For every view (N, D), scaled.
    seen
        (N, F) what the back-constraint is a function of; F = 0 without one.
    centres
        (H, F) some of these.
    clip
        (N,) number of every frame's clip.
    steps
        Which frame follows which.
    inducing, step_inducing
        (M,) frames, and (M',) steps, at which processes have their inducing points.
    """

    y: Mapping[str, Float[AnyArray, "n _"]]
    seen: Float[AnyArray, "n f"]
    centres: Float[AnyArray, "h f"]
    clip: Int[AnyArray, " n"]
    steps: Steps
    inducing: Int[AnyArray, " m"]
    step_inducing: Int[AnyArray, " m_steps"]


@dataclass(frozen=True)
class Look:
    """How a clip is looked at.

    width, taper
        Frames on either side, w, and how far off they count.
    lifter
        How many features count.
    components
        At most so many principal components, F.
    """

    width: int = 0
    taper: float = 3.0
    lifter: float = 10.0
    components: int = 80

    def __call__(self, scaled: Float[np.ndarray, "t d"]) -> Float[np.ndarray, "t wd"]:
        """Give every frame with those around it."""
        weight = np.exp(-0.5 * (np.arange(scaled.shape[1]) / self.lifter) ** 2)
        padded = np.pad(scaled * weight, ((self.width, self.width), (0, 0)), mode="edge")
        lags = np.arange(-self.width, self.width + 1)
        near = np.exp(-0.5 * (lags / self.taper) ** 2)
        shifted = [padded[self.width + lag :][: len(scaled)] for lag in lags]
        return np.concatenate([w * part for w, part in zip(near, shifted, strict=True)], axis=1)


@dataclass(frozen=True)
class Window:
    """What the back-constraint sees of a clip: principal components of what it looks at.

    basis
        ((2 w + 1) D, F) principal components, by columns, over the size they have together.
    middle
        ((2 w + 1) D,) mean of the windows.
    """

    look: Look
    basis: Float[np.ndarray, "wd f"]
    middle: Float[np.ndarray, " wd"]

    def __call__(self, scaled: Float[np.ndarray, "t d"]) -> Float[np.ndarray, "t f"]:
        """Look at a clip of scaled features."""
        return (self.look(scaled) - self.middle) @ self.basis


@dataclass(frozen=True)
class ViewEncoding:
    """How the features of views are scaled, and what the back-constraint sees.

    mean, spread
        For every view (D,).
    labels
        For every view the names of its features.
    back
        The view with the back-constraint and its window; None without one.
    """

    mean: Mapping[str, Float[np.ndarray, " _"]]
    spread: Mapping[str, Float[np.ndarray, " _"]]
    labels: Mapping[str, Sequence[str]]
    back: tuple[str, Window] | None

    def scaled(self, view: str, features: Float[np.ndarray, "t d"]) -> Float[np.ndarray, "t d"]:
        """Scale features (T, D) of a view.

        Raises
        ------
        InputError
            If their number is not that of training, or one is missing.
        """
        if features.ndim != 2 or features.shape[1] != len(self.mean[view]):
            raise InputError(
                view,
                f"its features have the shape {features.shape}",
                f"Give frames of {len(self.mean[view])} features, as in training",
            )
        if not np.isfinite(features).all():
            raise InputError(view, "features are missing", "Leave those frames out")
        return (features - self.mean[view]) / self.spread[view]

    def restored(self, view: str, scaled: Float[AnyArray, "t d"]) -> Float[np.ndarray, "t d"]:
        """Bring scaled features back to their units."""
        return self.mean[view] + np.asarray(scaled) * self.spread[view]


@dataclass(frozen=True)
class SharedTraining:
    """Training clips as a shared latent model sees them."""

    encoding: ViewEncoding
    frames: Views
    clips: tuple[str, ...]

    @property
    def data(self) -> tuple[Views]:
        """The arguments of the model's program."""
        return (self.frames,)

    def observed(self) -> xr.Dataset:
        """What the model explains: the scaled views."""
        clip = np.asarray(self.clips)[np.asarray(self.frames.clip)]
        parts = {name: (("frame", f"{name}_feature"), y) for name, y in self.frames.y.items()}
        labels = {f"{name}_feature": list(self.encoding.labels[name]) for name in parts}
        return xr.Dataset(parts, {**labels, "clip": ("frame", clip)})

    def constants(self) -> xr.Dataset:
        """What brings views back to their units."""
        encoding, found = self.encoding, {}
        for name in self.frames.y:
            found[f"{name}_mean"] = (f"{name}_feature", encoding.mean[name])
            found[f"{name}_spread"] = (f"{name}_feature", encoding.spread[name])
        labels = {f"{name}_feature": list(encoding.labels[name]) for name in self.frames.y}
        return xr.Dataset(found, labels)


def prepare_views(
    data: xr.Dataset,
    views: Sequence[str],
    *,
    back: str | None,
    look: Look,
    inducing: int,
    centres: int,
    every: int,
) -> SharedTraining:
    """Make a data set of views into arrays; see the module for what it holds.

    Parameters
    ----------
    data
        Training clips.
    views
        Names of its variables that are views.
    back
        The view with the back-constraint.
    look
        How that is looked at.
    inducing, centres
        How many frames hold inducing points, and how many centres there are.
    every
        Only every so many frames of a clip are explained; windows see all of them.

    Raises
    ------
    InputError
        If a view is not there or has missing features, clips are not whole, or there are
        not two frames.
    """
    clips, sizes = _clips(data)
    if every < 1 or min(sizes) <= every:
        raise InputError("every", f"it is {every}", "Give 1, or fewer than a clip has frames")
    encoding = _learn(data, views)
    y = {name: encoding.scaled(name, _features(data, name)) for name in views}
    seen = np.zeros((sum(sizes), 0))
    if back is not None:
        bounds = np.cumsum(sizes)[:-1]
        parts = np.split(y[back], bounds)
        window = _learn_window(parts, look)
        encoding = ViewEncoding(encoding.mean, encoding.spread, encoding.labels, (back, window))
        seen = np.concatenate([window(part) for part in parts])
    centre = seen[_spread_out(len(seen), centres)]
    kept = np.concatenate([np.arange(size) % every == 0 for size in sizes])
    sizes = [-(-size // every) for size in sizes]
    frames = Views(
        {name: features[kept] for name, features in y.items()}, seen[kept], centre,
        np.repeat(np.arange(len(sizes)), sizes), steps_of(sizes),
        _spread_out(sum(sizes), inducing), _spread_out(sum(sizes) - len(sizes), inducing),
    )  # fmt: skip
    return SharedTraining(encoding, frames, clips)


def _spread_out(n: int, count: int) -> Int[np.ndarray, " m"]:
    """Give `count` of n rows at even distances, all where there are no more."""
    return np.unique(np.linspace(0, n - 1, min(n, count)).round().astype(int))


def _clips(data: xr.Dataset) -> tuple[tuple[str, ...], list[int]]:
    if "clip" not in data.coords or data["clip"].dims != ("frame",):
        raise InputError("views", "there is no coordinate clip on frame", "Name every frame's clip")
    clip = data["clip"].values.astype(str)
    starts = np.flatnonzero(np.r_[True, clip[1:] != clip[:-1]])
    names, sizes = clip[starts], np.diff(np.r_[starts, len(clip)])
    if len(set(names)) != len(names) or sizes.min() < 2:
        raise InputError(
            "views", "a clip is in pieces or has one frame", "Put a clip's frames together"
        )
    return tuple(map(str, names)), [int(size) for size in sizes]


def _features(data: xr.Dataset, name: str) -> Float[np.ndarray, "n d"]:
    if name not in data or data[name].dims[:1] != ("frame",) or data[name].ndim != 2:
        known = ", ".join(map(str, data.data_vars)) or "none"
        raise InputError(name, "there is no such view (frame, feature)", f"There are: {known}")
    return np.asarray(data[name].values, dtype=float)


def _learn(data: xr.Dataset, views: Sequence[str]) -> ViewEncoding:
    mean, spread, labels = {}, {}, {}
    for name in views:
        features = _features(data, name)
        mean[name], spread[name] = features.mean(axis=0), features.std(axis=0)
        if np.isfinite(features).all() and not spread[name].min() > 0:
            raise InputError(name, "a feature never changes", "Leave it out")
        labels[name] = [str(label) for label in data[data[name].dims[1]].values]
    return ViewEncoding(mean, spread, labels, None)


def _learn_window(parts: Sequence[np.ndarray], look: Look) -> Window:
    every = np.concatenate([look(part) for part in parts])
    middle = every.mean(axis=0)
    size, directions = np.linalg.eigh(np.cov((every - middle).T))
    order = np.argsort(size)[::-1][: look.components]
    together = np.sqrt(np.mean(np.maximum(size[order], 0.0)))
    return Window(look, directions[:, order] / together, middle)
