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

# What functions take: JAX arrays (traced ones too) or NumPy's.
AnyArray = Array | np.ndarray


def cholesky(K: Float[AnyArray, "n n"], jitter: float = JITTER) -> Float[Array, "n n"]:
    """Lower Cholesky factor of K plus the jitter; NaN where K is not positive definite.

    An identity plus what is positive semidefinite needs none: no rounding brings it to zero.
    """
    n = K.shape[0]
    return jnp.linalg.cholesky(K + jitter * jnp.trace(K) / n * jnp.eye(n, dtype=K.dtype))


def inverse_factor(L: Float[AnyArray, "n n"]) -> Float[Array, "n n"]:
    """Give L^-1; products with it are matrix products, cheaper than repeated solves."""
    eye = jnp.eye(L.shape[0], dtype=L.dtype)
    return jax.scipy.linalg.solve_triangular(L, eye, lower=True)


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
