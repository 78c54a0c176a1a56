"""Style vectors up to what a linear factor can tell: their shape.

A linear factor enters the covariance only through s_i^T s_j, and a common length
of its vectors only through the scales of the outputs. Of L vectors in R^S,

    s_i ~ N(0, I_S),

what counts is their shape Z (L, S): rotated so that s_1 lies on the first axis,
s_2 in the plane of the first two axes and so on, and divided by the length of s_1.
Z is lower triangular, Z_11 = 1 and Z_ii > 0. Rotated, the vectors have independent
entries, chi_(S-i+1) on the diagonal and N(0, 1) below it (Bartlett 1933); with the
length of s_1 integrated out

    p(Z) = C prod_(i>1) Z_ii^(S-i) |Z|^-(LS),    |Z|^2 the sum of all squared entries.

Vectors of levels met later are, given Z, multivariate t with LS degrees of freedom
and scale |Z|^2 / LS. So shapes have the exchangeable prior of the vectors, while
neither a rotation nor a common length is left for a sampler to wander along.

A program samples the free entries of Z, row by row, those of the diagonal by their
logarithm: numbers on the real line.
"""

from functools import lru_cache
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import gammaln
from jaxtyping import Array, Float
from numpyro import distributions as dist
from numpyro.distributions import constraints

from ..gp.linalg import AnyArray

# Of a population of styles beforehand: how many vectors its mean counts for, and its size, of the
# mean square of the known vectors.
PRIOR_COUNT, PRIOR_SHARE = 0.1, 0.1
LOG_2, LOG_2PI = float(np.log(2.0)), float(np.log(2.0 * np.pi))


@lru_cache
def _free(levels: int, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the free entries of a shape."""
    rows, columns = np.tril_indices(levels, 0, size)
    return rows[1:], columns[1:]


def entry_names(levels: int, size: int) -> list[str]:
    """Name the free entries: the level and the axis, counted from 1."""
    rows, columns = _free(levels, size)
    return [f"{i + 1},{j + 1}" for i, j in zip(rows, columns, strict=True)]


def styles_of(entries: Float[AnyArray, " p"], levels: int, size: int) -> Float[Array, "l s"]:
    """Give the shape (levels, size) with these free entries."""
    rows, columns = _free(levels, size)
    entries = jnp.asarray(entries)
    diagonal = rows == columns
    values = jnp.where(diagonal, jnp.exp(jnp.where(diagonal, entries, 0.0)), entries)
    return jnp.zeros((levels, size)).at[0, 0].set(1.0).at[rows, columns].set(values)


@jax.jit
def entries_of(styles: Float[AnyArray, "l s"]) -> Float[Array, " p"]:
    """Give the free entries of the shape of style vectors in any rotation and length."""
    R = jnp.linalg.qr(jnp.asarray(styles).T, mode="r")
    Z = jnp.where(jnp.diagonal(R) < 0.0, -1.0, 1.0)[None, :] * R.T
    rows, columns = _free(*styles.shape)
    entries = (Z / Z[0, 0])[rows, columns]
    return jnp.where(rows == columns, jnp.log(jnp.abs(entries)), entries)


class StyleShape(dist.Distribution):
    """Distribution of the free entries (P,) of the shape of `levels` vectors in R^`size`."""

    arg_constraints: ClassVar = {}
    support = constraints.real_vector  # pyright: ignore[reportAssignmentType]  NumPyro's own way
    pytree_aux_fields = ("levels", "size")

    def __init__(self, levels: int, size: int, *, validate_args=None):
        self.levels, self.size = levels, size
        free = len(_free(levels, size)[0])
        super().__init__(batch_shape=(), event_shape=(free,), validate_args=False)

    def log_prob(self, value):
        """Log density of the entries `value`, those of the diagonal being logarithms."""
        rows, columns = _free(self.levels, self.size)
        n = self.levels * self.size
        # Z_ii^(S-i) and the Jacobian of the logarithm, i counted from 0 here.
        power = jnp.where(rows == columns, self.size - rows, 0)
        square = jnp.sum(styles_of(value, self.levels, self.size) ** 2)
        return self._constant() + jnp.sum(power * value) - 0.5 * n * jnp.log(square)

    def _constant(self) -> AnyArray:
        """Logarithm of the normaliser C."""
        n, rank = self.levels * self.size, min(self.levels, self.size)
        freedom = self.size - np.arange(rank)
        below = self.event_shape[0] + 1 - rank
        chi = (1.0 - freedom / 2.0) * LOG_2 - gammaln(freedom / 2.0)
        length = (n / 2.0 - 1.0) * LOG_2 + gammaln(n / 2.0)
        return jnp.sum(chi) - 0.5 * below * LOG_2PI + length

    def sample(self, key=None, sample_shape=()):
        """Draw style vectors and take their shape."""
        assert key is not None, "a draw needs a key"
        draws = jax.random.normal(key, (int(np.prod(sample_shape)), self.levels, self.size))
        return jax.vmap(entries_of)(draws).reshape(*sample_shape, *self.event_shape)


def later_styles(known: Float[AnyArray, "l s"], count: int, spare: int = 0) -> dist.Distribution:
    """Give the distribution of the vectors (count, S) of new levels, given a shape.

    Parameters
    ----------
    known
        The shape; its last `spare` columns are zero by decree, and tell nothing of the length.
    count
        Number of new levels.
    spare
        Entries that only new vectors have, each as the others.
    """
    levels, size = known.shape
    freedom = levels * (size - spare)
    scale = jnp.sqrt(jnp.sum(jnp.asarray(known) ** 2) / freedom)
    flat = dist.MultivariateStudentT(
        freedom, jnp.zeros(count * size), scale * jnp.eye(count * size)
    )
    reshape = dist.transforms.ReshapeTransform((count, size), (count * size,))
    return dist.TransformedDistribution(flat, reshape)


def population_styles(
    known: Float[AnyArray, "l s"], count: int, spare: int = 0
) -> dist.Distribution:
    """Give the distribution of new levels' vectors (count, S), of the known population.

    Known vectors are taken for draws from N(mu, Sigma) with

        Sigma ~ inverse Wishart(S + 2, psi I),   mu | Sigma ~ N(0, Sigma / kappa),

    psi = `PRIOR_SHARE` of their mean square and kappa = `PRIOR_COUNT`: a new vector is then
    multivariate t about nearly their mean, of nearly their covariance (Gelman et al., Bayesian
    Data Analysis, section 3.6). New vectors are taken as independent of each other.

    Parameters
    ----------
    known
        The shape; its last `spare` columns are zero by decree.
    count
        Number of new levels.
    spare
        Entries that only new vectors have, of mean zero and of the mean scale of the others.
    """
    levels, size = known.shape[0], known.shape[1] - spare
    Z = jnp.asarray(known)[:, :size]
    mean = jnp.mean(Z, axis=0)
    away = Z - mean
    psi = PRIOR_SHARE * jnp.mean(Z**2)
    pulled = PRIOR_COUNT * levels / (PRIOR_COUNT + levels)
    scatter = psi * jnp.eye(size) + away.T @ away + pulled * jnp.outer(mean, mean)
    df = levels + 3.0
    total = PRIOR_COUNT + levels
    scale = scatter * (total + 1.0) / (total * df)
    more = jnp.mean(jnp.diagonal(scale)) * jnp.eye(spare)
    root = jnp.linalg.cholesky(jax.scipy.linalg.block_diag(scale, more))
    loc = jnp.pad(levels / total * mean, (0, spare))
    return dist.MultivariateStudentT(df, loc, root).expand([count]).to_event(1)
