"""Measures of a motion in the terms of people who know motion.

    range <joint>   largest minus smallest angle of each degree of freedom, degrees
    period          of the gait, from the spectrum of the angles, s
    foot sliding    mean horizontal speed of the lowest foot joint, m/s
    speed           of the root over the ground, m/s

Lengths are in the skeleton's own unit where it does not say how long that is. Frames in which
something is missing (NaN) are left out of what needs them.
"""

import re

import numpy as np
import xarray as xr
from jaxtyping import Float

from ..motion.dataset import skeleton_of
from ..motion.kinematics import positions

FEET = re.compile("foot|toe|heel", re.IGNORECASE)
# Gaits have between so many cycles a second.
CYCLES_PER_SECOND = (0.4, 2.5)


def statistics(motion: xr.Dataset) -> dict[str, float]:
    """Measure the motion of one clip with joint angles; what cannot be measured is NaN."""
    skeleton, rate = skeleton_of(motion), float(motion.attrs["frame_rate"])
    metres = 1.0 if skeleton.metres is None else skeleton.metres
    angle = _unwrapped(motion["angle"].values)
    extent = np.degrees(_extent(angle))
    moving = extent > 0.0
    dofs = motion["dof"].values[moving]
    ranges = {f"range {dof}": float(e) for dof, e in zip(dofs, extent[moving], strict=True)}
    where = positions(motion).transpose("frame", "joint", "space") * metres
    feet = [name for name in where["joint"].values if FEET.search(str(name))]
    travelled = np.diff(motion["root_position"].values[:, [0, 2]], axis=0) * metres
    return {
        **ranges,
        "period": period(angle[:, moving], rate),
        "foot sliding": _sliding(where.sel(joint=feet).values, rate),
        "speed": _mean(np.linalg.norm(travelled, axis=1)) * rate,
    }


def period(angle: Float[np.ndarray, "n d"], frame_rate: float) -> float:
    """Return the period (s) with the most power over all columns, NaN where nothing is seen.

    Of the periodogram under a Hann window; missing entries are filled in by straight lines.
    """
    seen = np.isfinite(angle).sum(axis=0) > 1
    if not np.any(seen):
        return float("nan")
    y = np.stack([_filled(column) for column in angle[:, seen].T], axis=1)
    n = len(y)
    low, high = (2.0 * np.pi * f / frame_rate for f in CYCLES_PER_SECOND)
    # Slower than one and a half cycles in the clip cannot be told from a drift.
    frequencies = np.linspace(min(max(low, 3.0 * np.pi / n), high), high, 400)
    window = np.hanning(n + 2)[1:-1]
    centred = (y - np.average(y, axis=0, weights=window)) * window[:, None]
    power = np.abs(np.exp(-1j * frequencies[:, None] * np.arange(n)) @ centred) ** 2
    return float(2.0 * np.pi / (frequencies[np.argmax(power.sum(axis=1))] * frame_rate))


def _sliding(feet: Float[np.ndarray, "n f 3"], rate: float) -> float:
    """Mean horizontal speed of the foot joint that is lowest, frame by frame."""
    heights = feet[:-1, :, 1]
    whole = np.isfinite(heights).all(axis=1)
    if feet.shape[1] == 0 or not np.any(whole):
        return float("nan")
    moved = np.diff(feet[:, :, [0, 2]], axis=0)[whole]
    lowest = np.argmin(heights[whole], axis=1)
    return _mean(np.linalg.norm(moved[np.arange(len(lowest)), lowest], axis=1)) * rate


def _unwrapped(angle: np.ndarray) -> np.ndarray:
    """Take turns out of angles, across frames that are missing too."""
    out = angle.copy()
    for column in out.T:
        seen = np.isfinite(column)
        column[seen] = np.unwrap(column[seen])
    return out


def _extent(angle: np.ndarray) -> np.ndarray:
    """Largest minus smallest of every column, 0 where nothing is seen."""
    seen = np.isfinite(angle)
    high = np.where(seen, angle, -np.inf).max(axis=0)
    low = np.where(seen, angle, np.inf).min(axis=0)
    return np.where(seen.any(axis=0), high - low, 0.0)


def _filled(column: np.ndarray) -> np.ndarray:
    seen = np.flatnonzero(np.isfinite(column))
    return np.interp(np.arange(len(column)), seen, column[seen])


def _mean(values: np.ndarray) -> float:
    """Mean of what is there, NaN where nothing is."""
    there = values[np.isfinite(values)]
    return float(there.mean()) if there.size else float("nan")
