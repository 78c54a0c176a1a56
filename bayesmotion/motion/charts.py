"""Rotations of joints as vectors about a slow path of their own.

The three angles of a joint are the rotation R_t = S_t exp([w_t]), with S the mean rotation, or,
where a joint turns far from that, its path over a fifth of a second or so. The vectors w are the
same in whatever order the angles stand and wherever the body heads: S turns with R.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation, Slerp

from .euler import euler_angles
from .skeleton import Skeleton

# A joint that turns farther from its mean (radians) goes along a path, smooth over so few seconds
# that it does not lag behind a fast turn where a gap begins; over fewer where it turns faster.
FAR, SLOW_S, LEAST_S = 2.0, 0.15, 0.03
STEP = 1e-5  # radians, of differences


@dataclass(frozen=True)
class Chart:
    """Of one joint: the columns of its angles, their order, and its slow path (N)."""

    columns: Int[np.ndarray, " 3"]
    order: str
    path: Rotation

    def vectors(self, angle: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Return w of angles in radians, NaN where one is missing."""
        out, seen = np.full(angle.shape, np.nan), np.isfinite(angle).all(axis=1)
        turn = Rotation.from_euler(self.order, angle[seen])
        out[seen] = (self.path[np.flatnonzero(seen)].inv() * turn).as_rotvec()
        return out

    def angles(
        self, vectors: Float[np.ndarray, "n 3"], near: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, "n 3"]:
        """Return the angles in radians that are nearest to some, of all that are this rotation."""
        one = euler_angles(self.path * Rotation.from_rotvec(vectors), self.order)
        other = np.stack([one[:, 0] + np.pi, np.pi - one[:, 1], one[:, 2] + np.pi], axis=1)
        each = np.stack([one, other])
        each = each - 2.0 * np.pi * np.round((each - near) / (2.0 * np.pi))
        chosen = np.abs(each - near).sum(axis=2).argmin(axis=0)
        return each[chosen, np.arange(len(near))]

    def sds(
        self, vectors: Float[np.ndarray, "n 3"], sd: Float[np.ndarray, "n 3"],
        angle: Float[np.ndarray, "n 3"],
    ) -> Float[np.ndarray, "n 3"]:  # fmt: skip
        """Return the sd of the angles, to first order, where vectors have an sd."""
        variance = np.zeros(angle.shape)
        for axis in np.eye(3):
            moved = self.angles(vectors + STEP * axis, angle)
            variance += ((moved - angle) / STEP) ** 2 * (sd @ axis)[:, None] ** 2
        return np.sqrt(variance)


@dataclass(frozen=True)
class Charts:
    """Of all joints of three angles; what other joints have stays as it is."""

    angle: Float[np.ndarray, "n d"]
    each: tuple[Chart, ...]

    @classmethod
    def of(
        cls, skeleton: Skeleton, dofs: Sequence[str], angle: Float[np.ndarray, "n d"], rate: float
    ) -> "Charts":
        """Return those of a recording.

        Parameters
        ----------
        skeleton
            Of the body.
        dofs, angle
            Labels, and angles in radians without jumps of whole turns; NaN where missing. A joint
            of which now one and now another angle is missing keeps its angles.
        rate
            Frames a second.
        """
        labels, charts = list(dofs), []
        for joint in skeleton:
            own = [f"{joint.name}/{channel}" for channel in joint.channels]
            if len(own) != 3 or not set(own) <= set(labels):
                continue
            columns = np.array([labels.index(label) for label in own])
            seen = np.isfinite(angle[:, columns])
            if (seen.any(axis=1) != seen.all(axis=1)).any():
                continue
            order = "".join(channel[1].upper() for channel in joint.channels)
            path = _path(Rotation.from_euler(order, angle[seen.all(axis=1)][:, columns]),
                         np.flatnonzero(seen.all(axis=1)), len(angle), rate)  # fmt: skip
            charts.append(Chart(columns, order, path))
        return cls(_without_gaps(angle), tuple(charts))

    def vectors(self, angle: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
        """Return angles with vectors in the columns of joints that have charts."""
        out = angle.copy()
        for chart in self.each:
            out[:, chart.columns] = chart.vectors(angle[:, chart.columns])
        return out

    def angles(
        self, vectors: Float[np.ndarray, "n d"], sd: Float[np.ndarray, "n d"]
    ) -> tuple[Float[np.ndarray, "n d"], Float[np.ndarray, "n d"]]:
        """Return angles in radians on the turns that were recorded, and their sds."""
        out, sds = vectors.copy(), sd.copy()
        for chart in self.each:
            at = chart.columns
            out[:, at] = chart.angles(vectors[:, at], self.angle[:, at])
            sds[:, at] = chart.sds(vectors[:, at], sd[:, at], out[:, at])
        return out, sds


def _path(turn: Rotation, frames: Int[np.ndarray, " s"], count: int, rate: float) -> Rotation:
    """Return the mean of rotations that are seen at some frames, or a slow path through them."""
    mean = turn.mean()
    path = Rotation.from_matrix(np.repeat(mean.as_matrix()[None], count, axis=0))
    seconds = SLOW_S
    while (path[frames].inv() * turn).magnitude().max() > FAR and seconds > LEAST_S:
        path = _smooth(turn, frames, count, seconds * rate)
        seconds /= 2.0
    return path


def _smooth(turn: Rotation, frames: Int[np.ndarray, " s"], count: int, width: float) -> Rotation:
    """Return the mean of rotations over some frames about each; gaps are crossed the short way."""
    total = np.zeros((count, 3, 3))
    total[frames] = turn.as_matrix()
    left, _, right = np.linalg.svd(gaussian_filter1d(total, width, axis=0, mode="constant")[frames])
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    path = Rotation.from_matrix(left @ right)
    if len(frames) == 1:
        return Rotation.from_matrix(np.repeat(path.as_matrix(), count, axis=0))
    return Slerp(frames, path)(np.arange(count).clip(frames[0], frames[-1]))


def _without_gaps(angle: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
    """Return angles with straight lines through their gaps."""
    out, at = angle.copy(), np.arange(len(angle))
    for column in out.T:
        seen = np.isfinite(column)
        column[~seen] = np.interp(at[~seen], at[seen], column[seen])
    return out
