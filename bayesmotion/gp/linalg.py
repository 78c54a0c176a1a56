"""The one place where covariance matrices are factorised, and the one jitter policy.

A covariance here always carries a noise term, so the jitter only has to cover
rounding: `JITTER` times the mean of the diagonal is added before factorising.
A factor that still fails is NaN (inside `jit` nothing can be raised); whoever
brings the numbers back to the host calls `require_finite`, which names the site.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..errors import NumericalError

JITTER = 1e-10
# Rows of a triangle that are not worth halving.
LEAST = 64

# What functions take: JAX arrays (traced ones too) or NumPy's.
AnyArray = Array | np.ndarray


def nugget_of(K: Float[AnyArray, "n n"], jitter: float = JITTER) -> Float[Array, ""]:
    """Return what the jitter adds to the diagonal of K: its share of the mean of the diagonal."""
    return jitter * jnp.trace(jnp.asarray(K)) / K.shape[0]


def cholesky(K: Float[AnyArray, "n n"], jitter: float = JITTER) -> Float[Array, "n n"]:
    """Lower Cholesky factor of K plus the jitter; NaN where K is not positive definite.

    An identity plus what is positive semidefinite needs none: no rounding brings it to zero.
    """
    return jnp.linalg.cholesky(K + nugget_of(K, jitter) * jnp.eye(K.shape[0], dtype=K.dtype))


def inverse_factor(L: Float[AnyArray, "n n"]) -> Float[Array, "n n"]:
    """Give L^-1; products with it are matrix products, cheaper than repeated solves."""
    return triangular_inverse(jnp.asarray(L))


def triangular_inverse(L: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Return L^-1 by halves: [[P, 0], [-R Q P, R]], of L = [[P^-1, 0], [Q, R^-1]].

    Nearly all of it is matrix products, of which LAPACK's solve makes less.

    Examples
    --------
    >>> triangular_inverse(jnp.array([[2.0, 0.0], [1.0, 1.0]])).tolist()
    [[0.5, 0.0], [-0.5, 1.0]]
    """
    n = L.shape[0]
    if n <= LEAST:
        eye = jnp.eye(n, dtype=L.dtype)
        return jax.lax.linalg.triangular_solve(L, eye, left_side=True, lower=True)
    half = n // 2
    P, R = triangular_inverse(L[:half, :half]), triangular_inverse(L[half:, half:])
    zero = jnp.zeros((half, n - half), dtype=L.dtype)
    return jnp.block([[P, zero], [-(R @ (L[half:, :half] @ P)), R]])


def require_finite(value: object, site: str) -> None:
    """Stop with a sentence when a factorisation at `site` broke down.

    Raises
    ------
    NumericalError
        If any entry of `value` is NaN or infinite.
    """
    if not np.all(np.isfinite(np.asarray(value))):
        raise NumericalError(
            f"{site}: the covariance matrix is not positive definite within rounding. "
            "Look for repeated frames or a noise precision that ran off, "
            "and use the proper priors."
        )
