"""What every run of programs needs: to be the only one at a time, in double precision, and room.

JAX keeps every program that it compiled, each in some tens of memory mappings, of which Linux
gives a process 65,530. A process that fits model after model would come to their end, and die.
"""

import functools
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jax
from jaxtyping import config

from .errors import InputError

# Enough mappings are left for what the largest fits compile.
MAPPINGS = 25_000
_MAPS, _MEMORY = Path("/proc/self/maps"), Path("/proc/meminfo")
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


def few_lengths(count: int) -> int:
    """Return the least of few lengths that is not below a number of frames.

    They are multiples of 16, and of larger powers of two from 256 on, so that at most an eighth is
    added to long recordings. Programs are compiled for shapes: one serves all recordings of a
    length.

    >>> few_lengths(65), few_lengths(80), few_lengths(1001)
    (80, 80, 1024)
    """
    step = max(16, 1 << max(count.bit_length() - 4, 0))
    return -(-count // step) * step


def forget_programs(most: int = MAPPINGS) -> bool:
    """Forget all compiled programs where this process holds many memory mappings.

    What is called again is compiled again. `bayesmotion.fit` begins with this; long loops over
    fits that do not go through it call it themselves.

    Parameters
    ----------
    most
        Mappings up to which nothing is forgotten.

    Returns
    -------
    Whether programs were forgotten; never where the system does not tell of its mappings.
    """
    if not _MAPS.exists() or _MAPS.read_bytes().count(b"\n") <= most:
        return False
    jax.clear_caches()
    return True


def require_memory(what: str, program: Any, *arguments: Any, mend: str) -> None:
    """Refuse a compiled program that takes more memory than is free, before it is run.

    Parameters
    ----------
    what
        What it computes, as users call it.
    program
        A function that `jax.jit` gave; it is compiled for the arguments, as a call would.
    arguments
        Those of the call.
    mend
        What to do where there is too little.

    Raises
    ------
    InputError
        If it takes more, with how much.
    """
    traced = program.trace(*arguments)
    with _shapes_unchecked():
        lowered = traced.lower()
    found = lowered.compile().memory_analysis()
    needed = found.temp_size_in_bytes + found.output_size_in_bytes
    if (free := free_memory()) is not None and needed > free:
        raise InputError(
            what,
            f"it takes {needed / 2**30:.1f} GB of memory, {free / 2**30:.1f} GB are free",
            mend,
        )


@contextmanager
def _shapes_unchecked() -> Iterator[None]:
    """Let JAX put descriptions in the place of arrays, which checks of shapes would refuse."""
    was = config.jaxtyping_disable
    config.update("jaxtyping_disable", True)
    try:
        yield
    finally:
        config.update("jaxtyping_disable", was)


def free_memory() -> int | None:
    """Return how many bytes of memory are free for this process; None where nothing tells."""
    if _MEMORY.exists():
        rows = dict(line.split(":", 1) for line in _MEMORY.read_text().splitlines())
        if "MemAvailable" in rows:
            return int(rows["MemAvailable"].split()[0]) * 1024
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return None
