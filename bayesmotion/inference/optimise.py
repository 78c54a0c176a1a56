"""The one optimiser: L-BFGS on several starts at once, in JAX.

`maximise` climbs a log density from several starts together (`vmap`), a block of
steps at a time, so that it can show progress, be interrupted, drop the starts
that lag behind, and say at the end whether each converged. Many starts are tried
in batches of as many as are kept, so that their number costs no compilation.

L-BFGS takes few steps where all directions curve alike. A site (N, Q) whose rows
hang together is therefore searched by Z with X = R Z, for a root R (N, N) of its
approximate covariance.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from ..gp.linalg import AnyArray
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
    roots: Mapping[str, AnyArray] | None = None,
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
    roots
        For sites (N, Q) a root R (N, N) of their approximate covariance.
    progress
        Called with the steps done and the best log density after every block.
    """
    roots = {name: jnp.asarray(root) for name, root in (roots or {}).items()}
    if roots:
        starts = {**starts, **{name: _solve(R, starts[name]) for name, R in roots.items()}}
    flat, unravel = _ravel(starts)
    count = len(flat)
    batch = count if keep is None else min(keep, count)
    searches = [lbfgs.begin(u, MEMORY) for u in _batches(flat, batch)]
    given = (roots, data, jnp.asarray(tolerance))
    done = 0
    while done < max_steps:
        block = min(BLOCK, max_steps - done)
        if len(searches) > 1:
            block = min(block, trial_steps - done)
        # The first step of all evaluates the starts.
        most = block + (done == 0)
        searches = [_advance(log_density, unravel, s, *given, most) for s in searches]
        done += block
        if progress is not None:
            progress(done, float(-jnp.min(_joined(searches).value)))
        if len(searches) > 1 and done >= trial_steps:
            searches = [_best(searches, count, batch)]
        if all(bool(jnp.all(s.still >= lbfgs.PATIENCE)) for s in searches):
            break
    search = _best(searches, count, batch)
    values = jax.vmap(unravel)(search.u)
    return Optimum(
        jax.tree.map(np.asarray, _mapped(values, roots)),
        -np.asarray(search.value),
        np.asarray((search.still >= lbfgs.PATIENCE) & jnp.isfinite(search.value)),
        np.asarray(search.steps),
    )


class Unravel:
    """Give back the pytree of a flat vector; equal for equal structures, so jit can reuse it."""

    def __init__(self, example: Any) -> None:
        leaves, self.structure = jax.tree.flatten(example)
        self.shapes = tuple(np.shape(leaf) for leaf in leaves)

    def __call__(self, u: Array) -> Any:
        """Give the pytree whose leaves, one after the other, are u."""
        sizes = [int(np.prod(shape)) for shape in self.shapes]
        pieces = jnp.split(u, np.cumsum(sizes)[:-1])
        leaves = [p.reshape(shape) for p, shape in zip(pieces, self.shapes, strict=True)]
        return jax.tree.unflatten(self.structure, leaves)

    def __hash__(self) -> int:
        """Hash of the structure."""
        return hash((self.structure, self.shapes))

    def __eq__(self, other: object) -> bool:
        """Whether the structures are the same."""
        if not isinstance(other, Unravel):
            return NotImplemented
        return (self.structure, self.shapes) == (other.structure, other.shapes)


def _ravel(starts: Any) -> tuple[Array, Unravel]:
    starts = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=float), starts)
    unravel = Unravel(jax.tree.map(lambda leaf: leaf[0], starts))
    return jax.vmap(lambda one: ravel_pytree(one)[0])(starts), unravel


def _solve(root: AnyArray, x: AnyArray) -> Array:
    """Give Z (S, N, Q) with R Z = X for every start."""
    return jax.vmap(lambda one: jnp.linalg.solve(root, one))(jnp.asarray(x, dtype=float))


def _mapped(values: Any, roots: Mapping[str, AnyArray]) -> Any:
    """Take the numbers that are searched to site values."""
    if not roots:
        return values
    return {**values, **{name: R @ values[name] for name, R in roots.items()}}


def _batches(flat: Array, size: int) -> list[Array]:
    """Cut starts into batches of one size, the last filled up with the last start."""
    missing = -len(flat) % size
    filled = jnp.concatenate([flat, jnp.repeat(flat[-1:], missing, axis=0)])
    return list(filled.reshape(-1, size, flat.shape[1]))


def _joined(searches: Sequence[lbfgs.Search]) -> lbfgs.Search:
    """Put the starts of several searches side by side."""
    return lbfgs.Search(
        **{
            name: jnp.concatenate([getattr(s, name) for s in searches], axis=_start_axis(name))
            for name in lbfgs.Search._fields
        }
    )


def _best(searches: Sequence[lbfgs.Search], count: int, keep: int) -> lbfgs.Search:
    """Give the best starts of several searches, best first; the first `count` are real."""
    search = _joined(searches)
    lanes = np.argsort(np.asarray(search.value)[:count], kind="stable")[:keep]
    return lbfgs.Search(
        **{
            name: jnp.take(leaf, lanes, axis=_start_axis(name))
            for name, leaf in search._asdict().items()
        }
    )


def _start_axis(name: str) -> int:
    """Axis of the starts; the memory's first axis is over past steps."""
    return int(name in ("moves", "turns", "inverse"))


@partial(jax.jit, static_argnames=("log_density", "unravel"))
def _advance(
    log_density: LogDensity,
    unravel: Unravel,
    search: lbfgs.Search,
    roots: Mapping[str, AnyArray],
    data: Any,
    tolerance: Array,
    most: int | Array,
) -> lbfgs.Search:
    """Take up to `most` steps on every start that has not converged."""
    loss = _loss(log_density, unravel, roots, data)

    def go_on(carry):
        count, search = carry
        return (count < most) & jnp.any(search.still < lbfgs.PATIENCE)

    def block(carry):
        count, search = carry
        return count + 1, lbfgs.step(loss, search, search.still >= lbfgs.PATIENCE, tolerance)

    return jax.lax.while_loop(go_on, block, (0, search))[1]


def _loss(
    log_density: LogDensity, unravel: Unravel, roots: Mapping[str, AnyArray], data: Any
) -> lbfgs.ValueAndGradient:
    def loss(u):
        return -log_density(_mapped(unravel(u), roots), data)

    return jax.vmap(jax.value_and_grad(loss))
