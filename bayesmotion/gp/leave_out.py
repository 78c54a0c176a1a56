"""What a Gaussian process says of data left out, by its exact conditional.

With y ~ N(0, K / w^2), A = K^-1 and a = A y, an entry given all others is

    y_i | y_-i ~ N(y_i - a_i / A_ii, 1 / (w^2 A_ii))

(Bürkner, Gabry and Vehtari 2021, eq. 10 and 11), and a block B of entries given all
others

    y_B | y_-B ~ N(y_B - A_BB^-1 a_B, A_BB^-1 / w^2),

so that one inverse of K serves whatever is left out. Rows not seen in a column are
an identity in K and zero in y (see `matrix_normal`): they change nothing here.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .linalg import AnyArray, cholesky, inverse_factor
from .matrix_normal import LOG_2PI, Covariance, Patterns, masked, seen_entries


class LeftOut(NamedTuple):
    """The conditionals of F blocks of rows, each left out by itself.

    mean, variance
        (F, N, D) of each entry by itself; where a row is not in the block, no meaning.
    log_density
        (F, D) log density of all entries of a column in the block together.
    """

    mean: Float[AnyArray, "f n d"]
    variance: Float[AnyArray, "f n d"]
    log_density: Float[AnyArray, "f d"]


def normal_log_density(y: AnyArray, mean: AnyArray, variance: AnyArray) -> Array:
    """Log density of independent normal entries."""
    return -0.5 * (LOG_2PI + jnp.log(variance) + (y - mean) ** 2 / variance)


def leave_out_each(
    y: Float[AnyArray, "n d"],
    K: Float[AnyArray, "n n"] | Covariance,
    scale: Float[AnyArray, " d"],
    missing: Patterns,
) -> tuple[Float[Array, "n d"], Float[Array, "n d"]]:
    """Give mean and variance (N, D) of every entry given all others of its column.

    What stands at entries that are not seen has no meaning.
    """

    def one(pattern: Patterns) -> tuple[Array, Array]:
        rows, columns = pattern.rows, jnp.asarray(pattern.columns)
        if isinstance(K, Covariance):
            diagonal, alpha = K.inverse(y, pattern)
        else:
            inverse, alpha = _inverse(y, K, rows, columns)
            diagonal = jnp.diagonal(inverse)
        return columns * (y - alpha / diagonal[:, None]), columns / diagonal[:, None]

    mean, variance = _summed(one, missing)
    return mean, variance / scale**2


def leave_out_blocks(
    y: Float[AnyArray, "n d"],
    K: Float[AnyArray, "n n"],
    scale: Float[AnyArray, " d"],
    missing: Patterns,
    blocks: Float[AnyArray, "f n"],
) -> LeftOut:
    """Leave blocks of rows out of every column, one block at a time.

    Parameters
    ----------
    blocks
        1 where a row belongs to the block, else 0.
    """

    def one(pattern: Patterns) -> LeftOut:
        rows, columns, _ = pattern
        inverse, alpha = _inverse(y, K, rows, columns)

        def block(inside: Array) -> LeftOut:
            # A's rows outside the block become an identity, which changes nothing inside.
            half = inverse_factor(cholesky(masked(inverse, inside)))
            away = half @ (inside[:, None] * alpha)
            logdet = -2.0 * jnp.sum(jnp.log(jnp.diagonal(half)))
            density = jnp.sum(rows * inside) * (jnp.log(scale) - 0.5 * LOG_2PI) + 0.5 * logdet
            density = density - 0.5 * scale**2 * jnp.sum(away**2, axis=0)
            variance = jnp.sum(half**2, axis=0)[:, None]
            return LeftOut(columns * (y - half.T @ away), columns * variance, columns * density)

        return jax.lax.map(block, jnp.asarray(blocks))

    mean, variance, density = _summed(one, missing)
    return LeftOut(mean, variance / scale**2, density)


def leave_out_rows(
    y: Float[AnyArray, "n d"],
    K: Float[AnyArray, "n n"],
    scale: Float[AnyArray, " d"],
    missing: Patterns,
    blocks: Int[AnyArray, "f s"],
) -> Float[Array, "f d"]:
    """Return the log density (F, D) of blocks of few rows given all others, column by column.

    As `leave_out_blocks`, at the cost of one inverse of K and F small ones.

    Parameters
    ----------
    blocks
        Rows of every block, all of one size.
    """
    index = jnp.asarray(blocks)

    def one(pattern: Patterns) -> tuple[Array]:
        rows, columns, _ = pattern
        inverse, alpha = _inverse(y, K, rows, columns)

        def block(at: Array) -> Array:
            half = inverse_factor(cholesky(inverse[at[:, None], at]))
            logdet = -2.0 * jnp.sum(jnp.log(jnp.diagonal(half)))
            density = jnp.sum(jnp.asarray(rows)[at]) * (jnp.log(scale) - 0.5 * LOG_2PI)
            misfit = scale**2 * jnp.sum((half @ alpha[at]) ** 2, axis=0)
            return jnp.asarray(columns) * (density + 0.5 * logdet - 0.5 * misfit)

        return (jax.vmap(block)(index),)

    return _summed(one, missing)[0]


def _inverse(y: AnyArray, K: AnyArray, rows: AnyArray, columns: AnyArray) -> tuple[Array, Array]:
    """Give A = K^-1 and A y for the entries a pattern has seen."""
    half = inverse_factor(cholesky(masked(K, rows)))
    return half.T @ half, half.T @ (half @ seen_entries(y, rows, columns))


def _summed(one, missing: Patterns) -> tuple:
    """Put the patterns' columns together."""
    if missing.rows.shape[0] == 1:
        return one(Patterns(missing.rows[0], missing.columns[0], missing.which[0]))
    parts = jax.lax.map(one, Patterns(*map(jnp.asarray, missing)))
    return tuple(jnp.sum(part, axis=0) for part in parts)
