"""How the poses of gait cycles become features, and the way back to motions.

The features of a pose are the 54 components of its 18 rotation vectors, each less its
mean over the training cycles and times its lever: how many millimetres the joints move,
root mean square over all of them, when the body turns there by one radian. Distances
between features are then about distances between poses, and one noise level serves
all. All are divided by one number, which gives them a mean square of one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Float

from ...errors import InputError
from ...motion.cycles import from_vectors, joint_positions, rotation_vectors
from ...motion.dataset import skeleton_of
from ...motion.gait_skeleton import turning_joints
from ...motion.skeleton import Skeleton

# The joints that turn next to nothing with them (wrists, head) count at least so much of
# the largest lever.
LEAST_LEVER = 0.1


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
        """Return the columns of joints by name.

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
        """Return the features of cycles, frame by frame; NaN where angles are missing."""
        vectors = rotation_vectors(motion).reshape(motion.sizes["frame"], -1)
        return (vectors - self.mean) * self.lever / self.unit

    def vectors(self, y: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n joint 3"]:
        """Return the rotation vectors (radians) of features."""
        return (np.asarray(y) * self.unit / self.lever + self.mean).reshape(len(y), -1, 3)

    def positions(self, y: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n joint 3"]:
        """Return positions in mm of the joints that turn, but the root, which is the origin."""
        where = joint_positions(self.vectors(y), self.skeleton)
        turning = [self.skeleton.index(name) for name in turning_joints(self.skeleton)[1:]]
        return where[:, turning]

    def motion(
        self, y: Float[np.ndarray, "n d"], clip: str, labels: dict[str, str] | None = None
    ) -> xr.Dataset:
        """Return a Motion of features."""
        return from_vectors(self.vectors(y), self.skeleton, clip=clip, labels=labels or {})


def learn_cycle_encoding(motion: xr.Dataset) -> CycleEncoding:
    """Learn the encoding from training cycles on one skeleton.

    Raises
    ------
    InputError
        If a joint is seen in no pose.
    """
    skeleton = skeleton_of(motion)
    vectors = rotation_vectors(motion)
    flat = vectors.reshape(len(vectors), -1)
    never = np.flatnonzero(~np.isfinite(flat).any(axis=0))
    if len(never):
        joint = turning_joints(skeleton)[never[0] // 3]
        raise InputError(
            "training cycles", f"{joint!r} is missing in all of them", "Add cycles that have it"
        )
    mean = np.nanmean(flat, axis=0)
    lever = levers(mean, skeleton)
    unit = float(np.sqrt(np.nanmean(((flat - mean) * lever) ** 2)))
    return CycleEncoding(skeleton, mean, lever, unit)


def levers(mean: Float[np.ndarray, " d"], skeleton: Skeleton) -> Float[np.ndarray, " d"]:
    """Return the root mean square displacement of the joints, in mm a radian of each component."""
    small = 1e-3
    turned = np.concatenate([mean + small * np.eye(len(mean)), mean - small * np.eye(len(mean))])
    where = joint_positions(turned.reshape(len(turned), -1, 3), skeleton)
    moved = (where[: len(mean)] - where[len(mean) :]) / (2.0 * small)
    size = np.sqrt(np.mean(np.sum(moved**2, axis=-1), axis=-1))
    return np.maximum(size, LEAST_LEVER * size.max())
