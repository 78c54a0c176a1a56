"""One Gaussian process for all outputs through inducing points, at the cost of N M^2.

Outputs y_d (N,), d = 1..D, are one function each of points x, with white noise:

    y_d = f_d(x) + e_d,    f_d ~ GP(0, k),    e_d ~ N(0, I / beta)

and u (M,) are the function's values at inducing points. Titsias (2009) puts a free
Gaussian on u and maximises over it; with Q = K_nm K_mm^-1 K_mn this gives the bound

    log p(Y) >= sum_d log N(y_d | 0, Q + I / beta) - D beta / 2 tr(K_nn - Q),

which is the exact log density when the inducing points are the points themselves. With
K_mm = L L^T, A = beta^1/2 K_nm L^-T and B = I + A^T A all of it costs N M^2, and no N x N
matrix is made. Rows that a column misses are left out of its sums, pattern by pattern
(`matrix_normal.Patterns`).

A bound is no density: it is for searching a mode, not for sampling or comparison.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.linalg import solve_triangular
from jaxtyping import Array, Float

from .kernels import Kernel, Points
from .linalg import AnyArray, cholesky, inverse_factor
from .matrix_normal import LOG_2PI, Patterns, seen_entries


class SparsePosterior(NamedTuple):
    """What data say about the function through inducing points, to predict at new points.

    kernel
        Covariance of the function.
    inducing
        Factors of the M inducing points.
    weights
        (M, D): the mean at new points is K_*m weights.
    prior, posterior
        (M, M) and (P, M, M), one a pattern: the variance is
        k_** - |prior k_m*|^2 + |posterior k_m*|^2.
    beta
        Precision of the noise.
    """

    kernel: Kernel
    inducing: Points
    weights: Float[AnyArray, "m d"]
    prior: Float[AnyArray, "m m"]
    posterior: Float[AnyArray, "p m m"]
    beta: Float[AnyArray, ""]

    def __call__(self, points: Points) -> tuple[Float[Array, "n d"], Float[Array, "p n"]]:
        """Predict the function: means (N, D), and every pattern's variances (P, N)."""
        cross = self.kernel.matrix(points, self.inducing)
        explained = jnp.sum((cross @ self.prior.T) ** 2, axis=1)
        left = jnp.sum(jnp.einsum("nm,plm->pnl", cross, self.posterior) ** 2, axis=2)
        whole = prior_variance(self.kernel, points)
        return cross @ self.weights, jnp.maximum(whole - explained, 0.0) + left


def prior_variance(kernel: Kernel, points: Points) -> Float[Array, " n"]:
    """Return k(x, x) of points."""
    return jax.vmap(lambda point: kernel(point, point))(dict(points))


def collapsed_bound(
    kernel: Kernel,
    points: Points,
    inducing: Points,
    beta: Float[AnyArray, ""],
    y: Float[AnyArray, "n d"],
    missing: Patterns,
) -> Float[Array, " d"]:
    """Return the bound of the log density of every column's seen entries (D,).

    The bound is a log density only where the inducing points are the points; a program
    that has fewer adds it as a factor (`gp.unnormalised`).

    Parameters
    ----------
    points, inducing
        Factors of the N points and of the M inducing points.
    beta
        Precision of the noise.
    y
        (N, D); what stands at entries not seen counts for nothing.
    missing
        Which entries are seen.
    """
    projected, _ = _projected(kernel, points, inducing, beta)
    own = prior_variance(kernel, points)

    def one(rows: Array, columns: Array) -> Array:
        A = rows[:, None] * projected
        factor = cholesky(jnp.eye(A.shape[1]) + A.T @ A)
        scaled = jnp.sqrt(beta) * seen_entries(y, rows, columns)
        half = solve_triangular(factor, A.T @ scaled, lower=True)
        quadratic = jnp.sum(scaled**2, axis=0) - jnp.sum(half**2, axis=0)
        count = jnp.sum(rows)
        log_det = 2.0 * jnp.sum(jnp.log(jnp.diagonal(factor))) - count * jnp.log(beta)
        lost = beta * jnp.sum(rows * own) - jnp.sum(A**2)
        return -0.5 * columns * (quadratic + log_det + lost + count * LOG_2PI)

    return jnp.sum(_each_pattern(one, missing), axis=0)


def condition_sparse(
    kernel: Kernel,
    points: Points,
    inducing: Points,
    beta: Float[AnyArray, ""],
    y: Float[AnyArray, "n d"],
    missing: Patterns,
) -> SparsePosterior:
    """Condition the function on the seen entries of y, through inducing points."""
    projected, inverse = _projected(kernel, points, inducing, beta)

    def one(rows: Array, columns: Array) -> tuple[Array, Array]:
        A = rows[:, None] * projected
        factor = cholesky(jnp.eye(A.shape[1]) + A.T @ A)
        scaled = jnp.sqrt(beta) * seen_entries(y, rows, columns)
        half = solve_triangular(factor, A.T @ scaled, lower=True)
        posterior = solve_triangular(factor, inverse, lower=True)
        return posterior.T @ half, posterior

    weights, posterior = _each_pattern(one, missing)
    return SparsePosterior(
        kernel, inducing, jnp.sum(weights, axis=0), inverse, posterior, jnp.asarray(beta)
    )


def _projected(
    kernel: Kernel, points: Points, inducing: Points, beta: AnyArray
) -> tuple[Float[Array, "n m"], Float[Array, "m m"]]:
    """Return A and the inverse Cholesky factor of K_mm."""
    inverse = inverse_factor(cholesky(kernel.matrix(inducing, inducing)))
    return jnp.sqrt(beta) * kernel.matrix(points, inducing) @ inverse.T, inverse


def _each_pattern(one, missing: Patterns):
    return jax.vmap(one)(jnp.asarray(missing.rows), jnp.asarray(missing.columns))
