"""Energy flow of a motion, and its minima near beats.

Perera, Kudoh and Ikeuchi, Keypose and style analysis based on low-dimensional
representation, section 3. The energy of a frame is the length of the weighted sum of the
velocities of all markers, in the global frame and in the frame of the body's centre:

    F_t = | sum_i m_i v_i(t) |                                             (eq. 1, 2)

Near every beat the minimum of F nearest to the beat is a candidate if it is low enough,
F_min <= T_1, or deep enough below the neighbouring maximum, F_max - F_min >= T_2.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import gaussian_filter1d

from ...errors import InputError


@dataclass(frozen=True)
class Thresholds:
    """T_1 (energy low enough) and T_2 (deep enough), in units of the energy."""

    low: float
    deep: float


@dataclass(frozen=True)
class Minima:
    """The energy minimum near every beat in one frame of reference.

    frame
        (B,) frame of the minimum nearest to the beat, -1 where there is none.
    energy
        (B,) F_min, NaN where there is none.
    depth
        (B,) F_max - F_min, F_max the lower one of the two neighbouring maxima.
    """

    frame: Int[np.ndarray, " b"]
    energy: Float[np.ndarray, " b"]
    depth: Float[np.ndarray, " b"]

    def kept(self, thresholds: Thresholds) -> np.ndarray:
        """Return which are candidates."""
        low, deep = self.energy <= thresholds.low, self.depth >= thresholds.deep
        return (self.frame >= 0) & (low | deep)


def energy(
    position: Float[np.ndarray, "n j 3"],
    frame_rate: float,
    *,
    weight: Float[np.ndarray, " j"] | None = None,
    smoothing: float = 0.08,
) -> Float[np.ndarray, " n"]:
    """Return the energy flow of eq. 1 or 2, by the frame that `position` is seen from.

    Parameters
    ----------
    position
        Markers or joints; for eq. 2 as `body_centred` gives them.
    frame_rate
        Frames a second.
    weight
        m_i, which are scaled to sum to one; equal by default.
    smoothing
        Standard deviation in seconds of the Gaussian that takes noise out first.

    Returns
    -------
    Speed in the unit of `position` a second; NaN in frames where a joint is missing that is
    seen in others. Joints that are never seen count for nothing.

    Raises
    ------
    InputError
        If there are fewer than three frames, no joint is seen, or a weight is negative.
    """
    weight = np.ones(position.shape[1]) if weight is None else weight
    if len(weight) != position.shape[1] or (weight < 0).any():
        raise InputError(
            "keyposes",
            f"{len(weight)} weights for {position.shape[1]} joints, or a negative one",
            "Give every joint a weight of zero or more",
        )
    seen = np.isfinite(position).all(axis=2)
    used = seen.any(axis=0) & (weight > 0)
    if len(position) < 3 or not used.any():
        raise InputError(
            "keyposes",
            "there are fewer than three frames, or no joint is seen",
            "Give a longer clip",
        )
    weight, seen, position = weight[used], seen[:, used], position[:, used]
    smooth = position if seen.all() else _filled(position, seen)
    if smoothing > 0:
        smooth = gaussian_filter1d(smooth, smoothing * frame_rate, axis=0)
    velocity = np.gradient(smooth, axis=0) * frame_rate
    flow = np.linalg.norm(np.einsum("j,njx->nx", weight / weight.sum(), velocity), axis=1)
    return np.where(seen.all(axis=1), flow, np.nan)


def body_centred(
    position: Float[np.ndarray, "n j 3"], left_hip: int, right_hip: int, waist: int
) -> Float[np.ndarray, "n j 3"]:
    """See every pose from the body's centre.

    The origin is between the hips; z points from there to the waist, x across the hips to
    the left, made perpendicular to z's plane, and y to the front.

    Parameters
    ----------
    position
        Markers or joints.
    left_hip, right_hip, waist
        Their columns; the waist is any point on the spine above the hips.

    Raises
    ------
    InputError
        If in some frame the three points lie on a line.
    """
    origin = 0.5 * (position[:, left_hip] + position[:, right_hip])
    across = _unit(position[:, left_hip] - position[:, right_hip])
    up = position[:, waist] - origin
    up = _unit(up - np.sum(up * across, axis=1, keepdims=True) * across)
    front = np.cross(up, across)
    axes = np.stack([across, front, up], axis=1)
    return np.einsum("nab,njb->nja", axes, position - origin[:, None])


def minima_near(
    energy: Float[np.ndarray, " n"], beats: Float[np.ndarray, " b"], window: float
) -> Minima:
    """Find the energy minimum nearest to every beat.

    Parameters
    ----------
    energy
        F.
    beats
        Beats in frames, not necessarily whole.
    window
        Minima at most so many frames from the beat are looked at.
    """
    lows = turning_points(energy)
    highs = turning_points(-energy)
    frame = np.full(len(beats), -1)
    low, depth = np.full(len(beats), np.nan), np.full(len(beats), np.nan)
    for b, beat in enumerate(beats):
        near = lows[np.abs(lows - beat) <= window]
        if not len(near):
            continue
        at = near[np.abs(near - beat).argmin()]
        after, before = highs[highs > at], highs[highs < at]
        ends = [before[-1] if len(before) else 0, after[0] if len(after) else len(energy) - 1]
        frame[b], low[b] = at, energy[at]
        depth[b] = energy[ends].min() - energy[at]
    return Minima(frame, low, depth)


def turning_points(energy: Float[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
    """Return the frames of local minima; of a flat stretch the last one."""
    ends = np.flatnonzero(np.append(np.diff(energy) != 0, True))
    value = energy[ends]
    low = (value[1:-1] < value[:-2]) & (value[1:-1] < value[2:])
    return ends[1:-1][low]


def _filled(
    position: Float[np.ndarray, "n j 3"], seen: Bool[np.ndarray, "n j"]
) -> Float[np.ndarray, "n j 3"]:
    """Return positions with straight lines over gaps, so that smoothing goes on beside them."""
    out, frames = position.copy(), np.arange(len(position))
    for joint, there in enumerate(seen.T):
        for axis in range(3):
            out[:, joint, axis] = np.interp(frames, frames[there], position[there, joint, axis])
    return out


def _unit(vectors: Float[np.ndarray, "n 3"]) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    if (length < 1e-9).any():
        raise InputError(
            f"frame {int(np.argmin(length))}",
            "hips and waist lie on a line",
            "Name other joints for the body's frame",
        )
    return vectors / length
