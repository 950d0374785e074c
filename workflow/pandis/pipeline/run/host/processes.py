"""Runs Python code in several processes, because of the GIL.

Each process is forked and so shares its parent's data: only the index of an item is sent to it.
"""

import ctypes
import os
import signal
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing import active_children, get_context

from pandis.base.errors import PandisError

_TASK = {}


def each(work, items, count):
    """Yield ``work(item)`` for every item, in order, computing up to ``count`` at a time.

    Parameters
    ----------
    work : callable
        Its return value is sent to the parent. Native code that it calls runs on one thread, unless
        there is only one process: then nothing is forked.
    items : sequence
    count : int
        Largest number of processes.
    """
    count = min(count, len(items))
    if count <= 1:
        yield from map(work, items)
        return
    with ProcessPoolExecutor(count, get_context("fork"), _begin, (work, items)) as pool:
        try:
            yield from pool.map(_do, range(len(items)))
        except BrokenProcessPool as error:
            raise PandisError(
                "a process of this stage was killed, perhaps because memory ran out; run the same "
                "command again, with one thread if memory is short (-j1)"
            ) from error
        except BaseException:
            for process in active_children():
                process.kill()  # otherwise the pool would wait for their items
            raise


def _begin(work, items):
    """Leave interrupts to the parent, and end this process whenever the parent ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # Linux: PR_SET_PDEATHSIG
    os.environ["IGL_NUM_THREADS"] = "1"
    _TASK.update(work=work, items=items)


def _do(index):
    return _TASK["work"](_TASK["items"][index])
