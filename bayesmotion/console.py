"""What the command line shows: one progress bar, one table, one way errors are told.

Results go to standard output; progress, notes and errors go to standard error, so
that output can be piped.
"""

import sys
import threading
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from .errors import MotionWarning

NAME = "bayesmotion"
UNLIMITED = 100_000  # characters of a line in a pipe
EVERY = 30.0  # seconds between two signs of life where no terminal is


class Advance(Protocol):
    """Tell how much is done and, where there is one, the best log density so far."""

    def __call__(self, done: int, best: float | None = None, /) -> None:
        """Show it."""
        ...


@contextmanager
def progress(title: str, total: int, unit: str = "steps") -> Iterator[Advance]:
    """Show a progress bar while the block runs; where no terminal is, a line now and then.

    Gives a function to be called with the steps done, and with the best log density so
    far where there is one, as `fit_map` does.
    """
    screen = Console(stderr=True)
    if not screen.is_terminal:
        with _lines(title, total, unit) as advance:
            yield advance
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn(f"{{task.completed}}/{{task.total}} {unit}"),
        TextColumn("{task.fields[note]}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=screen, transient=True) as bar:
        task = bar.add_task(title, total=total, note="")

        def advance(done: int, best: float | None = None, /) -> None:
            told = "" if best is None else f"log density {best:.1f}"
            bar.update(task, completed=done, note=told)

        yield advance


@contextmanager
def _lines(title: str, total: int, unit: str) -> Iterator[Advance]:
    """Tell every `EVERY` seconds how far the block is, also while nothing advances."""
    began, state, left = time.monotonic(), [0, ""], threading.Event()

    def advance(done: int, best: float | None = None, /) -> None:
        state[:] = [done, "" if best is None else f", log density {best:.1f}"]

    def tell() -> None:
        while not left.wait(EVERY):
            done, best = state
            note(f"{title}: {done}/{total} {unit} after {time.monotonic() - began:.0f} s{best}")

    teller = threading.Thread(target=tell, daemon=True)
    teller.start()
    try:
        yield advance
    finally:
        left.set()
        teller.join()


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print a table: the first column to the left, numbers to the right with 3 decimals.

    Where no terminal is, it is as wide as it needs to be: nothing is cut in a pipe.
    """
    grid = Table(box=None, pad_edge=False)
    for index, column in enumerate(columns):
        grid.add_column(column, justify="right" if index else "left", no_wrap=True)
    for row in rows:
        grid.add_row(*(_cell(value) for value in row))
    console = Console(highlight=False, markup=False)
    if not console.is_terminal:
        console = Console(highlight=False, markup=False, width=UNLIMITED)
    console.print(title, style="bold", soft_wrap=True)
    console.print(grid, crop=False)


def say(sentence: str) -> None:
    """Print a line of the result."""
    print(sentence)


def note(sentence: str) -> None:
    """Tell something beside the result, on standard error."""
    print(f"{NAME}: {_one_line(sentence)}", file=sys.stderr)


def error(reason: BaseException | str) -> None:
    """Tell why a command failed: one sentence in one line on standard error."""
    note(str(reason))


@contextmanager
def told_warnings() -> Iterator[None]:
    """Tell warnings about motion in one line each instead of with a place in the code."""
    with warnings.catch_warnings():
        warnings.simplefilter("always", MotionWarning)
        usual = warnings.showwarning

        def show(message, category, filename, lineno, file=None, line=None) -> None:
            if issubclass(category, MotionWarning):
                note(f"warning: {message}")
            else:
                usual(message, category, filename, lineno, file, line)

        warnings.showwarning = show
        yield


def _one_line(sentence: str) -> str:
    """Put a text of several lines into one."""
    return " ".join(sentence.split())


def _cell(value: object) -> str:
    """Write a value of a table; nothing known is a dash."""
    if value is None:
        return "-"
    return f"{value:.3f}" if isinstance(value, float) else str(value)
