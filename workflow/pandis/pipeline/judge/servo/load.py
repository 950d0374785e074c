"""Loads every core, to see how a servo loop runs beside other work."""

import os
import subprocess
import sys
from contextlib import contextmanager

#: A busy loop that ends with its parent, however that ends.
_BUSY = "import os\nparent = os.getppid()\nwhile os.getppid() == parent: pass"


@contextmanager
def busy_cores():
    """Keep every core busy with a loop while the body runs."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    loops = [subprocess.Popen([sys.executable, "-I", "-c", _BUSY]) for _ in range(cores)]
    try:
        yield cores
    finally:
        for loop in loops:
            loop.kill()
        for loop in loops:
            loop.wait()
