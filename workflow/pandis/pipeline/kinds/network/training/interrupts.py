"""Handles Ctrl-C during training: the current step finishes, and its state is kept."""

import signal
import threading
from contextlib import contextmanager


@contextmanager
def noted():
    """Record the first request to stop instead of raising; a second raises KeyboardInterrupt.

    Yields
    ------
    callable
        Returns whether the process has received SIGINT or SIGTERM.
    """
    signals = []
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False  # signals reach only the main thread
        return

    def note(number, frame):
        del frame
        if signals:
            raise KeyboardInterrupt
        signals.append(number)

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: bool(signals)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
