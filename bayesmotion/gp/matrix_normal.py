"""One Gaussian process for all outputs: one K, one scale for each output.

With Y (N, D), loc (N, D), K (N, N) and scales w (D,), column d of Y is

    y_d ~ N(loc_d, K / w_d^2),

the Gaussian process part of Wang, Fleet and Hertzmann (2007, eq. 15). K is
factorised once for all D columns, and once more in the backward pass its
inverse is formed; nothing is differentiated through the Cholesky factor.

Missing entries are marginalised exactly. Columns that miss the same rows share
a pattern; a pattern's missing rows are cut out of K by putting an identity in
their place, so that shapes stay the same whatever is missing.
"""

from collections.abc import Callable
from functools import partial
from typing import ClassVar, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray
from numpyro import distributions as dist
from numpyro.distributions import constraints

from .blocked import factorise, inverse_rows, products
from .linalg import JITTER, AnyArray, cholesky, inverse_factor, nugget_of

LOG_2PI = float(np.log(2.0 * np.pi))
# Misfit, log determinant and number of seen entries of every column.
OfColumns = tuple[Float[Array, " d"], Float[Array, " d"], Float[Array, " d"]]


class Patterns(NamedTuple):
    """Which rows are seen in which columns, pattern by pattern.

    rows
        (P, N), 1 where the pattern's columns are seen in that row, else 0.
    columns
        (P, D), 1 for the columns of the pattern; each column belongs to one pattern.
    which
        (P,) index of the covariance the pattern's columns have, where there are several.
    """

    rows: Float[AnyArray, "p n"]
    columns: Float[AnyArray, "p d"]
    which: Int[AnyArray, " p"]


def patterns(seen: Bool[np.ndarray, "n d"], given: Patterns | None = None) -> Patterns:
    """Group the columns of `seen` by the rows they are seen in.

    Columns that were conditioned on data with patterns of their own (`given`) are
    kept apart by those too, and `which` says which of the covariances is theirs.
    The cost of a density grows with the number of patterns: one factorisation each.
    """
    group = np.zeros(seen.shape[1], int) if given is None else np.argmax(given.columns, axis=0)
    keyed = np.concatenate([group[:, None], seen.T], axis=1)
    unique, index = np.unique(keyed, axis=0, return_inverse=True)
    columns = np.arange(len(unique))[:, None] == index.ravel()[None, :]
    return Patterns(unique[:, 1:].astype(float), columns.astype(float), unique[:, 0].astype(int))


def complete(n: int, d: int) -> Patterns:
    """Give the one pattern of data without missing entries."""
    return Patterns(np.ones((1, n)), np.ones((1, d)), np.zeros(1, int))


@runtime_checkable
class Covariance(Protocol):
    """A covariance (N, N) with densities and draws of its own, cheaper than by its entries."""

    @property
    def shape(self) -> tuple[int, ...]:
        """N and N."""
        ...

    def misfit_of_columns(self, residual: Float[AnyArray, "n d"], missing: Patterns) -> OfColumns:
        """Give r^T K^-1 r, log |K| and the number of seen entries r, for every column (D,)."""
        ...

    def inverse(
        self, residual: Float[AnyArray, "n d"], pattern: Patterns
    ) -> tuple[Float[Array, " n"], Float[Array, "n d"]]:
        """Give the diagonal of K^-1 and K^-1 y for the entries that one pattern has seen."""
        ...

    def sample(
        self, key: PRNGKeyArray, shape: tuple[int, ...], columns: int
    ) -> Float[Array, "*s n d"]:
        """Draw so many columns of scale 1."""
        ...


@partial(jax.custom_vjp, nondiff_argnums=(2,))
def quadratic_logdet(
    K: Float[AnyArray, "n n"], Z: Float[AnyArray, "n d"], jitter: float = JITTER
) -> tuple[Float[Array, " d"], Float[Array, ""]]:
    """Give z_d^T K^-1 z_d for every column and log |K|.

    The derivative is by hand: with A = K^-1 Z, d(z_d^T K^-1 z_d)/dK = -a_d a_d^T
    and d log|K| / dK = K^-1, so the backward pass costs one inverse and one product.
    """
    return _quadratic_logdet(K, Z, jitter)[0]


def _quadratic_logdet(K, Z, jitter):
    blocks, half, logdet = factorise(K, Z.T, nugget_of(K, jitter))
    return (jnp.sum(half**2, axis=1), logdet), (blocks, half)


def _quadratic_logdet_backward(_, saved, cotangent):
    blocks, half = saved
    on_quadratic, on_logdet = cotangent
    upper = inverse_rows(blocks)
    a = [row @ half[:, half.shape[1] - row.shape[1] :].T for row in upper]
    weighted = [own * on_quadratic for own in a]
    # K^-1 - A A^T, both weighted, as one product, whose lower half is enough.
    left = [jnp.concatenate([on_logdet * u, -w], 1) for u, w in zip(upper, weighted, strict=True)]
    right = [jnp.concatenate([u, own], 1) for u, own in zip(upper, a, strict=True)]
    return products(left, right), 2.0 * jnp.concatenate(weighted)


quadratic_logdet.defvjp(_quadratic_logdet, _quadratic_logdet_backward)


def masked(K: Float[AnyArray, "n n"], rows: Float[AnyArray, " n"]) -> Float[Array, "n n"]:
    """Put an identity in place of the rows and columns of K that are not seen."""
    return jnp.asarray(rows[:, None] * rows[None, :] * K) + jnp.diag(1.0 - rows)


def seen_entries(
    residual: Float[AnyArray, "n d"], rows: Float[AnyArray, " n"], columns: Float[AnyArray, " d"]
) -> Float[Array, "n d"]:
    """Put zero in place of what a pattern has not seen, whatever is there, NaN too."""
    return jnp.where(rows[:, None] * columns > 0, residual, 0.0)


def log_density(
    residual: Float[AnyArray, "n d"],
    K: Float[AnyArray, "*g n n"] | Covariance,
    scale: Float[AnyArray, " d"],
    missing: Patterns,
) -> Float[Array, ""]:
    """Log density of the seen entries of `residual` = Y - loc.

    Entries not seen count for nothing. K is one covariance (N, N), or several
    (G, N, N) among which `missing.which` chooses.
    """
    return jnp.sum(log_density_of_columns(residual, K, scale, missing))


def log_density_of_columns(
    residual: Float[AnyArray, "n d"],
    K: Float[AnyArray, "*g n n"] | Covariance,
    scale: Float[AnyArray, " d"],
    missing: Patterns,
) -> Float[Array, " d"]:
    """Log density of every column's seen entries; their sum is `log_density`."""
    scale = jnp.asarray(scale)
    misfit, logdet, count = misfit_of_columns(residual, K, missing)
    each = count * jnp.log(scale) - 0.5 * scale**2 * misfit
    return each - 0.5 * (logdet + count * LOG_2PI)


def misfit_of_columns(
    residual: Float[AnyArray, "n d"], K: Float[AnyArray, "*g n n"] | Covariance, missing: Patterns
) -> OfColumns:
    """Give r^T K^-1 r, log |K| and the number of seen entries r, for every column (D,)."""
    if isinstance(K, Covariance):
        return K.misfit_of_columns(residual, missing)
    covariances = jnp.asarray(K).reshape(-1, *K.shape[-2:])

    def one(pattern: Patterns) -> OfColumns:
        rows, columns, which = pattern
        own = masked(covariances[which], rows)
        quadratic, logdet = quadratic_logdet(own, seen_entries(residual, rows, columns))
        columns = jnp.asarray(columns)
        return columns * quadratic, columns * logdet, columns * jnp.sum(rows)

    return over_patterns(one, missing)


def over_patterns(one: Callable[[Patterns], OfColumns], missing: Patterns) -> OfColumns:
    """Put together what is found of each pattern by itself: zero in the columns of others."""
    if missing.rows.shape[0] == 1:
        return one(Patterns(missing.rows[0], missing.columns[0], missing.which[0]))
    misfit, logdet, count = jax.lax.map(one, Patterns(*map(jnp.asarray, missing)))
    return jnp.sum(misfit, axis=0), jnp.sum(logdet, axis=0), jnp.sum(count, axis=0)


def spread_of_columns(
    residual: Float[AnyArray, "n d"],
    K: Float[AnyArray, "*g n n"],
    scale: Float[AnyArray, " d"],
    freedom: float,
    missing: Patterns,
) -> tuple[Float[Array, " d"], Float[Array, " d"]]:
    """Learn what the covariance of every column is to be multiplied by.

    With lambda_d ~ InverseGamma(nu / 2, nu / 2) and N seen entries of a column,

        r_d | lambda_d ~ N(0, lambda_d K / w_d^2),
        lambda_d | r_d ~ InverseGamma((nu + N) / 2, (nu + w_d^2 r_d^T K^-1 r_d) / 2),

    the conditional distribution of the Student t process (Shah, Wilson and Ghahramani
    2014): a column that misses its mean by more than K tells is less sure of what is to come.

    Returns
    -------
    Shape and rate of every column (D,).
    """
    misfit, _, count = misfit_of_columns(residual, K, missing)
    return 0.5 * (freedom + count), 0.5 * (freedom + jnp.asarray(scale) ** 2 * misfit)


class GaussianProcess(dist.Distribution):
    """The distribution of Y (N, D) with y_d ~ N(loc_d, K / scale_d^2), columns independent.

    Parameters
    ----------
    K
        (N, N) covariance of one column of scale 1, noise included; or (G, N, N), where
        columns conditioned on different data differ (see `Patterns.which`); or a `Covariance`.
    scale
        (D,) scale w_d of each column: the larger, the smaller the column.
    loc
        (N, D) mean, zero where None.
    missing
        Entries to leave out of the density, see `patterns`; none where None.
    """

    arg_constraints: ClassVar = {"K": constraints.positive_definite, "scale": constraints.positive}
    support = constraints.real_matrix  # pyright: ignore[reportAssignmentType]  NumPyro's own way
    pytree_data_fields = ("K", "scale", "loc", "missing")

    def __init__(self, K, scale, loc=None, missing=None, *, validate_args=None):
        self.K, self.scale = K, scale
        n, d = K.shape[-1], scale.shape[-1]
        self.loc = jnp.zeros((n, d)) if loc is None else loc
        self.missing = complete(n, d) if missing is None else missing
        # NumPyro's own check of K would factorise it once more.
        super().__init__(batch_shape=(), event_shape=(n, d), validate_args=False)

    def log_prob(self, value):
        """Log density of the seen entries of `value` (N, D)."""
        return log_density(value - self.loc, self.K, self.scale, self.missing)

    def log_prob_parts(self, value):
        """Log density of every column (D,), which are independent."""
        return log_density_of_columns(value - self.loc, self.K, self.scale, self.missing)

    def sample(self, key=None, sample_shape=()):
        """Draw Y, missing entries included."""
        assert key is not None, "a draw needs a key"
        if isinstance(self.K, Covariance):
            return self.loc + self.K.sample(key, sample_shape, self.event_shape[1]) / self.scale
        white = jax.random.normal(key, (*sample_shape, *self.event_shape))
        factors = jax.vmap(cholesky)(self.K.reshape(-1, *self.K.shape[-2:]))
        if len(factors) == 1:
            return self.loc + factors[0] @ white / self.scale
        group = jnp.einsum("pd,p->d", self.missing.columns, self.missing.which).astype(int)
        return self.loc + jnp.einsum("dnm,...md->...nd", factors[group], white) / self.scale


class Conditioned(NamedTuple):
    """What a Gaussian process knows after seeing data, kept for reuse at new points.

    inverse
        (P, N, N) inverse Cholesky factor of each pattern's masked K.
    half
        (P, N, D) the same times the seen entries, zero in the columns of other patterns.
    """

    inverse: Float[AnyArray, "p n n"]
    half: Float[AnyArray, "p n d"]
    missing: Patterns

    def __call__(
        self, cross: Float[AnyArray, "m n"], K: Float[AnyArray, "m m"]
    ) -> tuple[Float[Array, "m d"], Float[Array, "p m m"]]:
        """Predict at m new points: mean (M, D) and each pattern's covariance (P, M, M).

        cross
            (M, N) covariance of the new points with the data's.
        K
            (M, M) covariance among the new points.
        """
        K = jnp.asarray(K)

        def one(inverse, half, rows):
            gain = jnp.asarray(cross * rows) @ inverse.T
            return gain @ half, jnp.asarray(K) - gain @ gain.T

        means, covariances = jax.vmap(one)(self.inverse, self.half, jnp.asarray(self.missing.rows))
        return jnp.sum(means, axis=0), covariances


def condition(
    residual: Float[AnyArray, "n d"], K: Float[AnyArray, "n n"], missing: Patterns
) -> Conditioned:
    """Condition on the seen entries of `residual` = Y - loc; K includes the noise."""

    def one(rows, columns):
        inverse = inverse_factor(cholesky(masked(K, rows)))
        return inverse, inverse @ seen_entries(residual, rows, columns)

    inverse, half = jax.vmap(one)(jnp.asarray(missing.rows), jnp.asarray(missing.columns))
    return Conditioned(inverse, half, missing)


def smooth(
    y: Float[AnyArray, "n d"],
    loc: Float[AnyArray, "n d"],
    K: Float[AnyArray, "*g n n"],
    noise: Float[AnyArray, "n n"],
    missing: Patterns,
) -> tuple[Float[Array, "n d"], Float[Array, "p n n"]]:
    """Predict the noise-free outputs at all rows from the entries seen in some of them.

    K is the covariance without `noise`. Gives the mean (N, D) and the covariance of
    each pattern of `missing` (P, N, N), for an output of scale 1.
    """
    covariances = jnp.asarray(K).reshape(-1, *K.shape[-2:])

    def one(rows, columns, which):
        own = covariances[which]
        inverse = inverse_factor(cholesky(masked(own + noise, rows)))
        gain = (own * rows) @ inverse.T
        return gain @ (inverse @ seen_entries(y - loc, rows, columns)), own - gain @ gain.T

    means, smoothed = jax.vmap(one)(*map(jnp.asarray, missing))
    return jnp.sum(means, axis=0) + loc, smoothed
