"""The one optimiser: L-BFGS on several starts, whose values are found together.

`maximise` climbs a log density from several starts, and can show progress, be interrupted,
drop the starts that lag behind, and say at the end whether each converged. The steps are
those of SciPy's L-BFGS-B (`search`); values and gradients come from one compiled function
of `together` starts at a time, so that their number costs no compilation.

L-BFGS takes few steps where all directions curve alike. A site (N, Q) whose rows
hang together is therefore searched by Z with X = R Z, for a root R (N, N) of its
approximate covariance.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...gp.linalg import AnyArray
from .search import Search

# Steps between two reports, and before starts that lag behind are dropped.
BLOCK = 20

LogDensity = Callable[..., Array]
# Values (s,) and gradients (s, n) of what is made small, at points (s, n).
Evaluate = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


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
    together: int = 1,
    progress: Callable[[int, float], None] | None = None,
    keep_state: Callable[[Any, int], None] | None = None,
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
    together
        Starts whose values are found by one call, as a batch. One is fastest where a value
        takes milliseconds (linear algebra of hundreds of rows), several where the call is
        what takes the time.
    progress
        Called with the steps done and the best log density after every block.
    keep_state
        Called after every block, and at the end, with the values of the starts that are
        followed (as in `Optimum`) and the steps done.
    """
    roots = {name: jnp.asarray(root) for name, root in (roots or {}).items()}
    if roots:
        starts = {**starts, **{name: _solve(R, starts[name]) for name, R in roots.items()}}
    flat, unravel = _ravel(starts)
    data = jax.tree.map(jnp.asarray, data)  # once, not with every call
    keep = len(flat) if keep is None else min(keep, len(flat))
    lanes = min(together, len(flat))

    def evaluate(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # Filled up to the number of lanes that the function is compiled for.
        filled = np.concatenate([u, np.repeat(u[-1:], lanes - len(u), axis=0)])
        return jax.device_get(_values(log_density, unravel, filled, roots, data))

    with ThreadPoolExecutor(len(flat)) as executor:
        searches = [Search(executor, u, tolerance) for u in flat]
        try:
            for search in searches:
                search.wait()
            best = searches
            trial = trial_steps if keep < len(flat) else None
            for limit in _limits(max_steps, trial, progress is not None or keep_state is not None):
                _advance(best, evaluate, lanes, limit)
                best = sorted(best, key=lambda search: search.value)
                if limit >= trial_steps:
                    best = best[:keep]
                if progress is not None:
                    progress(limit, -best[0].value)
                if keep_state is not None:
                    u = np.stack([search.u for search in best])
                    keep_state(jax.device_get(_sites(unravel, u, roots)), best[0].steps)
                if all(search.wanted is None for search in best):
                    break
        finally:
            # Whatever happened, no thread is left waiting.
            for search in searches:
                search.end()
    best = best[:keep]
    return Optimum(
        jax.device_get(_sites(unravel, np.stack([search.u for search in best]), roots)),
        -np.array([search.value for search in best]),
        np.array([search.converged for search in best]),
        np.array([search.steps for search in best]),
    )


def _limits(max_steps: int, trial_steps: int | None, by_blocks: bool) -> list[int]:
    """Give the numbers of steps at which searches wait for each other."""
    blocks = range(BLOCK, max_steps, BLOCK) if by_blocks else []
    trial = [] if trial_steps is None else [min(trial_steps, max_steps)]
    return sorted({*blocks, *trial, max_steps})


def _advance(searches: Sequence[Search], evaluate: Evaluate, lanes: int, limit: int) -> None:
    """Let every search go on until it has taken `limit` steps or has ended."""
    while going := [s for s in searches if s.wanted is not None and s.steps < limit]:
        for first in range(0, len(going), lanes):
            some = going[first : first + lanes]
            found = evaluate(np.stack([s.wanted for s in some if s.wanted is not None]))
            for search, value, gradient in zip(some, *found, strict=False):
                search.tell(value, gradient)
        for search in going:
            search.wait()


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


def _ravel(starts: Any) -> tuple[Float[np.ndarray, "s n"], Unravel]:
    leaves = [np.asarray(leaf, dtype=float) for leaf in jax.tree.leaves(starts)]
    unravel = Unravel(jax.tree.map(lambda leaf: leaf[0], starts))
    return np.concatenate([leaf.reshape(len(leaf), -1) for leaf in leaves], axis=1), unravel


def _solve(root: AnyArray, x: AnyArray) -> Array:
    """Give Z (S, N, Q) with R Z = X for every start."""
    return jax.vmap(lambda one: jnp.linalg.solve(root, one))(jnp.asarray(x, dtype=float))


def _mapped(values: Any, roots: Mapping[str, AnyArray]) -> Any:
    """Take the numbers that are searched to site values."""
    if not roots:
        return values
    return {**values, **{name: R @ values[name] for name, R in roots.items()}}


@partial(jax.jit, static_argnames=("log_density", "unravel"))
def _values(
    log_density: LogDensity,
    unravel: Unravel,
    u: Float[AnyArray, "s n"],
    roots: Mapping[str, AnyArray],
    data: Any,
) -> tuple[Float[Array, " s"], Float[Array, "s n"]]:
    """Give minus the log densities and their gradients."""

    def loss(u):
        return -log_density(_mapped(unravel(u), roots), data)

    return jax.vmap(jax.value_and_grad(loss))(u)


@partial(jax.jit, static_argnames="unravel")
def _sites(unravel: Unravel, u: Float[AnyArray, "s n"], roots: Mapping[str, AnyArray]) -> Any:
    """Give the values of the sites (s, ...) at points."""
    return jax.vmap(lambda one: _mapped(unravel(one), roots))(u)
