"""One Gaussian process for all outputs with the scales integrated out.

With w_d ~ HalfNormal(1), that is w_d^2 ~ Gamma(1/2, 1/2), and y_d ~ N(0, K / w_d^2)
for the n entries of column d that are seen,

    p(y_d) = Gamma((n + 1) / 2) / (sqrt(pi)^(n+1) |K|^(1/2)) (1 + q_d)^-((n+1)/2),
    q_d = y_d^T K^-1 y_d,

a multivariate Cauchy density; and given y_d the scale is drawn exactly from

    w_d^2 | y_d ~ Gamma((n + 1) / 2, rate (1 + q_d) / 2).
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import gammaln
from jaxtyping import Array, Float, PRNGKeyArray
from numpyro import distributions as dist
from numpyro.distributions import constraints

from .linalg import AnyArray, cholesky
from .matrix_normal import Covariance, Patterns, complete, misfit_of_columns

LOG_PI = float(np.log(np.pi))


def draw_scale(
    key: PRNGKeyArray,
    y: Float[AnyArray, "n d"],
    K: Float[AnyArray, "n n"] | Covariance,
    missing: Patterns,
) -> Float[Array, " d"]:
    """Draw the scales w (D,) given everything else."""
    quadratic, _, n = misfit_of_columns(y, K, missing)
    return jnp.sqrt(2.0 * jax.random.gamma(key, 0.5 * (n + 1.0)) / (1.0 + quadratic))


class CollapsedProcess(dist.Distribution):
    """The distribution of Y (N, D) with y_d ~ N(0, K / w_d^2) and w_d ~ HalfNormal(1).

    Parameters
    ----------
    K
        (N, N) covariance of one column of scale 1, noise included, or a `Covariance`.
    columns
        D.
    missing
        Entries to leave out of the density; none where None.
    """

    arg_constraints: ClassVar = {"K": constraints.positive_definite}
    support = constraints.real_matrix  # pyright: ignore[reportAssignmentType]  NumPyro's own way
    pytree_data_fields = ("K", "missing")

    def __init__(self, K, columns, missing=None, *, validate_args=None):
        self.K = K
        self.missing = complete(K.shape[-1], columns) if missing is None else missing
        shape = (K.shape[-1], columns)
        super().__init__(batch_shape=(), event_shape=shape, validate_args=False)

    def log_prob(self, value):
        """Log density of the seen entries of `value` (N, D)."""
        quadratic, logdet, n = misfit_of_columns(value, self.K, self.missing)
        half = 0.5 * (n + 1.0)
        # A column of which nothing is seen has density one.
        constant = gammaln(half) - half * LOG_PI
        return jnp.sum(constant - 0.5 * logdet - half * jnp.log1p(quadratic))

    def sample(self, key=None, sample_shape=()):
        """Draw Y, missing entries included."""
        assert key is not None, "a draw needs a key"
        white_key, scale_key = jax.random.split(key)
        n, d = self.event_shape
        scale = jnp.abs(jax.random.normal(scale_key, (*sample_shape, 1, d)))
        if isinstance(self.K, Covariance):
            return self.K.sample(white_key, sample_shape, d) / scale
        return cholesky(self.K) @ jax.random.normal(white_key, (*sample_shape, n, d)) / scale
