"""Native code on several threads: ctypes lets go of Python's lock while it runs."""

import os
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

#: Fewer points than this are not worth a second thread.
SMALL = 2048


def thread_count():
    """Return how many threads native code may use: what the stage was given, else all cores."""
    given = os.environ.get("IGL_NUM_THREADS", "")
    return int(given) if given.isdigit() and int(given) > 0 else core_count()


def core_count():
    """Return how many cores this process may run on, whatever the stage was given."""
    return len(os.sched_getaffinity(0))


def in_threads(part, count, parts=None, threads=None, small=SMALL):
    """Call ``part(low, high)`` for pieces of ``range(count)``, on threads if it is long.

    Parameters
    ----------
    part : callable
    count : int
    parts : int, optional
        How many pieces; by default as many as there are threads.
    threads : int, optional
        By default `thread_count`.
    small : int
        So few are not worth a second thread.

    Returns
    -------
    list
        What the calls returned, in order.
    """
    threads = (threads or thread_count()) if count >= small else 1
    parts = parts or threads
    edges = [count * k // parts for k in range(parts + 1)]
    if threads == 1 or parts == 1:
        return [part(low, high) for low, high in pairwise(edges)]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(part, edges[:-1], edges[1:]))
