"""How different two cyclic motions are, whatever phase each starts at.

A motion whose phase is known is folded onto one cycle by a least squares Fourier
series; two cycles are compared at the shift at which they agree best.
"""

import numpy as np
from jaxtyping import Float

from ..errors import InputError

HARMONICS = 5
POINTS = 60


def fold(
    features: Float[np.ndarray, "n d"],
    phase: Float[np.ndarray, " n"],
    *,
    harmonics: int = HARMONICS,
    points: int = POINTS,
) -> Float[np.ndarray, "points d"]:
    """Give one cycle of a motion, at evenly spread phases from 0 on.

    Parameters
    ----------
    features
        Features of every frame, for example the angular ones; no missing values.
    phase
        Phase of every frame in radians, running on.
    harmonics
        Of the Fourier series that is fitted by least squares.
    points
        Number of phases.

    Raises
    ------
    InputError
        If the frames do not go once round, or are too few for the series.
    """
    length = float(np.ptp(phase)) + 2 * np.pi / (2 * harmonics + 1)
    if len(phase) < 2 * harmonics + 1 or length < 2 * np.pi:
        raise InputError(
            "cycle",
            f"{len(phase)} frames cover {np.ptp(phase) / (2 * np.pi):.2f} of it",
            f"Give one whole cycle, at least {2 * harmonics + 1} frames",
        )
    weights, *_ = np.linalg.lstsq(_basis(phase, harmonics), features, rcond=None)
    return _basis(2 * np.pi * np.arange(points) / points, harmonics) @ weights


def cycle_distance(
    one: Float[np.ndarray, "points d"], other: Float[np.ndarray, "points d"]
) -> float:
    """Give the mean norm of the difference of two cycles, at the shift where it is smallest."""
    shifts = range(len(one))
    return min(
        float(np.linalg.norm(np.roll(one, shift, axis=0) - other, axis=1).mean())
        for shift in shifts
    )


def _basis(phase: Float[np.ndarray, " n"], harmonics: int) -> Float[np.ndarray, "n terms"]:
    """Give 1, cos k phase, sin k phase for k from 1 to `harmonics`."""
    angles = phase[:, None] * np.arange(1, harmonics + 1)
    return np.concatenate([np.ones((len(phase), 1)), np.cos(angles), np.sin(angles)], axis=1)
