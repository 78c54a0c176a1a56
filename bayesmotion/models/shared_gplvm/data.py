"""Several views of the same frames, made into what a shared latent model is given.

A data set of views has one variable (frame, feature) for every view, such as sound and
face, and the text coordinate ``clip`` on ``frame``; frames of a clip follow each other.
Every column is scaled to zero mean and unit standard deviation over the training frames.
NaN is missing and marginalised; of new recordings a view may be left out altogether.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from ...distributions.dynamics import Steps, steps_of
from ...errors import InputError
from ...gp.linalg import AnyArray
from ...gp.matrix_normal import Patterns, patterns
from ...model import Units
from .window import WindowComponents, learn_components

if TYPE_CHECKING:
    from .program import SharedGPLVM


class Views(NamedTuple):
    """Frames of all clips, one after another, as the program sees them.

    y
        For every view (N, D), scaled, NaN where missing.
    missing
        For every view which of its entries are seen, by pattern.
    inputs
        (N, F) what the back-constraint is a function of; F = 0 without one.
    centres
        (H, F) some of these.
    kept
        (n,) the frames that the density is of; others serve predictions alone.
    clip
        (n,) number of every kept frame's clip.
    steps
        Which kept frame follows which.
    inducing, step_inducing
        (M,) kept frames, and (M',) steps, at which processes have their inducing points; none
        where densities are exact.
    """

    y: Mapping[str, Float[AnyArray, "n _"]]
    missing: Mapping[str, Patterns]
    inputs: Float[AnyArray, "n f"]
    centres: Float[AnyArray, "h f"]
    kept: Int[AnyArray, " k"]
    clip: Int[AnyArray, " k"]
    steps: Steps
    inducing: Int[AnyArray, " m"]
    step_inducing: Int[AnyArray, " m_steps"]

    @property
    def exact(self) -> bool:
        """Whether densities are exact."""
        return self.inducing.shape[0] == 0

    def kept_of(self, view: str) -> tuple[Float[AnyArray, "k d"], Patterns]:
        """Return a view's kept frames, and which of their entries are seen."""
        missing, kept = self.missing[view], self.kept
        return self.y[view][kept], missing._replace(rows=missing.rows[:, kept])


@dataclass(frozen=True)
class ViewEncoding:
    """How the features of views are scaled, and what the back-constraint sees.

    mean, sd
        For every view (D,).
    labels
        For every view the names of its features.
    back
        The view with the back-constraint and its window; None without one.
    """

    mean: Mapping[str, Float[np.ndarray, " _"]]
    sd: Mapping[str, Float[np.ndarray, " _"]]
    labels: Mapping[str, Sequence[str]]
    back: tuple[str, WindowComponents] | None

    def scaled(self, view: str, features: Float[np.ndarray, "t d"]) -> Float[np.ndarray, "t d"]:
        """Return features (T, D) of a view, scaled.

        Raises
        ------
        InputError
            If their number is not that of training.
        """
        if features.shape[1] != len(self.mean[view]):
            raise InputError(
                view,
                f"its features have the shape {features.shape}",
                f"Use frames of {len(self.mean[view])} features, as in training",
            )
        return (features - self.mean[view]) / self.sd[view]


@dataclass(frozen=True)
class SharedData:
    """Clips as a shared latent model sees them."""

    encoding: ViewEncoding
    frames: Views
    clips: tuple[str, ...]

    @property
    def data(self) -> tuple[Views]:
        """The arguments of the model's program."""
        return (self.frames,)

    @property
    def clip_names(self) -> list[str]:
        """The clip of every kept frame."""
        return [self.clips[number] for number in np.asarray(self.frames.clip)]

    def observed(self) -> xr.Dataset:
        """Return what the model explains: the scaled views, NaN where missing."""
        kept = np.asarray(self.frames.kept)
        parts = {
            name: (("frame", f"{name}_feature"), np.asarray(y)[kept])
            for name, y in self.frames.y.items()
        }
        labels = {f"{name}_feature": list(self.encoding.labels[name]) for name in parts}
        return xr.Dataset(parts, {**labels, "clip": ("frame", self.clip_names)})

    def constants(self) -> xr.Dataset:
        """Return what brings views back to their units."""
        encoding, found = self.encoding, {}
        for name in self.frames.y:
            found[f"{name}_mean"] = (f"{name}_feature", encoding.mean[name])
            found[f"{name}_sd"] = (f"{name}_feature", encoding.sd[name])
        labels = {f"{name}_feature": list(encoding.labels[name]) for name in self.frames.y}
        return xr.Dataset(found, labels)

    def units(self) -> dict[str, Units]:
        """Return mean and standard deviation of every view's features."""
        return {name: Units(self.encoding.mean[name], self.encoding.sd[name])
                for name in self.frames.y}  # fmt: skip


def prepare_views(
    model: "SharedGPLVM", recordings: xr.Dataset, trained: SharedData | None
) -> SharedData:
    """Make a data set of views into arrays; see the module for what it holds.

    Parameters
    ----------
    model
        Whose settings say what is made.
    recordings
        Clips.
    trained
        The training clips, in whose units new ones are described; all frames of new ones are
        explained.

    Raises
    ------
    InputError
        If a view is not there or is never seen in training, features are not those of
        training, or clips are not whole.
    """
    clips, sizes = _clips(recordings)
    encoding = _learned(recordings, model, sizes) if trained is None else trained.encoding
    y = {name: _scaled(recordings, name, encoding, sum(sizes)) for name in model.views}
    inputs = np.zeros((sum(sizes), 0))
    if encoding.back is not None:
        view, components = encoding.back
        parts = np.split(y[view], np.cumsum(sizes)[:-1])
        inputs = np.concatenate([components(part) for part in parts])
    before = None if trained is None else trained.frames.missing
    missing = {
        name: patterns(~np.isnan(part), None if before is None else before[name])
        for name, part in y.items()
    }
    kept, sizes = _kept(sizes, model.every if trained is None else 1)
    points = 0
    if trained is None and model.inducing is not None and len(kept) > model.inducing.above:
        points = model.inducing.points
    hidden = 0 if model.back is None else model.back.map.hidden
    frames = Views(
        y, missing, inputs, inputs[evenly(len(inputs), hidden)], kept,
        np.repeat(np.arange(len(sizes)), sizes), steps_of(sizes),
        evenly(len(kept), points), evenly(len(kept) - len(sizes), points),
    )  # fmt: skip
    return SharedData(encoding, frames, clips)


def evenly(n: int, count: int) -> Int[np.ndarray, " m"]:
    """Return `count` of n rows at even distances, all where there are no more."""
    return np.unique(np.linspace(0, n - 1, min(n, count)).round().astype(int))


def _kept(sizes: list[int], every: int) -> tuple[Int[np.ndarray, " k"], list[int]]:
    if min(sizes) <= every and every > 1:
        raise InputError("every", f"it is {every}", "Use fewer than a clip has frames")
    chosen = np.concatenate([np.arange(size) % every == 0 for size in sizes])
    return np.flatnonzero(chosen), [-(-size // every) for size in sizes]


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


def _scaled(
    data: xr.Dataset, name: str, encoding: ViewEncoding, frames: int
) -> Float[np.ndarray, "n d"]:
    """Scale a view's features; a view that new recordings do not have is missing."""
    if name not in data:
        return np.full((frames, len(encoding.mean[name])), np.nan)
    return encoding.scaled(name, _features(data, name))


def _learned(data: xr.Dataset, model: "SharedGPLVM", sizes: list[int]) -> ViewEncoding:
    mean, sd, labels = {}, {}, {}
    for name in model.views:
        features = _features(data, name)
        if not (~np.isnan(features)).any(axis=0).all():
            raise InputError(name, "a feature is never seen", "Leave it out")
        mean[name], sd[name] = np.nanmean(features, axis=0), np.nanstd(features, axis=0)
        if not sd[name].min() > 0:
            raise InputError(name, "a feature never changes", "Leave it out")
        labels[name] = [str(label) for label in data[data[name].dims[1]].values]
    encoding = ViewEncoding(mean, sd, labels, None)
    if model.back is None:
        return encoding
    view = model.back.view
    clips = np.split(encoding.scaled(view, _features(data, view)), np.cumsum(sizes)[:-1])
    return ViewEncoding(mean, sd, labels, (view, learn_components(clips, model.back.window)))
