"""The most probable trajectory of a face under a chain's normals (Brand 1999).

From the states' probabilities p(s_t | y) come positions z that with the velocities they make
are nearest to the states' normals:

    z = argmin sum_t sum_s p(s_t = s | y) ((z_t - mu_s)^T Lambda_s (z_t - mu_s)
                                           + (z_t - z_{t-1} - nu_s)^T M_s (z_t - z_{t-1} - nu_s))

which is linear: a band of blocks. A clip's first frame has no velocity.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import solveh_banded


class Normals(NamedTuple):
    """Means (K, D) and precisions (K, D, D) of the states."""

    mean: Float[np.ndarray, "k d"]
    precision: Float[np.ndarray, "k d d"]


def trajectory(
    position: Normals,
    velocity: Normals,
    occupancy: Float[np.ndarray, "t k"],
    begins: Bool[np.ndarray, " t"],
) -> Float[np.ndarray, "t d"]:
    """Return the positions z; see the module.

    Parameters
    ----------
    position, velocity
        The states' normals of z_t and of z_t - z_{t-1}.
    occupancy
        Probability of every state in every frame.
    begins
        Where clips begin.
    """
    own, target = _weighed(position, occupancy)
    fast, moved = _weighed(velocity, np.where(begins[:, None], 0.0, occupancy))
    diagonal = own + fast
    diagonal[:-1] += fast[1:]
    right = target + moved
    right[:-1] -= moved[1:]
    return _solve_band(diagonal, -fast[1:], right)


def _weighed(
    normals: Normals, occupancy: Float[np.ndarray, "t k"]
) -> tuple[Float[np.ndarray, "t d d"], Float[np.ndarray, "t d"]]:
    wanted = np.einsum("kij,kj->ki", normals.precision, normals.mean)
    return np.einsum("tk,kij->tij", occupancy, normals.precision), occupancy @ wanted


def _solve_band(
    diagonal: Float[np.ndarray, "t p p"],
    beside: Float[np.ndarray, "t1 p p"],
    right: Float[np.ndarray, "t p"],
) -> Float[np.ndarray, "t p"]:
    """Solve the symmetric block tridiagonal system."""
    t, p = right.shape
    band = np.zeros((2 * p, t * p))  # lower form: band[i - j, j] = a[i, j]
    for i in range(p):
        for j in range(p):
            if i >= j:
                band[i - j, j::p] = diagonal[:, i, j]
            band[p + i - j, j : (t - 1) * p : p] = beside[:, i, j]
    return solveh_banded(band, right.ravel(), lower=True).reshape(t, p)
