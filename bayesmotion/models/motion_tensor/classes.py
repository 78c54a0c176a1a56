"""What a trained motion tensor says of a new segment of every combination of levels.

Of known levels a segment is Student t, as a further row of the matrix-t distribution. Of a
level never seen the effect is normal about the mean of the known ones, with a covariance
estimated from them: (sum_l d_l d_l^T + 2 E[Sigma]) / (L + 1), d_l = effect - mean; the
second term says that the prior is worth two levels whose effects are as large as Sigma.

The t variable of combination c has the scale matrix M_c / dof,

    M_c = b_c S + sum over its new modes of D_m^T D_m,    D_m = sqrt(dof / (L_m + 1)) d

so that everything is done in coordinates where S is the identity, by matrices with a row a
level (Woodbury).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.special import logsumexp
from jaxtyping import Array, Float, PRNGKeyArray
from numpyro import distributions as dist
from numpyro.distributions import constraints

from ...gp.linalg import AnyArray, cholesky, inverse_factor
from .data import UNKNOWN, NewSegments, TensorData
from .matrix_t import Rows, log_diagonal, log_student

PRIOR_LEVELS = 2.0


class TrainedTensor(NamedTuple):
    """The model conditioned on its training segments, for one draw.

    mean
        (C, Q) of every combination of levels.
    size
        (C,) b_c.
    repetition
        1 - share: the part of b_c that repetitions of a cell do not have in common.
    matrix
        S (Q, Q).
    effect
        D (R, Q): rows of all levels, to be used where their mode is new.
    new
        (C, R) 1 for the rows that a combination uses.
    dof
        Degrees of freedom, the same for all.
    class_level
        (C, M) as in `TensorData`.
    counts
        (M,) number of known levels.
    """

    mean: Float[AnyArray, "c q"]
    size: Float[AnyArray, " c"]
    repetition: Float[AnyArray, ""]
    matrix: Float[AnyArray, "q q"]
    effect: Float[AnyArray, "r q"]
    new: Float[AnyArray, "c r"]
    dof: Float[AnyArray, ""]
    class_level: AnyArray
    counts: AnyArray


def trained_tensor(
    data: TensorData, known: Rows, share: AnyArray, width: Float[AnyArray, " r"]
) -> TrainedTensor:
    """Work out the densities of all combinations.

    Parameters
    ----------
    data
        What the program was fitted to.
    known
        The training rows.
    share
        Of the repetitions' covariance that a cell has in common.
    width
        (R,) prior variance of every column of the design, in units of Sigma.
    """
    design, class_design = jnp.asarray(data.design), jnp.asarray(data.class_design)
    mode, counts = jnp.asarray(data.mode), jnp.asarray(data.mode).sum(axis=1)
    cell = (data.class_level[:, None] == data.level[None]).all(axis=2)
    cross = (class_design * width) @ design.T + share * cell
    variance = jnp.square(class_design) @ width + 1.0
    variance = variance - jnp.sum((cross @ known.inverse) * cross, axis=1)
    effects = width[:, None] * (design.T @ known.weighted)
    gap = effects - mode.T @ ((mode @ effects) / counts[:, None])
    scale = jnp.sqrt(known.dof / (counts + PRIOR_LEVELS - 1.0))
    is_new = (jnp.asarray(data.class_level) == counts[None]).astype(float)
    # E[Sigma] = S / (dof - 2), of which the variance of a t variable is dof / (dof - 2) times
    # as large as its scale.
    prior = PRIOR_LEVELS * known.dof / jnp.maximum(known.dof - 2.0, 1.0)
    return TrainedTensor(
        mean=cross @ known.weighted,
        size=variance + is_new @ (prior / (counts + PRIOR_LEVELS - 1.0)),
        repetition=1.0 - jnp.asarray(share),
        matrix=known.matrix,
        effect=(mode.T @ scale)[:, None] * gap,
        new=is_new @ mode,
        dof=known.dof,
        class_level=data.class_level,
        counts=counts,
    )


def class_log_density(
    trained: TrainedTensor, data: NewSegments | TensorData
) -> Float[Array, "n c"]:
    """Return the log density of what is seen of segments, for every combination of levels."""
    y = jnp.asarray(data.y)
    if data.seen is None:
        factor = inverse_factor(cholesky(trained.matrix))
        q = float(y.shape[1])
        white = (y @ factor.T)[:, None] - (trained.mean @ factor.T)[None]
        return _log_density(trained, white, trained.effect @ factor.T, -log_diagonal(factor), q)

    def of_row(row: tuple[Array, Array]) -> Array:
        value, seen = row
        factor = inverse_factor(cholesky(seen_part(trained.matrix, seen)))
        white = (value - trained.mean) @ seen @ factor.T
        effect = trained.effect @ seen @ factor.T
        half, q = -log_diagonal(factor), jnp.trace(seen)
        return _log_density(trained, white[None], effect, half, q)[0]

    return jax.lax.map(of_row, (y, jnp.asarray(data.seen)))


def seen_part(matrix: AnyArray, seen: AnyArray) -> Float[Array, "q q"]:
    """Return a matrix along seen directions, and the identity along the others."""
    return jnp.asarray(seen @ matrix @ seen + jnp.eye(len(seen)) - seen)


def _log_density(
    trained: TrainedTensor, white: AnyArray, effect: AnyArray, half: Array, q: AnyArray | float
) -> Float[Array, "n c"]:
    """Return log densities of residuals (N, C, Q), where S is the identity along q directions.

    `half` is log |S| / 2 along these.
    """
    b, white, effect = jnp.asarray(trained.size), jnp.asarray(white), jnp.asarray(effect)
    gram = effect @ effect.T
    small = jax.vmap(
        lambda new, b: cholesky(b * jnp.eye(len(gram)) + new[:, None] * gram * new)
    )(trained.new, b)  # fmt: skip
    along = jnp.einsum("ncq,rq,cr->ncr", white, effect, trained.new, optimize=True)
    inner = jax.vmap(
        lambda L, p: jax.scipy.linalg.solve_triangular(L, p.T, lower=True),
        in_axes=(0, 1),
        out_axes=1,
    )(small, along)
    distance = (jnp.square(white).sum(axis=2) - jnp.square(inner).sum(axis=0).T) / b
    rows = gram.shape[0]
    log_det = 2.0 * jax.vmap(log_diagonal)(small) + (q - rows) * jnp.log(b) + 2.0 * half
    return log_student(distance, log_det, trained.dof, q)


def class_log_weight(trained: TrainedTensor, data: NewSegments | TensorData) -> Float[Array, "n c"]:
    """Return log probabilities of the combinations by the labels alone.

    Of an unknown label all known levels and a new one are as probable.
    """
    given = jnp.asarray(data.level)[:, None]
    fits = ((given == UNKNOWN) | (given == trained.class_level[None])).all(axis=2)
    return jnp.where(fits, -jnp.log(fits.sum(axis=1, keepdims=True)), -jnp.inf)


class NewSegmentsT(dist.Distribution):
    """New segments, each by itself: a mixture of Student t variables over unknown labels.

    Parameters
    ----------
    trained
        The trained model.
    data
        The segments; of these the seen directions and the labels count.
    """

    support = constraints.real_vector  # pyright: ignore[reportAssignmentType]
    pytree_data_fields = ("trained", "data")

    def __init__(self, trained: TrainedTensor, data: NewSegments | TensorData) -> None:
        self.trained, self.data = trained, data
        super().__init__(batch_shape=(data.y.shape[0],), event_shape=(data.y.shape[1],))

    def log_prob(self, value: AnyArray) -> Float[Array, " n"]:
        """Return the log density of what is seen of every segment."""
        data = self.data._replace(y=value)
        weight = class_log_weight(self.trained, data)
        return logsumexp(weight + class_log_density(self.trained, data), axis=1)

    def sample(self, key: PRNGKeyArray, sample_shape: tuple[int, ...] = ()) -> Array:
        """Draw levels where they are unknown, and whole segments of them."""
        draw = self._draw
        for _ in sample_shape:
            draw = jax.vmap(draw)
        return draw(jax.random.split(key, sample_shape))

    def _draw(self, key: PRNGKeyArray) -> Float[Array, "n q"]:
        level_key, key = jax.random.split(key)
        chosen = jax.random.categorical(level_key, class_log_weight(self.trained, self.data))

        def of_row(key: PRNGKeyArray, c: Array) -> Array:
            return student(key, self.trained.mean[c], scale_matrix(self.trained, c),
                           self.trained.dof)  # fmt: skip

        return jax.vmap(of_row)(jax.random.split(key, len(chosen)), chosen)


def scale_matrix(trained: TrainedTensor, c: AnyArray | int) -> Float[Array, "q q"]:
    """Return M_c of one combination."""
    D = jnp.asarray(trained.new)[c][:, None] * trained.effect
    return jnp.asarray(trained.size)[c] * jnp.asarray(trained.matrix) + D.T @ D


def student(
    key: PRNGKeyArray, mean: AnyArray, matrix: AnyArray, dof: AnyArray
) -> Float[Array, " q"]:
    """Draw a t variable with scale matrix `matrix` / dof."""
    key, gamma_key = jax.random.split(key)
    white = cholesky(matrix) @ jax.random.normal(key, (matrix.shape[0],))
    return jnp.asarray(mean) + white / jnp.sqrt(2.0 * jax.random.gamma(gamma_key, 0.5 * dof))
