"""Where a model's own search stands, so that one that is killed goes on as if it had not been.

A search asks for what was kept, takes its steps, and after each says where it stands; on disk
that is written every few seconds.
"""

import time
from collections.abc import Callable, Mapping

import numpy as np

from .gp.linalg import AnyArray

SECONDS = 5.0  # between two writings
Write = Callable[[Mapping[str, np.ndarray]], None]
STEPS, LIMIT, ENDED = "steps_taken", "steps_at_most", "ended"


class SearchState:
    """The state of one search.

    Parameters
    ----------
    write
        Keeps arrays; without it nothing is kept.
    saved
        What was kept before; None for a search that begins.

    Examples
    --------
    >>> from bayesmotion.search_state import SearchState
    >>> state = SearchState()
    >>> state.steps(max_steps=10)
    (0, 10)
    """

    def __init__(
        self, write: Write | None = None, saved: Mapping[str, np.ndarray] | None = None
    ) -> None:
        self.saved = None if saved is None else dict(saved)
        self._write, self._written = write, time.monotonic()

    def steps(self, max_steps: int) -> tuple[int, int]:
        """Return how many steps were taken, and how many may be taken in all.

        A search that was cut off ends where it would have ended; one that came to its limit
        without converging has `max_steps` more.
        """
        if self.saved is None:
            return 0, max_steps
        taken, limit = int(self.saved[STEPS]), int(self.saved[LIMIT])
        return taken, taken + max_steps if bool(self.saved[ENDED]) else limit

    def keep(self, taken: int, limit: int, arrays: Callable[[], Mapping[str, AnyArray]]) -> None:
        """Say where the search stands after a step; the last step is always written."""
        if taken < limit and time.monotonic() - self._written < SECONDS:
            return
        steps = {STEPS: np.array(taken), LIMIT: np.array(limit), ENDED: np.array(False)}
        kept = {name: np.array(value) for name, value in arrays().items()}
        self.saved = {**kept, **steps}
        if self._write is not None:
            self._write(self.saved)
        self._written = time.monotonic()

    def end(self) -> None:
        """Say that the search came to its limit without converging."""
        if self.saved is not None and self._write is not None:
            self._write({**self.saved, ENDED: np.array(True)})
