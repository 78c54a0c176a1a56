"""Recognised poses made smooth over time, which the paper does without.

Every output z of the regression is taken for a measurement, with the regression's
variance, of a path with a Gaussian process prior of unit variance:

    z_t = f(t) + e_t,    f ~ GP(0, Matern 5/2 of time),    e_t ~ N(0, variance_t)

The slowness of the paths, one for all outputs, is the likeliest for the poses that trained.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int

from ...gp.kernels import matern
from ...gp.linalg import cholesky, inverse_factor, require_finite

# Length scales tried, in seconds, and the variance of what is not smooth in true poses.
LENGTHS = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
ROUGH = 1e-3


def _covariance(time: Float[np.ndarray, " f"], length: float) -> Float[np.ndarray, "f f"]:
    points: Mapping[str, np.ndarray] = {"time": time[:, None]}
    kernel = matern("time", 2.5, length_scale=length)
    return np.asarray(kernel.matrix(dict(points), dict(points)))


def likeliest_length(
    z: Float[np.ndarray, "f p"], time: Float[np.ndarray, " f"], clip: Int[np.ndarray, " f"]
) -> float:
    """Find which of `LENGTHS` makes the poses of training clips likeliest.

    Parameters
    ----------
    z
        Outputs (F, P) of true poses, of unit variance.
    time, clip
        (F,) seconds within its clip, and number of the clip, of every frame.
    """
    scores = []
    for length in LENGTHS:
        total = 0.0
        for one in np.unique(clip):
            rows = clip == one
            K = _covariance(time[rows], length) + ROUGH * np.eye(int(rows.sum()))
            inverse = np.asarray(inverse_factor(cholesky(K)))
            require_finite(inverse, "smoothing")
            total += z.shape[1] * np.log(np.diag(inverse)).sum()
            total -= 0.5 * ((inverse @ z[rows]) ** 2).sum()
        scores.append(total)
    return LENGTHS[int(np.argmax(scores))]


def smooth(
    z: Float[np.ndarray, "f p"],
    variance: Float[np.ndarray, "f p"],
    time: Float[np.ndarray, " f"],
    clip: Int[np.ndarray, " f"],
    length: float,
) -> tuple[Float[np.ndarray, "f p"], Float[np.ndarray, "f p"]]:
    """Return means and variances of the paths.

    Parameters
    ----------
    z, variance
        (F, P) as the regression gives them.
    time, clip
        As for `likeliest_length`; nothing links frames across clips.
    length
        Length scale in seconds.
    """
    mean, left = np.empty_like(z), np.empty_like(variance)
    for one in np.unique(clip):
        rows = np.flatnonzero(clip == one)
        K = _covariance(time[rows], length)
        for p in range(z.shape[1]):
            inverse = np.asarray(inverse_factor(cholesky(K + np.diag(variance[rows, p]))))
            require_finite(inverse, "smoothing")
            gain = inverse @ K
            mean[rows, p] = gain.T @ (inverse @ z[rows, p])
            left[rows, p] = np.maximum(np.diag(K) - (gain**2).sum(axis=0), 0.0)
    return mean, left
