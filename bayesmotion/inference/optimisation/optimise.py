"""The one optimiser: L-BFGS on several starts, whose values are found together.

`maximise` climbs a log density from several starts, and can show progress, be interrupted,
drop the starts that lag behind, and say at the end whether each converged. The steps are
those of SciPy's L-BFGS-B; values and gradients come from one compiled function of `together`
starts at a time, so that their number costs no compilation. SciPy calls the function; here the
function is called for many searches at a time, so each `Search` runs in a thread of its own,
which waits for the value at the point it wants next. Between two values a search can be left
waiting, to go on later as if nothing had been, or ended.

L-BFGS takes few steps where all directions curve alike. A site (N, Q) whose rows
hang together is therefore searched by Z with X = R Z, for a root R (N, N) of its
approximate covariance.
"""

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from queue import SimpleQueue
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize
from jaxtyping import Array, Float

from ...errors import MotionWarning
from ...gp.linalg import AnyArray
from ...programs import require_memory
from ..draws import on_device

# Steps between two reports, and before starts that lag behind are dropped.
BLOCK = 20
MEMORY = 20
# Searches nearer than this share of the starts' standard deviation have come together.
TOGETHER = 0.05
# So many steps in a row that gain next to nothing end a search.
PATIENCE = 5
# The ends of SciPy's own are switched off: they look at one step alone.
OPTIONS = {"maxcor": MEMORY, "ftol": 0.0, "gtol": 0.0, "maxiter": 2**31 - 1, "maxfun": 2**31 - 1}

# A search that may take longer is told of before it begins.
HOURS = 1.0
SMALLER = "Give fewer or shorter recordings, a lower frame rate or a shorter horizon"

LogDensity = Callable[..., Array]
# Values (s,) and gradients (s, n) of what is made small, at points (s, n).
Evaluate = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


class _Ended(Exception):
    """A search was ended from outside."""


class Search:
    """A search for the smallest value of a function of n unknowns.

    u, value, gradient
        Where it stands; the value is infinite where there is none.
    wanted
        Point whose value and gradient it waits for; None when it has ended.
    still
        Steps in a row that gained next to nothing.
    steps
        Steps taken.
    """

    def __init__(self, executor: Executor, u: Float[np.ndarray, " n"], tolerance: float) -> None:
        self.u, self.value, self.gradient = np.array(u, dtype=float), np.inf, np.zeros(len(u))
        self.wanted: np.ndarray | None = None
        self.still, self.steps = 0, 0
        self._tolerance = tolerance
        self._last = (self.u, self.value, self.gradient)
        self._points: SimpleQueue[np.ndarray | None] = SimpleQueue()
        self._values: SimpleQueue[tuple[float, np.ndarray] | None] = SimpleQueue()
        self._run = executor.submit(self._search)

    @property
    def converged(self) -> bool:
        """Whether nothing more was to gain."""
        return self.still >= PATIENCE and bool(np.isfinite(self.value))

    def tell(self, value: float, gradient: Float[np.ndarray, " n"]) -> None:
        """Give the value and gradient at `wanted`; the search goes on meanwhile."""
        self._values.put((float(value), np.asarray(gradient, dtype=float)))

    def wait(self) -> None:
        """Wait for the next point that is wanted, or the end.

        Raises
        ------
        Exception
            What the search itself raised.
        """
        self.wanted = self._points.get()
        if self.wanted is None:
            self._run.result()

    def end(self) -> None:
        """End a search that waits for a value."""
        self._values.put(None)

    def _search(self) -> None:
        try:
            first = self._ask(self.u)
            if not _sound(*first):
                self.still = PATIENCE
            self.value, self.gradient = first if _sound(*first) else (np.inf, self.gradient)
            while self.still < PATIENCE:
                # Where SciPy finds no step its memory misleads: it begins anew, without.
                scipy.optimize.minimize(
                    self._function, self.u, jac=True, method="L-BFGS-B",
                    callback=self._stepped, options=OPTIONS,
                )  # fmt: skip
                self.still += self.still < PATIENCE
        except _Ended:
            pass
        finally:
            self._points.put(None)

    def _ask(self, u: np.ndarray) -> tuple[float, np.ndarray]:
        self._points.put(np.array(u))
        told = self._values.get()
        if told is None:
            raise _Ended
        return told

    def _function(self, u: np.ndarray) -> tuple[float, np.ndarray]:
        """Give value and gradient; where there is none a rise like the fall that was hoped for."""
        if np.array_equal(u, self.u):
            value, gradient = self.value, self.gradient
        else:
            value, gradient = self._ask(u)
        self._last = (np.array(u), value, gradient)
        if _sound(value, gradient):
            return value, gradient
        return self.value + abs(float(self.gradient @ (u - self.u))), -self.gradient

    def _stepped(self, intermediate_result: scipy.optimize.OptimizeResult) -> None:
        u, value, gradient = self._last
        if not _sound(value, gradient) or not np.array_equal(u, intermediate_result.x):
            raise StopIteration
        gain = self.value - value
        small = gain <= self._tolerance * (abs(self.value) + 1.0)
        self.u, self.value, self.gradient = self._last
        self.steps += 1
        self.still = self.still + 1 if small else 0
        if self.still >= PATIENCE:
            raise StopIteration


def _sound(value: float, gradient: np.ndarray) -> bool:
    return bool(np.isfinite(value)) and bool(np.isfinite(gradient).all())


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


def stack(starts: Sequence[Mapping[str, AnyArray]]) -> dict[str, np.ndarray]:
    """Stack the values of several starts along a leading axis."""
    return {name: np.stack([np.asarray(s[name]) for s in starts]) for name in starts[0]}


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
        After `trial_steps` steps go on with so many starts, the best, of those that have come
        together only one as long as there are others.
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

    Raises
    ------
    InputError
        If an evaluation takes more memory than is free.

    Warns
    -----
    MotionWarning
        If all of them may take hours.
    """
    roots = on_device(dict(roots or {}))
    if roots:
        starts = {**starts, **{name: _solve(R, starts[name]) for name, R in roots.items()}}
    flat, unravel = _ravel(starts)
    data = on_device(data)  # once, not with every call
    keep = len(flat) if keep is None else min(keep, len(flat))
    lanes = min(together, len(flat))

    def evaluate(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # Filled up to the number of lanes that the function is compiled for.
        filled = np.concatenate([u, np.repeat(u[-1:], lanes - len(u), axis=0)])
        return jax.device_get(_values(log_density, unravel, filled, roots, data))

    first = np.repeat(flat[:1], lanes, axis=0)
    asked = (log_density, unravel, first, roots, data)
    require_memory("the log density", _values, *asked, mend=SMALLER)
    _tell_of_hours(evaluate, first, len(flat) * trial_steps + keep * max_steps)
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
                if limit >= trial_steps and len(best) > keep:
                    best = _of_most_optima(best, keep, flat[np.isfinite(flat).all(axis=1)])
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


def slopes(
    log_density: LogDensity,
    unravel: "Unravel",
    points: Float[np.ndarray, "k n"],
    data: Any,
    *,
    together: int = 1,
) -> Float[np.ndarray, "k n"]:
    """Compute the gradients of minus a log density, by the program that `maximise` climbs with.

    Parameters
    ----------
    log_density, data, together
        As in `maximise`: after a search with the same nothing is compiled.
    unravel
        Makes its argument of a flat vector.
    points
        K of these.

    Raises
    ------
    InputError
        If an evaluation takes more memory than is free.
    """
    data = on_device(data)
    rows = np.arange(-(-len(points) // together) * together).reshape(-1, together)
    blocks = np.asarray(points, dtype=float)[np.minimum(rows, len(points) - 1)]
    require_memory(
        "the log density", _values, log_density, unravel, blocks[0], {}, data, mend=SMALLER
    )
    found = [jax.device_get(_values(log_density, unravel, u, {}, data)[1]) for u in blocks]
    return np.concatenate(found)[: len(points)]


def _tell_of_hours(evaluate: Evaluate, u: Float[np.ndarray, "s n"], most: int) -> None:
    """Warn where so many evaluations, so many at a time, may take hours."""
    began = time.perf_counter()
    evaluate(u)
    seconds = time.perf_counter() - began
    if (hours := seconds * most / len(u) / 3600.0) > HOURS:
        warnings.warn(
            f"the search may take up to {hours:.1f} hours: one evaluation of the log density takes "
            f"{seconds:.1f} s. {SMALLER}, or stop it earlier (max_steps)",
            MotionWarning,
            stacklevel=3,
        )


def _limits(max_steps: int, trial_steps: int | None, by_blocks: bool) -> list[int]:
    """Give the numbers of steps at which searches wait for each other."""
    blocks = range(BLOCK, max_steps, BLOCK) if by_blocks else []
    trial = [] if trial_steps is None else [min(trial_steps, max_steps)]
    return sorted({*blocks, *trial, max_steps})


def _of_most_optima(
    ranked: Sequence[Search], keep: int, starts: Float[np.ndarray, "s n"]
) -> list[Search]:
    """Return so many searches, of those that have come together the best first."""
    spread = starts.std(axis=0) if len(starts) else np.ones(len(ranked[0].u))
    scale = np.where(spread > 0.0, spread, 1.0)
    alone: list[Search] = []
    for search in ranked:
        if all(np.sqrt(np.mean(((search.u - o.u) / scale) ** 2)) > TOGETHER for o in alone):
            alone.append(search)
    others = [search for search in ranked if search not in alone]
    return sorted([*alone, *others][:keep], key=lambda search: search.value)


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

    def __call__(self, u: AnyArray) -> Any:
        """Give the pytree whose leaves, one after the other, are u: of its own kind of arrays."""
        sizes = [int(np.prod(shape)) for shape in self.shapes]
        # Outside of programs nothing is compiled for it.
        split = np.split if isinstance(u, np.ndarray) else jnp.split
        pieces = split(u, np.cumsum(sizes)[:-1])
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


def flattened(values: Any) -> Float[np.ndarray, " n"]:
    """Return the leaves of a pytree of numbers one after the other, as `Unravel` takes them."""
    return np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(values)])


def _ravel(starts: Any) -> tuple[Float[np.ndarray, "s n"], Unravel]:
    starts = jax.tree.map(lambda leaf: np.asarray(leaf, dtype=float), starts)
    leaves = jax.tree.leaves(starts)
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

    if len(u) > 1:
        return jax.vmap(jax.value_and_grad(loss))(u)
    # Of a batch, choices between ways to compute are all computed.
    value, gradient = jax.value_and_grad(loss)(u[0])
    return value[None], gradient[None]


@partial(jax.jit, static_argnames="unravel")
def _sites(unravel: Unravel, u: Float[AnyArray, "s n"], roots: Mapping[str, AnyArray]) -> Any:
    """Give the values of the sites (s, ...) at points."""
    return jax.vmap(lambda one: _mapped(unravel(one), roots))(u)
