"""SciPy's L-BFGS-B as a search that is asked for points and told values.

SciPy calls the function; here the function is called for many searches at a time, so each
runs in a thread of its own, which waits for the value at the point it wants next. Between
two values a search can be left waiting, to go on later as if nothing had been, or ended.
"""

from concurrent.futures import Executor
from queue import SimpleQueue

import numpy as np
import scipy.optimize
from jaxtyping import Float

MEMORY = 20
# So many steps in a row that gain next to nothing end a search.
PATIENCE = 5
# The ends of SciPy's own are switched off: they look at one step alone.
OPTIONS = {"maxcor": MEMORY, "ftol": 0.0, "gtol": 0.0, "maxiter": 2**31 - 1, "maxfun": 2**31 - 1}


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
