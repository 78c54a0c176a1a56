"""Gait cycles as a joint gait-pose model sees them, and the way back to motions.

The features of a pose are the 54 components of its 18 rotation vectors, each less its
mean over the training cycles and times its lever: how many millimetres the joints move,
root mean square over all of them, when the body turns there by one radian. Distances
between features are then about distances between poses, and one noise level serves
all. All are divided by one number, which gives them a mean square of one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from ..errors import InputError
from ..gp.linalg import AnyArray
from ..gp.matrix_normal import Patterns, patterns
from ..motion.cycles import diversified, from_vectors, joint_positions, rotation_vectors
from ..motion.dataset import skeleton_of
from ..motion.gait_skeleton import turning_joints
from ..motion.joining import concat, split
from ..motion.skeleton import Skeleton
from ..priors.dynamics import Steps, steps_of
from ..priors.topology import Surface, Topology

# The joints that turn next to nothing with them (wrists, head) count at least so much of
# the largest lever.
LEAST_LEVER = 0.1


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Cycles:
    """What a gait-pose model is given: N poses of cycles, in the order (layer, gait, pose).

    y
        (N, D) scaled features, zero where not seen.
    missing
        Which entries are seen.
    start
        (N, Q) latent points to begin from: the ideal surface, or principal components.
    topology
        Neighbours and weights of the surface; those of a model without one say nothing.
    normaliser
        Log of the constant of the topology's density.
    steps
        First pose of each cycle, and the pairs of poses that follow each other.
    surface
        The ideal surface, None without one (static).
    """

    y: Float[AnyArray, "n d"]
    missing: Patterns
    start: Float[AnyArray, "n q"]
    topology: Topology
    normaliser: Float[AnyArray, ""]
    steps: Steps
    surface: Surface | None = field(metadata={"static": True})


@dataclass(frozen=True)
class CycleEncoding:
    """How the poses of cycles become features of unit size, learned from training cycles.

    skeleton
        The one body.
    mean
        (D,) radians.
    lever
        (D,) millimetres a radian.
    unit
        Millimetres that are one.
    """

    skeleton: Skeleton
    mean: Float[np.ndarray, " d"]
    lever: Float[np.ndarray, " d"]
    unit: float

    @property
    def labels(self) -> list[str]:
        """Labels of the features, ``joint/x``."""
        return [f"{joint}/{axis}" for joint in turning_joints(self.skeleton) for axis in "xyz"]

    def columns(self, joints: Sequence[str]) -> list[int]:
        """Give the features of joints by name.

        Raises
        ------
        InputError
            If a joint is not one of those that turn.
        """
        known = turning_joints(self.skeleton)
        for joint in joints:
            if joint not in known:
                raise InputError(
                    f"joint {joint!r}", "it does not turn", f"Use some of {', '.join(known)}"
                )
        return [3 * known.index(joint) + axis for joint in joints for axis in range(3)]

    def scaled(self, motion: xr.Dataset) -> Float[np.ndarray, "n d"]:
        """Features of cycles, in the order of their frames."""
        vectors = rotation_vectors(motion).reshape(motion.sizes["frame"], -1)
        return (vectors - self.mean) * self.lever / self.unit

    def vectors(self, y: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n joint 3"]:
        """Rotation vectors of features."""
        return (np.asarray(y) * self.unit / self.lever + self.mean).reshape(len(y), -1, 3)

    def positions(self, y: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n joint 3"]:
        """Positions in mm of the joints that turn, but the root, which is the origin."""
        where = joint_positions(self.vectors(y), self.skeleton)
        turning = [self.skeleton.index(name) for name in turning_joints(self.skeleton)[1:]]
        return where[:, turning]

    def motion(
        self, y: Float[np.ndarray, "n d"], clip: str, labels: dict[str, str] | None = None
    ) -> xr.Dataset:
        """Make a Motion of features."""
        return from_vectors(self.vectors(y), self.skeleton, clip=clip, labels=labels or {})


def learn_cycle_encoding(motion: xr.Dataset) -> CycleEncoding:
    """Learn the encoding from training cycles on one skeleton."""
    skeleton = skeleton_of(motion)
    vectors = rotation_vectors(motion)
    flat = vectors.reshape(len(vectors), -1)
    mean = flat.mean(axis=0)
    lever = levers(mean, skeleton)
    unit = float(np.sqrt(np.mean(((flat - mean) * lever) ** 2)))
    return CycleEncoding(skeleton, mean, lever, unit)


def levers(mean: Float[np.ndarray, " d"], skeleton: Skeleton) -> Float[np.ndarray, " d"]:
    """Root mean square displacement of the joints, in mm a radian of each component."""
    small = 1e-3
    turned = np.concatenate([mean + small * np.eye(len(mean)), mean - small * np.eye(len(mean))])
    where = joint_positions(turned.reshape(len(turned), -1, 3), skeleton)
    moved = (where[: len(mean)] - where[len(mean) :]) / (2.0 * small)
    size = np.sqrt(np.mean(np.sum(moved**2, axis=-1), axis=-1))
    return np.maximum(size, LEAST_LEVER * size.max())


@dataclass(frozen=True)
class GaitTraining:
    """Training cycles as a gait-pose model sees them.

    encoding
        How poses become features.
    frames
        The arrays for the program.
    gaits
        Names of the cycles in their order along the surface.
    subjects
        The person of each.
    scales
        Of the layers.
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
        return len(self.frames.start) // (len(self.gaits) * len(self.scales))

    def ideal(self) -> Float[np.ndarray, "n q"]:
        """Points of the ideal surface, or where the latent points of a model without began."""
        return np.asarray(self.frames.start)

    def index(self) -> Int[np.ndarray, "n 3"]:
        """Layer, gait and pose of every row."""
        shape = (len(self.scales), len(self.gaits), self.poses)
        return np.stack(np.unravel_index(np.arange(int(np.prod(shape))), shape), axis=1)

    def observed(self) -> xr.Dataset:
        """What the model explains: scaled features ``y`` (frame, feature), NaN where not seen."""
        frames = self.frames
        seen = np.einsum("pn,pd->nd", frames.missing.rows, frames.missing.columns) > 0
        layer, gait, pose = self.index().T
        labels: dict[str, Any] = {
            "feature": self.encoding.labels,
            "gait": ("frame", np.asarray(self.gaits)[gait]),
            "scale": ("frame", np.asarray(self.scales)[layer]),
            "pose": ("frame", pose),
        }
        y = (("frame", "feature"), np.where(seen, frames.y, np.nan))
        return xr.Dataset({"y": y}, labels)

    def constants(self) -> xr.Dataset:
        """What brings features back to radians."""
        encoding = self.encoding
        values = {"mean": ("feature", encoding.mean), "lever": ("feature", encoding.lever)}
        return xr.Dataset({**values, "unit": encoding.unit}, {"feature": encoding.labels})


def layered(motion: xr.Dataset, scales: Sequence[float]) -> xr.Dataset:
    """Give the cycles at every scale, layer after layer.

    Raises
    ------
    InputError
        If scales do not grow, cycles differ in their number of poses, or angles are missing.
    """
    if not np.isfinite(motion["angle"].values).all():
        raise InputError(
            "training cycles", "angles are missing", "Train on complete cycles, without the others"
        )
    if list(scales) != sorted(set(scales)):
        raise InputError(f"scales {list(scales)}", "they do not grow", "Give each once, in order")
    sizes = {clip: part.sizes["frame"] for clip, part in split(motion).items()}
    if len(set(sizes.values())) != 1:
        raise InputError(
            "training cycles", f"they have {sorted(set(sizes.values()))} poses", "Cut all alike"
        )
    return concat([diversified(motion, scale) for scale in scales])


def gait_distances(y: Float[np.ndarray, "g p d"]) -> Float[np.ndarray, "g g"]:
    """Distance of gaits: root mean square over poses of the same phase."""
    square = np.sum((y[:, None] - y[None]) ** 2, axis=-1)
    return np.sqrt(square.mean(axis=-1))


def make_cycles(
    y: Float[np.ndarray, "n d"],
    start: Float[np.ndarray, "n q"],
    topology: Topology,
    normaliser: float,
    sizes: Sequence[int],
    surface: Surface | None,
) -> Cycles:
    """Put the arrays of training cycles together; NaN in `y` is what was not seen."""
    seen = np.isfinite(y)
    return Cycles(
        np.where(seen, y, 0.0),
        patterns(seen),
        start,
        topology,
        np.asarray(normaliser),
        steps_of(sizes),
        surface,
    )


def no_topology(n: int, q: int) -> Topology:
    """Give a topology that says nothing."""
    return Topology(np.zeros((n, 1), int), np.zeros((q, n, 1)), np.zeros(q))
