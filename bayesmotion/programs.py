"""What every run of a program needs: to be the only one at a time, in double precision."""

import functools
import threading
from collections.abc import Callable

import jax

from .errors import InputError

# NumPyro keeps the handlers that are active in one list for all threads: programs that run at
# the same time would see each other's sites.
_LOCK = threading.RLock()


def one_at_a_time[**P, R](function: Callable[P, R]) -> Callable[P, R]:
    """Return a function that waits until no other thread runs a program; usable as a decorator.

    Raises
    ------
    InputError
        From the function, if JAX was told to work in single precision.
    """

    @functools.wraps(function)
    def alone(*args: P.args, **kwargs: P.kwargs) -> R:
        if not jax.config.jax_enable_x64:  # pyright: ignore[reportAttributeAccessIssue]
            raise InputError(
                "jax_enable_x64", "it was switched off, and covariances need double precision",
                "Call jax.config.update('jax_enable_x64', True)",
            )  # fmt: skip
        with _LOCK:
            return function(*args, **kwargs)

    return alone
