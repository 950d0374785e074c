"""Loads every core, to test how a servo loop runs alongside other work."""

import os
import subprocess
import sys
from contextlib import contextmanager

#: Program of a busy loop that ends when its parent process ends, even if the parent is killed.
_BUSY = "import os\nparent = os.getppid()\nwhile os.getppid() == parent: pass"


@contextmanager
def busy_cores():
    """Keep every core busy while the ``with`` block runs; yield the number of cores."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    loops = [subprocess.Popen([sys.executable, "-I", "-c", _BUSY]) for _ in range(cores)]
    try:
        yield cores
    finally:
        for loop in loops:
            loop.kill()
        for loop in loops:
            loop.wait()
