"""The one optimiser: L-BFGS on several starts at once, in JAX.

`maximise` climbs a log density from many starts together (`vmap`), a block of
steps at a time, so that it can show progress, be interrupted, drop the starts
that lag behind, and say at the end whether each converged.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from . import lbfgs

BLOCK = 20
MEMORY = 20

LogDensity = Callable[..., Array]


@dataclass(frozen=True)
class Optimum:
    """What a search found, best start first.

    values
        Site values (pytree with a leading axis over the starts kept).
    log_density
        (S,) of each.
    converged
        (S,) whether each stopped because nothing more was to gain.
    steps
        (S,) L-BFGS steps each took.
    """

    values: Any
    log_density: Float[np.ndarray, " s"]
    converged: np.ndarray
    steps: np.ndarray

    def best(self) -> Any:
        """Give the values of the best start."""
        return jax.tree.map(lambda leaf: leaf[0], self.values)


def maximise(
    log_density: LogDensity,
    starts: Any,
    data: Any,
    *,
    max_steps: int = 1000,
    tolerance: float = 1e-7,
    keep: int | None = None,
    trial_steps: int = BLOCK,
    progress: Callable[[int, float], None] | None = None,
) -> Optimum:
    """Climb ``log_density(values, data)`` from several starts.

    Parameters
    ----------
    log_density
        Hashable function of site values on the real line and the data. Calls with
        the same function and shapes share one compilation.
    starts
        Pytree of starting values with a leading axis over the starts.
    data
        Pytree of arrays handed on to `log_density`.
    max_steps
        At most so many L-BFGS steps.
    tolerance
        A start has converged when a step gains less than this share of its log
        density (plus one) five times in a row.
    keep
        After `trial_steps` steps go on with the best so many starts.
    progress
        Called with the steps done and the best log density after every block.
    """
    flat, unravel = _ravel(starts)
    search = _begin(log_density, unravel, flat, data)
    done = 0
    while done < max_steps:
        block = min(BLOCK, max_steps - done)
        if keep is not None and done < trial_steps:
            block = min(block, trial_steps - done)
        search = _advance(log_density, unravel, search, data, jnp.asarray(tolerance), block)
        done += block
        if progress is not None:
            progress(done, float(-jnp.nanmin(search.value)))
        if keep is not None and done >= trial_steps and keep < search.u.shape[0]:
            search = _select(search, _best_first(search.value)[:keep])
        if bool(jnp.all(search.still >= _PATIENCE)):
            break
    search = _select(search, _best_first(search.value))
    return Optimum(
        jax.tree.map(np.asarray, jax.vmap(unravel)(search.u)),
        -np.asarray(search.value),
        np.asarray((search.still >= _PATIENCE) & jnp.isfinite(search.value)),
        np.asarray(search.steps),
    )


_PATIENCE = 5


class _Unravel:
    """Give back the pytree of a flat vector; equal for equal structures, so jit can reuse it."""

    def __init__(self, example: Any) -> None:
        leaves, self.structure = jax.tree.flatten(example)
        self.shapes = tuple(np.shape(leaf) for leaf in leaves)

    def __call__(self, u: Array) -> Any:
        sizes = [int(np.prod(shape)) for shape in self.shapes]
        pieces = jnp.split(u, np.cumsum(sizes)[:-1])
        leaves = [p.reshape(shape) for p, shape in zip(pieces, self.shapes, strict=True)]
        return jax.tree.unflatten(self.structure, leaves)

    def __hash__(self) -> int:
        return hash((self.structure, self.shapes))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, _Unravel):
            return NotImplemented
        return (self.structure, self.shapes) == (other.structure, other.shapes)


def _ravel(starts: Any) -> tuple[Array, _Unravel]:
    starts = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=float), starts)
    unravel = _Unravel(jax.tree.map(lambda leaf: leaf[0], starts))
    return jax.vmap(lambda one: ravel_pytree(one)[0])(starts), unravel


def _best_first(value: Array) -> np.ndarray:
    numbers = np.asarray(value)
    return np.argsort(np.where(np.isfinite(numbers), numbers, np.inf), kind="stable")


def _select(search: lbfgs.Search, lanes: np.ndarray) -> lbfgs.Search:
    memory = ("moves", "turns", "inverse")
    return lbfgs.Search(
        **{
            name: leaf[:, lanes] if name in memory else leaf[lanes]
            for name, leaf in search._asdict().items()
        }
    )


@partial(jax.jit, static_argnames=("log_density", "unravel"))
def _begin(log_density: LogDensity, unravel: _Unravel, u: Array, data: Any) -> lbfgs.Search:
    return lbfgs.begin(_loss(log_density, unravel, data), u, MEMORY)


@partial(jax.jit, static_argnames=("log_density", "unravel"))
def _advance(
    log_density: LogDensity,
    unravel: _Unravel,
    search: lbfgs.Search,
    data: Any,
    tolerance: Array,
    most: int | Array,
) -> lbfgs.Search:
    """Take up to `most` steps on every start that has not converged."""
    loss = _loss(log_density, unravel, data)

    def go_on(carry):
        count, search = carry
        return (count < most) & jnp.any(search.still < _PATIENCE)

    def block(carry):
        count, search = carry
        return count + 1, lbfgs.step(loss, search, search.still >= _PATIENCE, tolerance)

    return jax.lax.while_loop(go_on, block, (0, search))[1]


def _loss(log_density: LogDensity, unravel: _Unravel, data: Any) -> lbfgs.ValueAndGradient:
    return jax.vmap(jax.value_and_grad(lambda u: -log_density(unravel(u), data)))
