"""Gait cycles as the program of a gait-pose model sees them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from ...distributions.dynamics import Steps, steps_of
from ...distributions.topology import Surface, Topology, log_normaliser
from ...errors import InputError
from ...gp.linalg import AnyArray
from ...gp.matrix_normal import Patterns, patterns
from ...model import Units
from ...motion.joining import split
from .encoding import CycleEncoding, learn_cycle_encoding
from .settings import Around, LatentSpace
from .surfaces import LatentStart, latent_start, order_along


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Cycles:
    """What a gait-pose model is given: N poses of cycles of T poses each.

    Training cycles are in the order (layer, gait, pose).

    y
        (N, D) scaled features, zero where not seen.
    missing
        Which entries are seen.
    steps
        First pose of each cycle, and the pairs of poses that follow each other.
    start
        (N, Q) latent points to begin from, the ideal surface or principal components; None
        of new cycles.
    topology, normaliser
        Neighbours and weights of points around a surface, and the log of the constant of
        their density; None without.
    surface
        The ideal surface, None without one (static).
    """

    y: Float[AnyArray, "n d"]
    missing: Patterns
    steps: Steps
    start: Float[AnyArray, "n q"] | None = None
    topology: Topology | None = None
    normaliser: Float[AnyArray, ""] | None = None
    surface: Surface | None = field(default=None, metadata={"static": True})

    @property
    def poses(self) -> int:
        """T, poses of a cycle."""
        return self.y.shape[0] // self.steps.first.shape[0]


@dataclass(frozen=True)
class GaitData:
    """Cycles as a gait-pose model sees them.

    encoding
        How poses become features.
    frames
        The arrays for the program.
    gaits
        Names of the cycles, of training cycles in their order along the surface.
    subjects
        The person of each.
    scales
        Of the layers, one of new cycles.
    """

    encoding: CycleEncoding
    frames: Cycles
    gaits: tuple[str, ...]
    subjects: tuple[str, ...]
    scales: tuple[float, ...]

    @property
    def data(self) -> tuple[Cycles]:
        """The arguments of the model's program."""
        return (self.frames,)

    @property
    def surface(self) -> Surface | None:
        """The ideal surface, None for a model without one."""
        return self.frames.surface

    @property
    def poses(self) -> int:
        """Poses of a cycle."""
        return self.frames.poses

    def ideal(self) -> Float[np.ndarray, "n q"]:
        """Return the ideal surface, or where the latent points of a model without one began.

        Raises
        ------
        InputError
            If these are new cycles.
        """
        if self.frames.start is None:
            raise InputError("new cycles", "they lie on no surface", "Give the training cycles")
        return np.asarray(self.frames.start)

    def index(self) -> Int[np.ndarray, "n 3"]:
        """Return layer, gait and pose of every row."""
        shape = (len(self.scales), len(self.gaits), self.poses)
        return np.stack(np.unravel_index(np.arange(int(np.prod(shape))), shape), axis=1)

    def seen(self) -> np.ndarray:
        """Return which entries (N, D) are seen."""
        missing = self.frames.missing
        return np.einsum("pn,pd->nd", missing.rows, missing.columns) > 0

    def complete_cycles(self) -> np.ndarray:
        """Return for every cycle, layer after layer, whether nothing of it is missing."""
        return self.seen().reshape(len(self.frames.steps.first), -1).all(axis=1)

    def observed(self) -> xr.Dataset:
        """Return what is explained: scaled features ``y`` (frame, feature), NaN where missing."""
        layer, gait, pose = self.index().T
        labels: dict[str, Any] = {
            "feature": self.encoding.labels,
            "gait": ("frame", np.asarray(self.gaits)[gait]),
            "scale": ("frame", np.asarray(self.scales)[layer]),
            "pose": ("frame", pose),
        }
        y = (("frame", "feature"), np.where(self.seen(), self.frames.y, np.nan))
        return xr.Dataset({"y": y}, labels)

    def constants(self) -> xr.Dataset:
        """Return what brings features back to radians."""
        encoding = self.encoding
        values = {"mean": ("feature", encoding.mean), "lever": ("feature", encoding.lever)}
        return xr.Dataset({**values, "unit": encoding.unit}, {"feature": encoding.labels})

    def units(self) -> dict[str, Units]:
        """Return how features become rotation vectors in radians."""
        encoding = self.encoding
        return {"y": Units(encoding.mean, encoding.unit / encoding.lever)}


def prepare_training(
    motion: xr.Dataset, surface: LatentSpace, scales: tuple[float, ...]
) -> GaitData:
    """Make training cycles into arrays, at every one of the scales.

    Raises
    ------
    InputError
        If the cycles are not on one skeleton, or differ in their number of poses.
    """
    encoding = learn_cycle_encoding(motion)
    names, subject, poses = _cycles_in(motion)
    recorded = encoding.scaled(motion).reshape(len(names), poses, -1)
    # Gaits are ordered by what was recorded, the same in all layers.
    order = order_along(surface, gait_distances(recorded))
    y = layered(recorded[order], scales).reshape(len(scales) * len(names) * poses, -1)
    start = latent_start(surface, y, poses, len(names), scales)
    frames = make_cycles(y, [poses] * (len(scales) * len(names)), start, surface)
    gaits, subjects = (tuple(each[i] for i in order) for each in (names, subject))
    return GaitData(encoding, frames, gaits, subjects, scales)


def prepare_new(motion: xr.Dataset, trained: GaitData) -> GaitData:
    """Make new cycles into arrays, in the units of the training cycles.

    Raises
    ------
    InputError
        If they have not as many poses as the training cycles.
    """
    names, subject, poses = _cycles_in(motion)
    if poses != trained.poses:
        raise InputError(
            "new cycles",
            f"they have {poses} poses, the training cycles {trained.poses}",
            f"Cut them with cycles_of(motion, poses={trained.poses})",
        )
    y = trained.encoding.scaled(motion)
    seen = np.isfinite(y)
    frames = Cycles(
        np.where(seen, y, 0.0),
        patterns(seen, trained.frames.missing),
        steps_of([poses] * len(names)),
    )
    return GaitData(trained.encoding, frames, tuple(names), tuple(subject), (1.0,))


def make_cycles(
    y: Float[np.ndarray, "n d"], sizes: Sequence[int], start: LatentStart, surface: LatentSpace
) -> Cycles:
    """Return the arrays of training cycles of so many poses each; NaN in `y` is missing."""
    seen, normaliser = np.isfinite(y), None
    if isinstance(surface, Around):
        assert start.topology is not None
        normaliser = np.asarray(log_normaliser(start.topology, surface.sigma, surface.latent_sd))
    return Cycles(
        np.where(seen, y, 0.0), patterns(seen), steps_of(sizes),
        start.x, start.topology, normaliser, start.surface,
    )  # fmt: skip


def layered(y: Float[np.ndarray, "g p d"], scales: Sequence[float]) -> Float[np.ndarray, "s g p d"]:
    """Return cycles at every scale, each about its mean (eq. 5).

    Features are linear in the components of rotation vectors, so that theirs is the same.
    """
    seen = np.isfinite(y)
    count = np.maximum(seen.sum(axis=1, keepdims=True), 1)
    mean = np.where(seen, y, 0.0).sum(axis=1, keepdims=True) / count
    return np.stack([y if scale == 1.0 else mean + scale * (y - mean) for scale in scales])


def gait_distances(y: Float[np.ndarray, "g p d"]) -> Float[np.ndarray, "g g"]:
    """Return distances of gaits: root mean square over poses of the same phase.

    Features missing in either are taken to differ as the others do; gaits that share none
    are as far apart as the farthest.
    """
    seen = np.isfinite(y)
    filled = np.where(seen, y, 0.0)
    both = seen[:, None] & seen[None]
    square = np.sum(both * (filled[:, None] - filled[None]) ** 2, axis=(2, 3))
    share = both.mean(axis=(2, 3))
    apart = np.sqrt(square / np.where(share > 0, share, 1.0) / y.shape[1])
    return np.where(share > 0, apart, apart.max())


def _cycles_in(motion: xr.Dataset) -> tuple[list[str], list[str], int]:
    """Return names of cycles, the person of each, and how many poses all have."""
    parts = split(motion)
    sizes = {part.sizes["frame"] for part in parts.values()}
    if len(sizes) != 1:
        raise InputError("cycles", f"they have {sorted(sizes)} poses", "Cut all alike")
    subjects = [str(part["subject"].values[0]) for part in parts.values()]
    return list(map(str, parts)), subjects, sizes.pop()
