"""The poses of a cycle given its latent path and what was measured: the rest of eq. 15.

    u_td = y_td + noise_td,   y_t = f(x_t) + d_t + e_t

With the path x known all of it is normal: f has its mean there, the person's own deviation
d is matrix-normal, time x features, and e is white, as large as the process's variance is
above the usual.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..gp.linalg import AnyArray
from .latent import Measured, Represented

# Variance that what is exact has all the same, so that no covariance is singular.
TINY = 1e-8


class Deviation(NamedTuple):
    """How a new person's cycles differ from what the process makes of them.

    The deviation d (T, D) is matrix-normal, its covariance ``time x features``.

    features
        (D, D) covariance between features.
    time
        (T, T) correlation between poses of a cycle.
    usual
        Variance of the process that is counted in already: what it has above that comes
        on top.
    """

    features: Float[AnyArray, "d d"]
    time: Float[AnyArray, "t t"]
    usual: Float[AnyArray, ""]

    @property
    def white(self) -> Float[AnyArray, " d"]:
        """Variance of each feature."""
        return jnp.diagonal(jnp.asarray(self.features))


@dataclass(frozen=True)
class Pose:
    """A distribution of the poses of a cycle.

    mean, sd
        (T, D) of every feature.
    log_density
        Log density of what was measured, at the latent path found.
    """

    mean: Float[np.ndarray, "t d"]
    sd: Float[np.ndarray, "t d"]
    log_density: float


def pose_given(found: Represented, given: Measured, deviation: Deviation) -> Pose:
    """Give the poses of a cycle, given the latent path and what was measured.

    Parameters
    ----------
    found
        The latent path, and what the process says there.
    given
        What is measured.
    deviation
        What is the person's own.
    """
    # What the process has above its usual variance, no two entries share.
    above = float(np.mean(np.maximum(found.variance - float(deviation.usual), 0.0)))
    seen, noise = np.asarray(given.seen) > 0, np.asarray(given.noise) + TINY
    features, time = np.asarray(deviation.features), np.asarray(deviation.time)
    same = (seen == seen[:1]).all() and (noise == noise[:1]).all()
    if same:
        columns = np.flatnonzero(seen[0])
        residual = np.asarray(given.u)[:, columns] - found.mean[:, columns]
        parts = _by_axes(residual, columns, noise[0], above, features, time)
    else:
        residual = np.asarray(given.u) - found.mean
        parts = _by_entries(residual, seen, noise, above, features, time)
    shift, variance, log_density = parts
    return Pose(found.mean + shift, np.sqrt(np.maximum(variance, 0.0)), log_density)


Parts = tuple[np.ndarray, np.ndarray, float]


def _by_axes(
    residual: Float[np.ndarray, "t k"],
    columns: np.ndarray,
    noise: Float[np.ndarray, " d"],
    above: float,
    features: Float[np.ndarray, "d d"],
    time: Float[np.ndarray, "t t"],
) -> Parts:
    """Condition where the same features are seen all through the cycle, equally well.

    The covariance time x features + I x W, with W the variance of what is white, becomes
    diagonal by the eigenvectors of time and those of W^(-1/2) features W^(-1/2): what
    costs (T D)^3 as a whole costs T^3 + D^3.
    """
    white = noise[columns] + above
    M, P = np.linalg.eigh(time)
    shrunk = features[np.ix_(columns, columns)] / np.sqrt(white[:, None] * white)
    size, Q = np.linalg.eigh(shrunk)
    back = Q / np.sqrt(white)[:, None]
    total = M[:, None] * size[None, :] + 1.0
    turned = P.T @ residual @ back
    weights = P @ (turned / total) @ back.T
    shift = time @ weights @ features[columns]
    shift[:, columns] += above * weights
    # Covariance of what is measured with every feature, turned the same way.
    shared = back.T @ features[columns]
    own = np.zeros_like(shared)
    own[:, columns] = above * back.T
    gain = (M[:, None, None] * shared + own) ** 2 / total[:, :, None]
    explained = P**2 @ gain.sum(axis=1)
    variance = np.outer(np.diag(time), np.diag(features)) + above - explained
    logdet = np.sum(np.log(total)) + len(time) * np.sum(np.log(white))
    constant = residual.size * np.log(2.0 * np.pi)
    return shift, variance, float(-0.5 * (np.sum(turned**2 / total) + logdet + constant))


def _by_entries(
    residual: Float[np.ndarray, "t d"],
    seen: Bool[np.ndarray, "t d"],
    noise: Float[np.ndarray, "t d"],
    above: float,
    features: Float[np.ndarray, "d d"],
    time: Float[np.ndarray, "t t"],
) -> Parts:
    """Condition on whatever entries are seen, by one large covariance."""
    own = np.kron(time, features) + above * np.eye(seen.size)
    known = np.flatnonzero(seen)
    K = own[np.ix_(known, known)] + np.diag(noise.ravel()[known])
    L = np.linalg.cholesky(K)
    half = np.linalg.solve(L, residual.ravel()[known])
    gain = np.linalg.solve(L, own[known])
    variance = np.diag(own) - np.sum(gain**2, axis=0)
    constant = len(known) * np.log(2.0 * np.pi) + 2.0 * np.sum(np.log(np.diag(L)))
    shift = (gain.T @ half).reshape(seen.shape)
    return shift, variance.reshape(seen.shape), float(-0.5 * (half @ half + constant))


def white_deviation(variance: Sequence[float] | np.ndarray, poses: int) -> Deviation:
    """Give a deviation that neither time nor features share: eq. 15 as in the paper."""
    return Deviation(np.diag(np.asarray(variance, float)), np.eye(poses), np.zeros(()))
