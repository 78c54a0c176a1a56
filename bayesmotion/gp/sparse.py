"""One Gaussian process for all outputs through inducing points, at the cost of N M^2.

Outputs y_d (N,), d = 1..D, are one function each of points x, with white noise:

    y_d = f_d(x) + e_d,    f_d ~ GP(0, k),    e_d ~ N(0, I / beta)

and u (M,) are the function's values at inducing points. Titsias (2009) puts a free
Gaussian on u and maximises over it; with Q = K_nm K_mm^-1 K_mn this gives the bound

    log p(Y) >= sum_d log N(y_d | 0, Q + I / beta) - D beta / 2 tr(K_nn - Q),

which is the exact log density when the inducing points are the points themselves. With
K_mm = L L^T, A = beta^1/2 K_nm L^-T and B = I + A^T A all of it costs N M^2, and no N x N
matrix is made.
"""

from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.linalg import solve_triangular
from jaxtyping import Array, Float
from numpyro import distributions as dist
from numpyro.distributions import constraints

from .kernels import Kernel, Points
from .linalg import AnyArray, cholesky, inverse_factor
from .matrix_normal import LOG_2PI


class Explained(NamedTuple):
    """What data say about the function, kept to predict at new points.

    kernel
        Covariance of the function.
    at
        Factors of M points: the inducing points, or all points of the data.
    weights
        (M, D): the mean at new points is K_*m weights.
    prior, left
        (M, M) and (., M): the variance is k_** - |prior k_m*|^2 + |left k_m*|^2.
    beta
        Precision of the noise.
    """

    kernel: Kernel
    at: Points
    weights: Float[AnyArray, "m d"]
    prior: Float[AnyArray, "m m"]
    left: Float[AnyArray, "l m"]
    beta: Float[AnyArray, ""]

    def __call__(self, points: Points) -> tuple[Float[Array, "n d"], Float[Array, " n"]]:
        """Predict the function: means (N, D), and the variance (N,) that outputs share."""
        cross = self.kernel.matrix(points, self.at)
        gone = jnp.sum((cross @ self.prior.T) ** 2, axis=1)
        left = jnp.sum((cross @ self.left.T) ** 2, axis=1)
        whole = prior_variance(self.kernel, points)
        return cross @ self.weights, jnp.maximum(whole - gone, 0.0) + left


def prior_variance(kernel: Kernel, points: Points) -> Float[Array, " n"]:
    """Give k(x, x) of points."""
    return jax.vmap(lambda point: kernel(point, point))(dict(points))


def _projected(kernel: Kernel, points: Points, inducing: Points, beta: AnyArray):
    """Give A (N, M), the inverse Cholesky factor of K_mm, and the factor of B."""
    inverse = inverse_factor(cholesky(kernel.matrix(inducing, inducing)))
    A = jnp.sqrt(beta) * kernel.matrix(points, inducing) @ inverse.T
    return A, inverse, cholesky(jnp.eye(A.shape[1]) + A.T @ A)


def explain(
    kernel: Kernel,
    points: Points,
    inducing: Points,
    beta: Float[AnyArray, ""],
    y: Float[AnyArray, "n d"],
) -> Explained:
    """Condition the function on data y at points, through inducing points."""
    A, inverse, factor = _projected(kernel, points, inducing, beta)
    half = solve_triangular(factor, jnp.sqrt(beta) * A.T @ y, lower=True)
    left = solve_triangular(factor, inverse, lower=True)
    return Explained(kernel, inducing, left.T @ half, inverse, left, beta)


def explain_exactly(
    kernel: Kernel, points: Points, beta: Float[AnyArray, ""], y: Float[AnyArray, "n d"]
) -> Explained:
    """Condition the function on data without inducing points, once, at the cost of N^3."""
    K, n = kernel.matrix(points, points), len(y)
    inverse = inverse_factor(cholesky(K + jnp.eye(n) / beta))
    weights = inverse.T @ (inverse @ y)
    return Explained(kernel, points, weights, inverse, jnp.zeros((1, n)), beta)


class SparseProcess(dist.Distribution):
    """The distribution of outputs Y (N, D), by the bound of the module.

    The bound is a log density only where the inducing points are the points; a program
    that has fewer adds it as a factor (`gp.unnormalised`).

    Parameters
    ----------
    kernel
        Covariance of the function.
    points, inducing
        Factors of the N points and of the M inducing points.
    beta
        Precision of the noise.
    shape
        (N, D).
    """

    arg_constraints: ClassVar = {"beta": constraints.positive}
    support = constraints.real_matrix  # pyright: ignore[reportAssignmentType]  NumPyro's own way
    pytree_data_fields = ("kernel", "points", "inducing", "beta")

    def __init__(self, kernel, points, inducing, beta, shape, *, validate_args=None):
        self.kernel, self.points, self.inducing = kernel, dict(points), dict(inducing)
        self.beta = beta
        super().__init__(batch_shape=(), event_shape=tuple(shape), validate_args=False)

    def log_prob(self, value):
        """Bound of the log density of `value` (N, D)."""
        return jnp.sum(self.log_prob_parts(value))

    def log_prob_parts(self, value):
        """Bound for every column (D,), which are independent."""
        A, _, factor = _projected(self.kernel, self.points, self.inducing, self.beta)
        y = jnp.sqrt(self.beta) * value
        half = solve_triangular(factor, A.T @ y, lower=True)
        quadratic = jnp.sum(y**2, axis=0) - jnp.sum(half**2, axis=0)
        log_det = 2.0 * jnp.sum(jnp.log(jnp.diagonal(factor))) - len(y) * jnp.log(self.beta)
        whole = self.beta * jnp.sum(prior_variance(self.kernel, self.points))
        return -0.5 * (quadratic + log_det + whole - jnp.sum(A**2) + len(y) * LOG_2PI)

    def sample(self, key=None, sample_shape=()):
        """Draw Y ~ N(0, Q + I / beta), the process through its inducing points."""
        assert key is not None, "a draw needs a key"
        function_key, noise_key = jax.random.split(key)
        n, d = self.event_shape
        inverse = inverse_factor(cholesky(self.kernel.matrix(self.inducing, self.inducing)))
        root = self.kernel.matrix(self.points, self.inducing) @ inverse.T
        white = jax.random.normal(function_key, (*sample_shape, root.shape[1], d))
        noise = jax.random.normal(noise_key, (*sample_shape, n, d))
        return root @ white + noise / jnp.sqrt(self.beta)
