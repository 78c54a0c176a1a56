"""Clips of sound and face made into what voice puppetry is given.

A data set of views has the variables (frame, feature) of sound and face, and the text
coordinate ``clip`` on ``frame``. Features are scaled to zero mean and unit standard deviation
over the training frames. The face's velocity, a frame's features less those of the frame
before, is an output of its own; a clip's first frame has none. NaN is missing and
marginalised; of new recordings a view may be left out altogether.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from ...errors import InputError
from ...gp.linalg import AnyArray
from ...model import Units
from .hidden_markov import Rows, row_patterns

VELOCITY = "_velocity"


class Frames(NamedTuple):
    """Frames of all clips, one after another, as the program sees them.

    y
        For every output (N, D), scaled, NaN where missing.
    rows
        For every output which entries are seen.
    begins
        (N,) where clips begin.
    """

    y: Mapping[str, Float[AnyArray, "n _"]]
    rows: Mapping[str, Rows]
    begins: Bool[AnyArray, " n"]


@dataclass(frozen=True)
class PuppetryData:
    """Clips as voice puppetry sees them."""

    frames: Frames
    scaling: Mapping[str, Units]
    labels: Mapping[str, list[str]]
    clip: list[str]

    @property
    def data(self) -> tuple[Frames]:
        """The arguments of the model's program."""
        return (self.frames,)

    def observed(self) -> xr.Dataset:
        """Return the scaled outputs, NaN where missing."""
        parts = {name: (("frame", f"{name}_feature"), np.asarray(y))
                 for name, y in self.frames.y.items()}  # fmt: skip
        labels = {f"{name}_feature": list(self.labels[name]) for name in parts}
        return xr.Dataset(parts, {**labels, "clip": ("frame", self.clip)})

    def constants(self) -> xr.Dataset:
        """Return what brings outputs back to their units."""
        found = {}
        for name, (location, scale) in self.scaling.items():
            found[f"{name}_mean"] = (f"{name}_feature", location)
            found[f"{name}_sd"] = (f"{name}_feature", scale)
        return xr.Dataset(found, {f"{name}_feature": list(v) for name, v in self.labels.items()})

    def units(self) -> dict[str, Units]:
        """Return mean and standard deviation of every output's features."""
        return dict(self.scaling)


def prepare_clips(
    recordings: xr.Dataset, face: str, audio: str, velocity: bool, trained: PuppetryData | None
) -> PuppetryData:
    """Make clips into arrays; see the module.

    Raises
    ------
    InputError
        If a view is not there or never changes in training, features are not those of
        training, or there is no coordinate clip.
    """
    if "clip" not in recordings.coords or recordings["clip"].dims != ("frame",):
        raise InputError("views", "there is no coordinate clip on frame", "Name every frame's clip")
    clip = recordings["clip"].values.astype(str)
    begins = np.r_[True, clip[1:] != clip[:-1]]
    raw: dict[str, np.ndarray] = {}
    labels: dict[str, list[str]] = {}
    for name in (face, audio):
        raw[name], labels[name] = _features(recordings, name, trained)
        if velocity and name == face:
            steps = np.diff(raw[name], axis=0, prepend=np.nan)
            raw[name + VELOCITY] = np.where(begins[:, None], np.nan, steps)
            labels[name + VELOCITY] = [f"{label} velocity" for label in labels[name]]
    scaling = {name: _scale(name, part) for name, part in raw.items()} if trained is None else (
        dict(trained.scaling)
    )  # fmt: skip
    y = {name: (part - scaling[name].location) / scaling[name].scale for name, part in raw.items()}
    rows = {name: row_patterns(~np.isnan(part)) for name, part in y.items()}
    return PuppetryData(Frames(y, rows, begins), scaling, labels, clip.tolist())


def _features(
    recordings: xr.Dataset, name: str, trained: PuppetryData | None
) -> tuple[Float[np.ndarray, "n d"], list[str]]:
    if name not in recordings and trained is not None:
        labels = list(trained.labels[name])
        return np.full((recordings.sizes["frame"], len(labels)), np.nan), labels
    if name not in recordings or recordings[name].dims[:1] != ("frame",):
        known = ", ".join(map(str, recordings.data_vars)) or "none"
        raise InputError(name, "there is no such view (frame, feature)", f"There are: {known}")
    features = np.asarray(recordings[name].values, dtype=float)
    if trained is not None and features.shape[1] != len(trained.labels[name]):
        raise InputError(
            name, f"its features have the shape {features.shape}",
            f"Use frames of {len(trained.labels[name])} features, as in training",
        )  # fmt: skip
    return features, [str(label) for label in recordings[recordings[name].dims[1]].values]


def _scale(name: str, features: Float[np.ndarray, "n d"]) -> Units:
    if (np.sum(~np.isnan(features), axis=0) < 2).any():
        raise InputError(name, "a feature is hardly ever seen", "Leave it out")
    mean, sd = np.nanmean(features, axis=0), np.nanstd(features, axis=0)
    if not sd.min() > 0:
        raise InputError(name, "a feature never changes", "Leave it out")
    return Units(mean, sd)
