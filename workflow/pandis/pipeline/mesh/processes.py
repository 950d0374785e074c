"""Runs operations in processes of their own, with limits on time and memory.

A crafted file can take hours to read, and some tools crash or hang: what happens to such a process
becomes a `ToolError` here.
"""

import os
import resource
import select
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from dataclasses import dataclass
from typing import NamedTuple


class ToolError(Exception):
    """A tool failed; the message is a short reason."""


class LimitError(ToolError):
    """A tool needed more time or memory than allowed."""


class CpuTimeError(ToolError):
    """A tool needed more CPU time than it was lent."""


class MissingError(ToolError):
    """A tool's package cannot be imported; the message names it."""


@dataclass
class CpuTime:
    """CPU time (s) that operations may still use; starting a process does not count."""

    left: float


class Limits(NamedTuple):
    """Limits of an operation: time (s), memory (GiB), and the CPU time that is lent to it."""

    seconds: float
    memory_gb: float
    cpu: CpuTime | None = None


class Clock:
    """Measures the CPU time of an operation, and ends this process if it is more than lent."""

    def __init__(self, lent):
        self._start = time.process_time()
        if lent is not None:
            signal.signal(signal.SIGPROF, signal.SIG_DFL)
            signal.setitimer(signal.ITIMER_PROF, max(lent, 1e-3))

    def spent(self):
        """Return the CPU time (s) since the start."""
        return time.process_time() - self._start


def spawned(command, environment, limits):
    """Run a command, which must call `restrict` itself; raise what became of it if it fails.

    A limit set between fork and exec would count the memory of this process, which can be larger.

    Raises
    ------
    LimitError, CpuTimeError, MissingError, ToolError
    """
    try:
        done = subprocess.run(
            command,
            env=environment,
            timeout=limits.seconds,
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise LimitError(f"took longer than {limits.seconds:g} s") from error
    _explain(done.returncode, done.stderr, limits)


def forked(function, limits):
    """Run a function in a copy of this process; raise what became of it if it fails.

    It starts at once, with everything imported. Only for processes whose other threads are idle.

    Raises
    ------
    LimitError, CpuTimeError, MissingError, ToolError
    """
    end, theirs = os.pipe()
    with tempfile.TemporaryFile() as errors:
        child = os.fork()
        if not child:
            os._exit(_in_child(function, limits, errors))
        os.close(theirs)  # the other end is closed when the child ends
        in_time = select.select([end], [], [], limits.seconds)[0]
        os.close(end)
        if not in_time:
            os.kill(child, signal.SIGKILL)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        if not in_time:
            raise LimitError(f"took longer than {limits.seconds:g} s")
        errors.seek(0)
        _explain(status, errors.read().decode(errors="replace"), limits)


def _in_child(function, limits, errors):
    """Call a function with its output in a file; return an exit status."""
    try:
        for stream in (1, 2):
            os.dup2(errors.fileno(), stream)
        sys.stdout = sys.stderr = os.fdopen(2, "w", closefd=False)
        restrict(limits.memory_gb)
        function()
    except SystemExit as end:
        if isinstance(end.code, str):
            print(end.code, file=sys.stderr, flush=True)
        return 1 if end.code else 0
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
        return 1
    return 0


def restrict(memory_gb):
    """Limit the memory of this process (GiB)."""
    memory = int(memory_gb * 2**30)
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    if hard != resource.RLIM_INFINITY:
        memory = min(memory, hard)
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _explain(status, errors, limits):
    """Raise what an exit status and the standard error mean."""
    if not status:
        return
    if any(word in errors for word in ("MemoryError", "bad_alloc", "std::length")):
        raise LimitError(f"needs more than {limits.memory_gb:g} GiB of memory")
    if limits.cpu is not None and status == -signal.SIGPROF:
        lent, limits.cpu.left = limits.cpu.left, 0.0
        raise CpuTimeError(f"took longer than {lent:.2g} CPU s")
    if status < 0:
        raise ToolError(f"crashed (signal {-status})")
    message = (errors.strip().splitlines() or ["no message"])[-1]
    kind, _, what = message.partition(": ")
    raise MissingError(what) if kind == "ModuleNotFoundError" else ToolError(message)
