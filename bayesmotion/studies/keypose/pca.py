"""Principal components of keyposes beside others: uniform samples, and probabilistic PCA.

The probabilistic form of `bayesmotion.tasks.low_dimensional` is Tipping and Bishop's (1999),
with flat priors:

    pose ~ Normal(mean, W W^T + noise^2 I),    W (D, Q)

Its mode has W W^T = V (L - noise^2) V^T, noise^2 the mean of the eigenvalues left out, with
V and L the first components and eigenvalues (variances over K) of the classical solution.
"""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
import numpyro
from numpyro import distributions as dist
from numpyro.distributions import constraints

from ...gp.linalg import AnyArray


def uniform_frames(frames: int, count: int, offset: float = 0.5) -> np.ndarray:
    """Return frames at equal steps; `offset` (0 to 1) is the share of a step before them."""
    return np.floor((offset + np.arange(count)) * frames / count).astype(int)


@dataclass(frozen=True)
class ProbabilisticPCA:
    """Probabilistic principal components with flat priors; see the module.

    Parameters
    ----------
    size
        Q, columns of W.
    """

    size: int
    name = "ppca"

    def program(self, poses: AnyArray) -> None:
        """The generative program."""
        d = poses.shape[1]
        mean = numpyro.sample("mean", dist.ImproperUniform(constraints.real, (), (d,)))
        W = numpyro.sample("W", dist.ImproperUniform(constraints.real, (), (d, self.size)))
        log_noise = numpyro.sample("log_noise", dist.ImproperUniform(constraints.real, (), ()))
        diagonal = jnp.exp(2.0 * log_noise) * jnp.ones(d)
        with numpyro.plate("pose", poses.shape[0]):
            numpyro.sample("y", dist.LowRankMultivariateNormal(mean, W, diagonal), obs=poses)
