"""A trained Gaussian process from latent points to poses, made ready for many new points.

With K = U diag(l) U^T the training covariance without noise, and K_* that of new points
with the training points,

    mean     = K_* U diag(1 / (l + 1 / beta)) U^T Y
    variance = k_** - | K_* U diag(1 / (l + 1 / beta))^(1/2) |^2.

K of points on a surface has few eigenvalues of any size. In the variance, as many are
used as make up all but a thousandth of their sum: that takes the cost of a new point from
N^2 to N r, and makes the variance about a thousandth of the kernel's too large.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..gp.kernels import Kernel
from ..gp.linalg import AnyArray
from .gait_cycles import Cycles

SHARE = 1e-3


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
        (C, T, Q) latent paths of the training cycles conditioned on.
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
        Numbers of the training cycles conditioned on, all where None.
    """
    first = np.asarray(cycles.steps.first)
    poses = len(cycles.y) // len(first)
    kept = np.arange(len(first)) if chosen is None else chosen
    rows = (first[kept][:, None] + np.arange(poses)).ravel()
    x, y = np.asarray(values["x"])[rows], np.asarray(cycles.y)[rows]
    paths = x.reshape(len(kept), poses, -1)
    kernel, noise = kernel_of(values), 1.0 / jnp.asarray(values["beta"])
    K = kernel.matrix({"x": jnp.asarray(x)}, {"x": jnp.asarray(x)})
    size, U = np.linalg.eigh(np.asarray(K))
    root = U / np.sqrt(np.maximum(size, 0.0) + float(noise))
    weights = root @ (root.T @ y)
    used = np.cumsum(np.maximum(size, 0.0)) > SHARE * np.sum(np.maximum(size, 0.0))
    root = root[:, used]
    return LatentGP(kernel, x, weights, root, noise, _bend(cycles, values), paths)


def _bend(cycles: Cycles, values: Mapping[str, AnyArray]) -> Float[np.ndarray, " q"]:
    """Root mean square of the second differences along training cycles, which close."""
    x = np.asarray(values["x"])
    parts = np.split(x, np.asarray(cycles.steps.first)[1:])
    bends = [np.roll(p, 1, axis=0) - 2.0 * p + np.roll(p, -1, axis=0) for p in parts]
    return np.sqrt(np.mean(np.concatenate(bends) ** 2, axis=0))
