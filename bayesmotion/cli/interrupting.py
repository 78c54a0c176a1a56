"""Ctrl-C that ends a command within seconds, whatever it is at.

Python raises KeyboardInterrupt only between two steps of its own: compiled code that runs
for minutes is not left before it is done, and at its end a process waits for computations
that it has begun. The signal itself is heard at once all the same. From then on the command
has some seconds to put its files in order; after that the process is ended.
"""

import contextlib
import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from typing import Any

from .. import console

INTERRUPTED = 130
SECONDS = 3.0
STOPPED = (
    "interrupted; files that were there are as they were. What keeps a state goes on with --resume."
)


@contextlib.contextmanager
def ended_when_interrupted() -> Iterator[None]:
    """End the process with 130 at most `SECONDS` after Ctrl-C in the block.

    A KeyboardInterrupt that no signal brought about goes on as it is.
    """
    main = threading.current_thread() is threading.main_thread()
    before = signal.getsignal(signal.SIGINT)
    if not main or before is not signal.default_int_handler:
        yield  # signals are heard by the main thread alone, and not where they are ignored
        return
    signalled = threading.Event()

    def handle(number: int, frame: Any) -> None:
        signalled.set()
        signal.default_int_handler(number, frame)

    heard, told = socket.socketpair()
    told.setblocking(False)
    signal.signal(signal.SIGINT, handle)
    wakeup = signal.set_wakeup_fd(told.fileno(), warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(heard,), daemon=True).start()
    try:
        yield
    except KeyboardInterrupt:
        if signalled.is_set():
            _end()
        raise
    finally:
        signal.set_wakeup_fd(wakeup)
        signal.signal(signal.SIGINT, before)
        told.close()


def tell_interrupted() -> None:
    """Say that the command was interrupted, where anybody still listens."""
    with contextlib.suppress(OSError):
        console.error(STOPPED)


def _watch(heard: socket.socket) -> None:
    """Wait for the signal, or for the end of the block; after the signal only so long."""
    with heard:
        if signal.SIGINT in heard.recv(64):
            threading.Event().wait(SECONDS)
            _end()


def _end() -> None:
    """End the process at once: without waiting for computations, which nobody can stop."""
    tell_interrupted()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    os._exit(INTERRUPTED)
