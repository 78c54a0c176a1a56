"""Outputs whose weights are integrated out, and what they say of the weights.

With W_bm ~ N(0, 1 / alpha_b) the columns of outputs are independent,

    y_m ~ N(0, sigma_m^2 I + Phi diag(1 / alpha) Phi^T),

and given the rows o that are seen of a column its weights are normal with precision and mean

    A_m = diag(alpha) + Phi_o^T Phi_o / sigma_m^2,    A_m^-1 Phi_o^T y_om / sigma_m^2.

Matrices are factorised in units of the prior, where no eigenvalue is below one.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.linalg import solve_triangular
from jaxtyping import Array, Float, PRNGKeyArray
from numpyro import distributions as dist

from ....gp.linalg import AnyArray, cholesky, inverse_factor
from ....prediction import NormalEntries

LOG_2PI = 1.8378770664093453


class MarginalOutputs(dist.Distribution):
    """Columns y_m ~ N(loc_m, F_m F_m^T + sigma_m^2 I); NaN in a value is integrated out.

    Parameters
    ----------
    loc
        (N, M).
    factor
        F, (M, N, R) or one for all columns (1, N, R).
    noise
        (M,) sigma^2.
    """

    pytree_data_fields = ("loc", "factor", "noise")

    def __init__(
        self,
        loc: Float[AnyArray, "n m"],
        factor: Float[AnyArray, "g n r"],
        noise: Float[AnyArray, " m"],
    ) -> None:
        self.loc, self.factor, self.noise = map(jnp.asarray, (loc, factor, noise))
        super().__init__((), loc.shape)

    @property
    def support(self) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Matrices of real numbers."""
        return dist.constraints.real_matrix

    def sample(self, key: PRNGKeyArray, sample_shape: tuple[int, ...] = ()) -> Array:
        """Draw the outputs."""
        weight_key, noise_key = jax.random.split(key)
        factor = jnp.broadcast_to(self.factor, (len(self.noise), *self.factor.shape[1:]))
        white = jax.random.normal(weight_key, (*sample_shape, len(factor), factor.shape[2]))
        signal = jnp.einsum("mnr,...mr->...nm", factor, white)
        noise = jax.random.normal(noise_key, (*sample_shape, *self.loc.shape))
        return self.loc + signal + jnp.sqrt(self.noise) * noise

    def log_prob_parts(self, value: AnyArray) -> Float[Array, " m"]:
        """Return the log density of every column."""
        away, seen, L = self._factors(value)
        half = jax.vmap(lambda L, y: solve_triangular(L, y, lower=True))(L, away)
        log_det = 2.0 * jnp.log(jnp.diagonal(L, axis1=1, axis2=2)).sum(axis=1)
        return -0.5 * ((half**2).sum(axis=1) + log_det + LOG_2PI * seen.sum(axis=1))

    def log_prob(self, value: AnyArray) -> Array:
        """Return the log density of all columns."""
        return self.log_prob_parts(value).sum()

    def leave_out(self, value: AnyArray) -> Float[Array, " n"]:
        """Return ``log p(y_n | all other rows)`` of every row, from the inverse covariances."""
        away, seen, L = self._factors(value)
        inverse = jax.vmap(inverse_factor)(L)
        precision = (inverse**2).sum(axis=1)
        a = jnp.einsum("mkn,mkj,mj->mn", inverse, inverse, away)
        each = -0.5 * (LOG_2PI - jnp.log(precision) + a**2 / precision)
        return jnp.where(seen, each, 0.0).sum(axis=0)

    def _factors(self, value: AnyArray) -> tuple[Array, Array, Array]:
        """Return away (M, N), what is seen, and factors with unseen rows an identity."""
        seen = ~jnp.isnan(value).T
        away = jnp.where(seen, jnp.where(seen.T, value, 0.0).T - self.loc.T, 0.0)
        shared = self.factor @ self.factor.swapaxes(1, 2)
        N = self.loc.shape[0]
        K = shared + self.noise[:, None, None] * jnp.eye(N)
        K = jnp.where(seen[:, :, None] & seen[:, None, :], K, 0.0)
        K = K + jnp.where(seen, 0.0, 1.0)[:, :, None] * jnp.eye(N)
        return away, seen, jax.vmap(cholesky)(K)


class TrainedWeights(NamedTuple):
    """What training outputs say of the weights, given precisions and noise.

    alpha, noise
        (B,) and (M,).
    information
        (M, B, B) A_m and (M, B) A_m times the mean, in units of the prior.
    """

    alpha: Float[AnyArray, " b"]
    noise: Float[AnyArray, " m"]
    information: tuple[Float[AnyArray, "m b b"], Float[AnyArray, "m b"]]

    def seeing(self, phi: Float[AnyArray, "n b"], y: Float[AnyArray, "n m"]) -> "TrainedWeights":
        """Return what is known with further outputs (N, M), NaN where missing."""
        scaled = jnp.asarray(phi) / jnp.sqrt(self.alpha)
        seen = ~jnp.isnan(y)

        def column(y: Array, seen: Array, noise: Array) -> tuple[Array, Array]:
            rows = jnp.where(seen[:, None], scaled, 0.0)
            return rows.T @ rows / noise, rows.T @ jnp.where(seen, y, 0.0) / noise

        more = jax.vmap(column, in_axes=(1, 1, 0))(jnp.asarray(y), seen, jnp.asarray(self.noise))
        A, b = self.information
        return self._replace(information=(A + more[0], b + more[1]))

    def posterior(self) -> tuple[Float[Array, "m b"], Float[Array, "m b b"]]:
        """Return means of the weights, and roots of their covariances."""
        sd = 1.0 / jnp.sqrt(self.alpha)

        def column(A: Array, b: Array) -> tuple[Array, Array]:
            inverse = inverse_factor(cholesky(A))
            return sd * (inverse.T @ (inverse @ b)), sd[:, None] * inverse.T

        A, b = self.information
        return jax.vmap(column)(jnp.asarray(A), jnp.asarray(b))


def prior_weights(alpha: Float[AnyArray, " b"], noise: Float[AnyArray, " m"]) -> TrainedWeights:
    """Return what is known before any output is seen."""
    B, M = alpha.shape[0], noise.shape[0]
    identity = jnp.broadcast_to(jnp.eye(B), (M, B, B))
    return TrainedWeights(alpha, noise, (identity, jnp.zeros((M, B))))


class OutputsPredictive(NamedTuple):
    """Outputs at N points given the posterior of their weights.

    phi
        (N, B).
    weight, root
        (M, B) and (M, B, B): weights are ``weight + root @ white``.
    noise
        (M,).
    least
        (M,) variances that an output's is at least: errors on frames held out, or zero.
    """

    phi: Float[AnyArray, "n b"]
    weight: Float[AnyArray, "m b"]
    root: Float[AnyArray, "m b b"]
    noise: Float[AnyArray, " m"]
    least: Float[AnyArray, " m"]

    @property
    def mean(self) -> Float[AnyArray, "n m"]:
        """Mean of every output."""
        return jnp.asarray(self.phi) @ jnp.asarray(self.weight).T

    @property
    def variance(self) -> Float[AnyArray, "n m"]:
        """Variance of every output, noise included."""
        return self._signal() + self._noise()

    def marginals(self, key: PRNGKeyArray) -> NormalEntries:
        """Return mean and variance."""
        return NormalEntries(self.mean, self.variance)

    def sample(self, key: PRNGKeyArray) -> Float[Array, "n m"]:
        """Draw the outputs of all points together."""
        weight_key, noise_key = jax.random.split(key)
        white = jax.random.normal(weight_key, self.weight.shape)
        W = self.weight + jnp.einsum("mbc,mc->mb", self.root, white)
        noise = jax.random.normal(noise_key, (len(self.phi), len(W)))
        return jnp.asarray(self.phi) @ W.T + jnp.sqrt(self._noise()) * noise

    def _signal(self) -> Float[Array, "n m"]:
        def column(root: Array) -> Array:
            return ((jnp.asarray(self.phi) @ root) ** 2).sum(axis=1)

        return jax.vmap(column, out_axes=1)(jnp.asarray(self.root))

    def _noise(self) -> Float[Array, "n m"]:
        return jnp.maximum(self.noise, self.least - self._signal())
