"""Low-dimensional motion: a clip in the space of the first components of its keyposes.

Perera, Kudoh and Ikeuchi, section 4. From K poses (keyposes, or as many sampled uniformly)

    mean = sum_k pose_k / K                                                      (eq. 4)
    components = right singular vectors of the poses less their mean
    low-dimensional pose = mean + components components^T (pose - mean)      (eq. 7, 8)
    variance covered = sum of the first eigenvalues / sum of all                 (eq. 9)

and any frame between keyposes is brought into the same space. Poses are the features of
`bayesmotion.motion.features` (exponential maps and angles), so that what comes out is a
motion of the same skeleton; the root keeps its path.
"""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from ..errors import InputError
from ..motion.dataset import skeleton_of
from ..motion.features import decode, encode, layout_of
from ..motion.joining import split
from ..motion.skeleton import Skeleton


@dataclass(frozen=True)
class Components:
    """Mean, components and eigenvalues of poses.

    mean
        (D,).
    basis
        (D, R) orthonormal columns, R at most one less than the number of poses.
    variance
        (R,) eigenvalues (variances over the poses).
    """

    mean: Float[np.ndarray, " d"]
    basis: Float[np.ndarray, "d r"]
    variance: Float[np.ndarray, " r"]

    def covered(self) -> Float[np.ndarray, " r"]:
        """Share of the variance that the first 1, 2, .. components cover (eq. 9)."""
        return np.cumsum(self.variance) / self.variance.sum()

    def low_dimensional(
        self, poses: Float[np.ndarray, "n d"], size: int
    ) -> Float[np.ndarray, "n d"]:
        """Return poses in the space of the first `size` components (eq. 7 and 8)."""
        if not 1 <= size <= self.basis.shape[1]:
            raise InputError(
                "low-dimensional motion",
                f"{size} dimensions were asked for",
                f"Ask for 1 to {self.basis.shape[1]}",
            )
        basis = self.basis[:, :size]
        return self.mean + (poses - self.mean) @ basis @ basis.T


def components(poses: Float[np.ndarray, "k d"]) -> Components:
    """Return the principal components of poses.

    Raises
    ------
    InputError
        If there are fewer than two poses, or they are all alike.
    """
    mean = poses.mean(axis=0)
    _, singular, right = np.linalg.svd(poses - mean, full_matrices=False)
    rank = int((singular > 1e-10 * max(float(singular[0]), 1e-300)).sum()) if len(singular) else 0
    if len(poses) < 2 or rank == 0 or singular[0] == 0:
        raise InputError("components", "the poses are all alike", "Give poses that differ")
    return Components(mean, right[:rank].T, np.square(singular[:rank]) / len(poses))


def low_dimensional(motion: xr.Dataset, keyposes: Int[np.ndarray, " k"], size: int) -> xr.Dataset:
    """Return a clip in the space of the first `size` components of its keyposes.

    Parameters
    ----------
    motion
        One clip with joint angles.
    keyposes
        Frames of its keyposes, at least two.
    size
        Dimensions, at most one less than there are keyposes.

    Raises
    ------
    InputError
        If there are too few keyposes for so many dimensions.
    """
    (clip,) = split(motion)
    skeleton: Skeleton = skeleton_of(motion)
    layout = layout_of(skeleton, leave_out=())
    features = encode(motion, layout)
    poses = features[:, : layout.n_angles]
    low = components(poses[keyposes]).low_dimensional(poses, size)
    angle = motion["angle"]
    return decode(
        np.concatenate([low, features[:, layout.n_angles :]], axis=1),
        layout,
        skeleton,
        frame_rate=float(motion.attrs["frame_rate"]),
        clip=clip,
        start=motion["root_position"].values[0],
        rest={str(dof): float(angle.sel(dof=dof).values[0]) for dof in angle["dof"].values},
        source=f"{size} dimensions of {clip}",
    )
