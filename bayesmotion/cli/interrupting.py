"""Ctrl-C answers within seconds, whatever is computed.

Python looks at signals between two of its own steps; one call of compiled code can take
minutes. A thread sees the signal at once, and ends the process where nothing else does.
"""

import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

GRACE = 3.0  # seconds in which the command may end by itself


@contextmanager
def answering_interrupts(message: str, code: int, grace: float = GRACE) -> Iterator[None]:
    """End the process so long after an interrupt if the block has not ended by then.

    Parameters
    ----------
    message
        Written to standard error.
    code
        Exit code.
    grace
        In seconds.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # signals are the main thread's
        return
    ended = threading.Event()
    heard, told = socket.socketpair()
    told.setblocking(False)

    def watch() -> None:
        while number := heard.recv(1):
            if number[0] == signal.SIGINT and not ended.wait(grace):
                os.write(sys.__stderr__.fileno() if sys.__stderr__ else 2, message.encode())
                # Whole files are there or not; hidden parts are removed by who writes next.
                os._exit(code)

    before = signal.set_wakeup_fd(told.fileno(), warn_on_full_buffer=False)
    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        signal.set_wakeup_fd(before)
        told.close()
        thread.join()
        heard.close()
