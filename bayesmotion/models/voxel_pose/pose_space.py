"""Poses as a few numbers: angles on circles, and their principal components (Sun et al. 2006).

An angle is a point (cos, sin) of a circle, so that 359 and 1 degrees are near. Of the
points of all A angles, numbers (2A), the principal components are taken that hold a
share of the variance (eq. 1, 90 %), scaled to unit variance:

    z = S^-1 V (e - mean),    e = mean + V^T S z + rest,    angle = atan2(sin, cos)

`rest` is what the components leave out; its variance is part of every interval. Which angles
a pose has tells `joint_angles`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...errors import InputError


@dataclass(frozen=True)
class PoseSpace:
    """Principal components of poses.

    labels
        (A,) of the angles.
    mean
        (2A,) of cosines, then sines.
    components
        (P, 2A) V.
    scale
        (P,) S.
    rest
        (A, 2, 2) covariance of an angle's (cos, sin) that the components leave out.
    """

    labels: tuple[str, ...]
    mean: Float[np.ndarray, " two_a"]
    components: Float[np.ndarray, "p two_a"]
    scale: Float[np.ndarray, " p"]
    rest: Float[np.ndarray, "a 2 2"]

    def encode(self, angles: Float[np.ndarray, "frame a"]) -> Float[np.ndarray, "frame p"]:
        """Return z."""
        return (embed(angles) - self.mean) @ self.components.T / self.scale

    def decode(self, z: Float[np.ndarray, "frame p"]) -> Float[np.ndarray, "frame a"]:
        """Return the angles in radians."""
        cosine, sine = self._circles(z)
        return np.arctan2(sine, cosine)

    def sd(
        self, z: Float[np.ndarray, "frame p"], variance: Float[np.ndarray, "frame p"]
    ) -> Float[np.ndarray, "frame a"]:
        """Return standard deviations of the angles, to first order, for independent variances of z.

        In radians; where a point lies so near the middle of its circle that its angle is
        as good as unknown, no more than that of an angle drawn evenly.
        """
        cosine, sine = self._circles(z)
        square = np.maximum(cosine**2 + sine**2, 1e-6)
        A = len(self.labels)
        stretched = self.components * self.scale[:, None]
        # d angle = (cos d sin - sin d cos) / (cos^2 + sin^2)
        by = (
            cosine[:, None] * stretched[None, :, A:] - sine[:, None] * stretched[None, :, :A]
        ) / square[:, None]
        across = np.stack([-sine, cosine], axis=-1) / square[..., None]
        left = np.einsum("fai,aij,faj->fa", across, self.rest, across)
        total = np.einsum("fpa,fp->fa", by**2, variance) + left
        return np.sqrt(np.minimum(total, np.pi**2 / 3.0))

    def _circles(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        points = self.mean + z * self.scale @ self.components
        return points[:, : len(self.labels)], points[:, len(self.labels) :]


def learn_space(
    angles: Float[np.ndarray, "frame a"], labels: Sequence[str], share: float = 0.9
) -> PoseSpace:
    """Find the principal components of poses.

    Parameters
    ----------
    angles
        (N, A) in radians.
    labels
        (A,) their names.
    share
        Of the variance that the components are to hold.

    Raises
    ------
    InputError
        If the share is not between 0 and 1, or the poses are all the same.
    """
    if not 0 < share <= 1:
        raise InputError("share", f"it is {share}", "Give a share of the variance, such as 0.9")
    points = embed(angles)
    mean = points.mean(axis=0)
    _, singular, V = np.linalg.svd(points - mean, full_matrices=False)
    variance = singular**2 / len(angles)
    if variance.sum() < 1e-12:
        raise InputError("poses", "they are all the same", "Give clips in which somebody moves")
    held = np.cumsum(variance) / variance.sum()
    count = int(np.searchsorted(held, share - 1e-12)) + 1
    left = points - mean - (points - mean) @ V[:count].T @ V[:count]
    pairs = left.reshape(len(angles), 2, -1)
    rest = np.einsum("nia,nja->aij", pairs, pairs) / len(angles)
    return PoseSpace(tuple(labels), mean, V[:count], np.sqrt(variance[:count]), rest)


def embed(angles: Float[np.ndarray, "frame a"]) -> Float[np.ndarray, "frame two_a"]:
    """Return the points on circles: cosines, then sines."""
    return np.concatenate([np.cos(angles), np.sin(angles)], axis=1)
