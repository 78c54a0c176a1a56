"""What a trained motion tensor predicts of new segments: another repetition of each.

A segment's levels are those of its labels; where a label is unknown they are weighed by what
is seen of it. Given levels c, the seen part P y and another repetition r of the same cell are
taken as jointly Student t, with scale matrices (times 1 / dof)

    V = M_c of either,    C = V - (1 - share) S between them,    G = P (P V P)^+ P
    r | P y ~ t_{dof + k}(mean + C G (y - mean), (1 + d) (V - C G C) / (dof + k))

k directions seen, d = (y - mean)^T G (y - mean). With nothing seen this is the t variable of
the levels; given Sigma it is exact.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from ...gp.linalg import AnyArray, cholesky
from ...prediction import NormalEntries
from .classes import TrainedTensor, scale_matrix, seen_part, student
from .data import NewSegments, TensorData


class Repetition(NamedTuple):
    """Another repetition of one segment, given its levels: Student t of scale matrix / dof."""

    mean: Float[AnyArray, " q"]
    matrix: Float[AnyArray, "q q"]
    dof: Float[AnyArray, ""]


class SegmentPredictive(NamedTuple):
    """Other repetitions of new segments, for one draw; see the module.

    trained
        The trained model.
    data
        The segments.
    log_weight
        (N, C) log probabilities of their levels, up to a constant, given what is seen.
    """

    trained: TrainedTensor
    data: NewSegments | TensorData
    log_weight: Float[AnyArray, "n c"]

    @property
    def mean(self) -> Float[Array, "n q"]:
        """Mean of every entry."""
        return self._moments()[0]

    @property
    def variance(self) -> Float[Array, "n q"]:
        """Variance of every entry."""
        return self._moments()[1]

    def marginals(self, key: PRNGKeyArray) -> NormalEntries:
        """Return mean and variance, given draws of the levels and of the t variables' scale."""

        def of_row(key: PRNGKeyArray, found: Repetition) -> tuple[Array, Array]:
            chi2 = 2.0 * jax.random.gamma(key, 0.5 * found.dof)
            return jnp.asarray(found.mean), jnp.diagonal(found.matrix) / chi2

        return NormalEntries(*self._drawn(key, of_row))

    def sample(self, key: PRNGKeyArray) -> Float[Array, "n q"]:
        """Draw whole segments."""
        return self._drawn(key, lambda key, found: student(key, *found))

    def _drawn[T](self, key: PRNGKeyArray, say: Callable[[PRNGKeyArray, Repetition], T]) -> T:
        """Draw levels of every row, and what `say` draws of a repetition of these."""
        level_key, key = jax.random.split(key)
        chosen = jax.random.categorical(level_key, self.log_weight)

        def of_row(row: tuple) -> T:
            c, y, seen, key = row
            return say(key, repetition(self.trained, y, seen, c))

        keys = jax.random.split(key, len(chosen))
        return jax.lax.map(of_row, (chosen, jnp.asarray(self.data.y), self.data.seen, keys))

    def _moments(self) -> tuple[Array, Array]:
        weight = jax.nn.softmax(self.log_weight, axis=1)
        classes = jnp.arange(self.log_weight.shape[1])

        def of_row(row: tuple) -> tuple[Array, Array]:
            w, y, seen = row

            def moments(c: Array) -> tuple[Array, Array]:
                found = repetition(self.trained, y, seen, c)
                return jnp.asarray(found.mean), jnp.diagonal(found.matrix) / (found.dof - 2.0)

            means, variances = jax.lax.map(moments, classes)
            mean = w @ means
            return mean, w @ (variances + jnp.square(means - mean))

        return jax.lax.map(of_row, (weight, jnp.asarray(self.data.y), self.data.seen))


def repetition(
    trained: TrainedTensor,
    y: Float[AnyArray, " q"],
    seen: Float[AnyArray, "q q"] | None,
    c: AnyArray | int,
) -> Repetition:
    """Return another repetition of a segment of the levels c, given what is seen of it.

    Parameters
    ----------
    trained
        The trained model.
    y, seen
        Its coordinates, and the projection on the directions that are seen; None for all.
    c
        Index of the levels.
    """
    P = jnp.eye(len(y)) if seen is None else seen
    V = scale_matrix(trained, c)
    C = V - trained.repetition * trained.matrix
    L = cholesky(seen_part(V, P))
    gap = jax.scipy.linalg.solve_triangular(L, P @ (y - trained.mean[c]), lower=True)
    cross = jax.scipy.linalg.solve_triangular(L, P @ C, lower=True)
    matrix = (1.0 + gap @ gap) * (V - cross.T @ cross)
    return Repetition(trained.mean[c] + cross.T @ gap, matrix, trained.dof + jnp.trace(P))
