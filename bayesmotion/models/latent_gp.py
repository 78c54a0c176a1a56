"""A trained Gaussian process from latent points to poses, made ready for many new points.

With K = U diag(l) U^T the training covariance without noise, and K_* that of new points
with the training points,

    mean     = K_* (K + noise I)^-1 Y,    noise = 1 / beta + personal
    variance = k_** - | K_* U diag(1 / (l + noise))^(1/2) |^2.

1 / beta is what training poses are off a function that may follow every one of them. What
is a training person's own (`personal`) is noise to somebody new.

K of points on a surface has few eigenvalues of any size. The variance goes by the
largest `RANK` of them, which takes the cost of a new point from N^2 to N RANK, and can only
be too large for it, next to nothing near training points.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse.linalg import eigsh

from ..gp.kernels import Kernel
from ..gp.linalg import AnyArray
from .gait_cycles import Cycles

RANK = 192


class LatentGP(NamedTuple):
    """What latent points say about poses; the interface is that of `tasks.latent`.

    kernel
        Covariance without noise, on the factor ``x``.
    x
        (N, Q) training points.
    weights
        (N, D): the mean is K_* weights.
    root
        (N, r): K_* root explains the variance.
    noise
        Variance of a feature about the function.
    bend
        (Q,) standard deviation of x_(t-1) - 2 x_t + x_(t+1) along the training cycles.
    paths
        (C, T, Q) latent paths of the training cycles conditioned on, some of them twice.
    """

    kernel: Kernel
    x: Float[AnyArray, "n q"]
    weights: Float[AnyArray, "n d"]
    root: Float[AnyArray, "n r"]
    noise: Float[AnyArray, ""]
    bend: Float[AnyArray, " q"]
    paths: Float[AnyArray, "c t q"]

    @property
    def candidates(self) -> Float[AnyArray, "c t q"]:
        """Latent paths where a search for that of a new cycle may begin."""
        return self.paths

    def predict(self, x: Float[AnyArray, "m q"]) -> tuple[Float[Array, "m d"], Float[Array, "m d"]]:
        """Mean (M, D) of poses at latent points and the variance (M, D), of all features alike.

        The noise is not in it.
        """
        x = jnp.asarray(x)
        cross = self.kernel.matrix({"x": x}, {"x": jnp.asarray(self.x)})
        one = {"x": jnp.zeros(x.shape[1])}
        explained = jnp.sum((cross @ jnp.asarray(self.root)) ** 2, axis=1)
        variance = jnp.maximum(self.kernel(one, one) - explained, 0.0)
        mean = cross @ jnp.asarray(self.weights)
        return mean, jnp.broadcast_to(variance[:, None], mean.shape)

    def log_prior(self, x: Float[AnyArray, "m q"]) -> Float[Array, ""]:
        """Log density, up to a constant, of the latent path of one whole cycle.

        It bends as training cycles do, and closes.
        """
        bend = jnp.roll(x, 1, axis=0) - 2.0 * x + jnp.roll(x, -1, axis=0)
        return -0.5 * jnp.sum((bend / self.bend) ** 2)


def latent_gp(
    kernel_of: Callable[[Mapping[str, AnyArray]], Kernel],
    cycles: Cycles,
    values: Mapping[str, AnyArray],
    chosen: np.ndarray | None = None,
    personal: float = 0.0,
) -> LatentGP:
    """Make the process of trained values, of all training poses or of some.

    Parameters
    ----------
    kernel_of
        Makes the kernel of hyperparameters.
    cycles
        Training data, nothing missing.
    values
        Trained sites.
    chosen
        Numbers of the training cycles conditioned on, all where None. The arrays are as
        large whatever is chosen, so that one compilation serves all choices.
    personal
        Variance of what is a person's own.
    """
    first = np.asarray(cycles.steps.first)
    poses = len(cycles.y) // len(first)
    kept = np.arange(len(first)) if chosen is None else chosen
    rows = (first[kept][:, None] + np.arange(poses)).ravel()
    x = np.asarray(values["x"])
    kernel, noise = kernel_of(values), 1.0 / float(values["beta"]) + personal
    there = jnp.asarray(x[rows])
    K = np.asarray(kernel.matrix({"x": there}, {"x": there}))
    weights = np.zeros_like(np.asarray(cycles.y))
    noisy = K + noise * np.eye(len(K))
    weights[rows] = cho_solve(cho_factor(noisy, lower=True), np.asarray(cycles.y)[rows])
    explains = np.zeros((len(x), RANK))
    root = _root(K, noise)
    explains[rows, : root.shape[1]] = root
    # A cycle that is not conditioned on is no place to begin from: one that is stands for it.
    paths = x.reshape(len(first), poses, -1)[np.resize(kept, len(first))]
    return LatentGP(kernel, x, weights, explains, np.asarray(noise), _bend(cycles, values), paths)


def _root(K: Float[np.ndarray, "n n"], noise: float) -> Float[np.ndarray, "n r"]:
    """Largest eigenvectors of K, each by the root of what it takes from a variance."""
    if len(K) <= 2 * RANK:
        size, U = np.linalg.eigh(K)
        size, U = size[-RANK:], U[:, -RANK:]
    else:
        size, U = eigsh(K, RANK, v0=np.ones(len(K)))
    return U / np.sqrt(np.maximum(size, 0.0) + noise)


def _bend(cycles: Cycles, values: Mapping[str, AnyArray]) -> Float[np.ndarray, " q"]:
    """Root mean square of the second differences along training cycles, which close."""
    x = np.asarray(values["x"])
    parts = np.split(x, np.asarray(cycles.steps.first)[1:])
    bends = [np.roll(p, 1, axis=0) - 2.0 * p + np.roll(p, -1, axis=0) for p in parts]
    return np.sqrt(np.mean(np.concatenate(bends) ** 2, axis=0))
