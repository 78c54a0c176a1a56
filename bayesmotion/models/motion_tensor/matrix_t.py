"""Matrix-t distribution: rows of a GP over labels, columns with an unknown covariance.

Y (N, Q) | Sigma ~ MN(0, K, Sigma), Sigma ~ InverseWishart(nu, scale I), nu = dof + Q - 1.
With Sigma integrated out and S = scale I + Y^T K^-1 Y,

    log p(Y) = - Q/2 log |K| - Q N/2 log pi + nu Q/2 log scale - (nu + N)/2 log |S|
               + log Gamma_Q((nu + N)/2) - log Gamma_Q(nu/2)

A further row of variance v given the others (its kernel with them regressed out) is

    y ~ t_{dof + N}(mean, v S / (dof + N))
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.special import gammaln, multigammaln
from jax.typing import ArrayLike
from jaxtyping import Array, Float, PRNGKeyArray
from numpyro import distributions as dist
from numpyro.distributions import constraints

from ...gp.linalg import AnyArray, cholesky, inverse_factor


class MatrixT(dist.Distribution):
    """Matrix-t distribution of (N, Q) arrays with mean zero; see the module.

    Parameters
    ----------
    covariance
        K (N, N) of the rows.
    scale
        Of the inverse Wishart prior of the columns' covariance.
    dof
        Its degrees of freedom less Q - 1.
    columns
        Q.
    """

    support = constraints.real_matrix  # pyright: ignore[reportAssignmentType]
    pytree_data_fields = ("covariance", "scale", "dof")
    pytree_aux_fields = ("columns",)

    def __init__(
        self, covariance: AnyArray, scale: ArrayLike, dof: ArrayLike, columns: int
    ) -> None:
        self.covariance = covariance
        self.scale, self.dof = jnp.asarray(scale), jnp.asarray(dof)
        self.columns = columns
        super().__init__(event_shape=(covariance.shape[0], columns))

    def log_prob(self, value: AnyArray) -> Array:
        """Return the log density of Y."""
        n, q = value.shape
        L = cholesky(self.covariance)
        white = jax.scipy.linalg.solve_triangular(L, jnp.asarray(value), lower=True)
        Ls = cholesky(self.scale * jnp.eye(q) + white.T @ white)
        nu = self.dof + q - 1.0
        return (
            -q * log_diagonal(L)
            - 0.5 * q * n * jnp.log(jnp.pi)
            + 0.5 * nu * q * jnp.log(self.scale)
            - (nu + n) * log_diagonal(Ls)
            + multigammaln(0.5 * (nu + n), q)
            - multigammaln(0.5 * nu, q)
        )

    def sample(self, key: PRNGKeyArray, sample_shape: tuple[int, ...] = ()) -> Array:
        """Draw Sigma, and rows given it."""
        keys = jax.random.split(key, sample_shape)
        draw = self._draw
        for _ in sample_shape:
            draw = jax.vmap(draw)
        return draw(keys)

    def _draw(self, key: PRNGKeyArray) -> Float[Array, "n q"]:
        n, q = self.event_shape
        sigma_key, key = jax.random.split(key)
        root = inverse_wishart_root(sigma_key, self.scale, self.dof + q - 1.0, q)
        return cholesky(self.covariance) @ jax.random.normal(key, (n, q)) @ root.T


def inverse_wishart_root(
    key: PRNGKeyArray, scale: AnyArray, nu: AnyArray, q: int
) -> Float[Array, "q q"]:
    """Draw a root of Sigma ~ InverseWishart(nu, scale I), through Bartlett's factor of Sigma^-1.

    Sigma^-1 = A A^T / scale, A lower triangular, of chi variables with nu - i degrees of
    freedom on the diagonal (i = 0, 1, ..) and standard normal ones below it.
    """
    below_key, key = jax.random.split(key)
    diagonal = jnp.sqrt(2.0 * jax.random.gamma(key, 0.5 * (nu - jnp.arange(q))))
    A = jnp.tril(jax.random.normal(below_key, (q, q)), -1) + jnp.diag(diagonal)
    return jnp.sqrt(scale) * jax.scipy.linalg.solve_triangular(A, jnp.eye(q), lower=True).T


class Rows(NamedTuple):
    """Training rows, and what they say of Sigma and of further rows.

    inverse
        K^-1 (N, N).
    weighted
        K^-1 Y (N, Q).
    matrix
        S (Q, Q), and its inverse factor W: |W a|^2 = a^T S^-1 a.
    factor
        W (Q, Q), lower triangular.
    dof
        dof + N.
    """

    inverse: Float[AnyArray, "n n"]
    weighted: Float[AnyArray, "n q"]
    matrix: Float[AnyArray, "q q"]
    factor: Float[AnyArray, "q q"]
    dof: Float[AnyArray, ""]


def rows(
    y: Float[AnyArray, "n q"],
    covariance: Float[AnyArray, "n n"],
    scale: AnyArray,
    dof: AnyArray,
) -> Rows:
    """Condition on rows."""
    n, q = y.shape
    half = inverse_factor(cholesky(covariance))
    inverse = half.T @ half
    white = half @ jnp.asarray(y)
    matrix = scale * jnp.eye(q) + white.T @ white
    return Rows(
        inverse, inverse @ jnp.asarray(y), matrix, inverse_factor(cholesky(matrix)),
        jnp.asarray(dof + float(n)),
    )  # fmt: skip


def leave_one_out(known: Rows) -> Float[Array, " n"]:
    """Return ``log p(y_n | all other rows)`` of every row.

    With A = K^-1, a_n = (A Y)_n and h_n = a_n^T S^-1 a_n / A_nn, the row's residual is
    a_n / A_nn, its variance 1 / A_nn, and S without the row is S - a_n a_n^T / A_nn:

        log p = t_{dof + N - 1}: |S_-n| = |S| (1 - h_n), squared distance h_n / (1 - h_n)
    """
    q = float(known.weighted.shape[1])
    precision = jnp.diagonal(jnp.asarray(known.inverse))
    h = jnp.square(known.weighted @ known.factor.T).sum(axis=1) / precision
    log_det = -2.0 * log_diagonal(known.factor) + jnp.log1p(-h)
    return log_student(h / (1.0 - h), log_det - q * jnp.log(precision), known.dof - 1.0, q)


def log_student(distance: AnyArray, log_det: AnyArray, dof: AnyArray, q: AnyArray | float) -> Array:
    """Return the log density of a t variable of q entries with scale matrix M / dof.

    Parameters
    ----------
    distance
        a^T M^-1 a of the residual a.
    log_det
        log |M|.
    dof, q
        Degrees of freedom, and the number of entries.
    """
    constant = gammaln(0.5 * (dof + q)) - gammaln(0.5 * dof) - 0.5 * q * jnp.log(jnp.pi)
    return constant - 0.5 * log_det - 0.5 * (dof + q) * jnp.log1p(distance)


def log_diagonal(L: AnyArray) -> Array:
    """Return the sum of the logarithms of the diagonal."""
    return jnp.log(jnp.diagonal(jnp.asarray(L))).sum()
