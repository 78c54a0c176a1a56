"""Low-dimensional motion from keyposes: principal components, classical and probabilistic.

Perera, Kudoh and Ikeuchi, section 4. From K poses (keyposes, or as many sampled uniformly)

    mean = sum_k pose_k / K                                                      (eq. 4)
    components = right singular vectors of the poses less their mean
    low-dimensional pose = mean + components components^T (pose - mean)      (eq. 7, 8)
    variance covered = sum of the first eigenvalues / sum of all                 (eq. 9)

and any frame between keyposes is brought into the same space. The probabilistic form is
Tipping and Bishop's (1999), with flat priors:

    pose ~ Normal(mean, W W^T + noise^2 I),    W (D, Q)

Its mode has W W^T = V (L - noise^2) V^T, noise^2 the mean of the eigenvalues left out, with
V and L the first components and eigenvalues (variances over K) of the classical solution.
"""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
import numpyro
from jaxtyping import Float
from numpyro import distributions as dist
from numpyro.distributions import constraints

from ..errors import InputError
from ..gp.linalg import AnyArray


@dataclass(frozen=True)
class Components:
    """Mean, components and eigenvalues of poses.

    mean
        (D,).
    basis
        (D, R) orthonormal columns, R at most one less than the number of poses.
    variance
        (R,) eigenvalues (variances over the poses).
    """

    mean: Float[np.ndarray, " d"]
    basis: Float[np.ndarray, "d r"]
    variance: Float[np.ndarray, " r"]

    def covered(self) -> Float[np.ndarray, " r"]:
        """Share of the variance that the first 1, 2, .. components cover (eq. 9)."""
        return np.cumsum(self.variance) / self.variance.sum()

    def low_dimensional(
        self, poses: Float[np.ndarray, "n d"], size: int
    ) -> Float[np.ndarray, "n d"]:
        """Give poses in the space of the first `size` components (eq. 7 and 8)."""
        if not 1 <= size <= self.basis.shape[1]:
            raise InputError(
                "low-dimensional motion",
                f"{size} dimensions were asked for",
                f"Ask for 1 to {self.basis.shape[1]}",
            )
        basis = self.basis[:, :size]
        return self.mean + (poses - self.mean) @ basis @ basis.T


def components(poses: Float[np.ndarray, "k d"]) -> Components:
    """Give the principal components of poses.

    Raises
    ------
    InputError
        If there are fewer than two poses, or they are all alike.
    """
    mean = poses.mean(axis=0)
    _, singular, right = np.linalg.svd(poses - mean, full_matrices=False)
    rank = int((singular > 1e-10 * max(float(singular[0]), 1e-300)).sum()) if len(singular) else 0
    if len(poses) < 2 or rank == 0 or singular[0] == 0:
        raise InputError("components", "the poses are all alike", "Give poses that differ")
    return Components(mean, right[:rank].T, np.square(singular[:rank]) / len(poses))


def uniform_frames(frames: int, count: int, offset: float = 0.5) -> np.ndarray:
    """Give `count` frames at equal steps; `offset` (0 to 1) is the share of a step before them."""
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
