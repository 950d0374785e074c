"""Runs native code on several threads: ctypes releases the GIL during a call."""

import os
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

#: Fewer points than this are not worth a second thread.
SMALL = 2048
#: Pieces per thread. Durations differ, and smaller pieces shorten the wait for the last one.
_PIECES = 8


def thread_count():
    """Return the number of threads for native code: as set by the stage, else one per core."""
    variable = os.environ.get("IGL_NUM_THREADS", "")
    return (
        int(variable) if variable.isdigit() and int(variable) > 0 else len(os.sched_getaffinity(0))
    )


def in_threads(part, count, parts=None, *, small=SMALL):
    """Call ``part(low, high)`` for pieces of ``range(count)``, on threads if count is large.

    Parameters
    ----------
    part : callable
    count : int
    parts : int, optional
        Number of pieces; by default several per thread.
    small : int
        Count from which a second thread is used. Each further thread requires half that count more.

    Returns
    -------
    list
        Results of the calls, in order.
    """
    threads = 2 * count // small
    threads = min(thread_count(), threads) if threads > 1 else 1
    parts = parts or (threads if threads == 1 else _PIECES * threads)
    edges = [count * k // parts for k in range(parts + 1)]
    if threads == 1 or parts == 1:
        return [part(low, high) for low, high in pairwise(edges)]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(part, edges[:-1], edges[1:]))
