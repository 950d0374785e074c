"""Runs operations in processes of their own, with limits on time and memory.

A crafted file can take hours to read, and some tools crash or hang: what happens to such a process
is raised as a `ToolError`.
"""

import ctypes
import errno
import os
import resource
import select
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from pandis.base.errors import PandisError

#: Longest time that timers take, s.
_LONGEST = 1e6
#: Where the system does not list open files, those below this number are closed in a copy.
_DESCRIPTORS = 4096
#: What libraries say when memory is short.
_SHORT_OF_MEMORY = (
    "MemoryError",
    "bad_alloc",
    "std::length",
    "Cannot allocate memory",
    "failed to map segment",
    "cannot map zero-fill pages",
    "can't start new thread",
)


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
            signal.setitimer(signal.ITIMER_PROF, min(max(lent, 1e-3), _LONGEST))

    def stop(self):
        """Stop the timer; return the CPU time (s) since the start."""
        signal.setitimer(signal.ITIMER_PROF, 0)
        return time.process_time() - self._start


def spawned(command, environment, limits):
    """Run a command, which must call `limit_memory` itself; raise an error if it fails.

    A limit set between fork and exec would count the memory of this process, which can be larger.

    Raises
    ------
    LimitError, CpuTimeError, MissingError, ToolError
    """
    try:
        done = subprocess.run(
            command,
            env=environment,
            timeout=min(limits.seconds, _LONGEST),
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise LimitError(f"took longer than {limits.seconds:g} s") from error
    _raise_failure(done.returncode, done.stderr, limits)


def forked(function, limits):
    """Run a function in a copy of this process; raise an error if it fails.

    The copy has everything imported already, and may use `limits.memory_gb` on top of the memory
    of this process. Other threads of this process must be idle, and SIGCHLD must not be ignored.

    Raises
    ------
    LimitError, CpuTimeError, MissingError, ToolError
    """
    with tempfile.TemporaryFile() as errors, ExitStack() as files:
        worker, (reading, writing) = os.getpid(), os.pipe()
        files.callback(os.close, reading)
        try:
            child = os.fork()
        except BaseException:
            os.close(writing)
            raise
        if not child:
            status = 1
            try:  # whatever happens, the copy must not go on as a second worker
                status = _in_child(function, limits, worker, keep=(errors.fileno(), writing))
            finally:
                os._exit(status)
        os.close(writing)
        in_time = _ends_within(reading, limits.seconds, child)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        if not in_time:
            raise LimitError(f"took longer than {limits.seconds:g} s")
        errors.seek(0)
        _raise_failure(status, errors.read().decode(errors="replace"), limits)


def _ends_within(pipe, seconds, child):
    """Wait until a child closes its end of a pipe, or kill it; return whether it was in time."""
    in_time = False
    try:
        ready = select.poll()
        ready.register(pipe, select.POLLIN)
        in_time = bool(ready.poll(1000 * min(seconds, _LONGEST)))
    finally:
        if not in_time:
            os.kill(child, signal.SIGKILL)
    return in_time


def _in_child(function, limits, worker, *, keep):
    """Call a function in a copy of a worker, its errors in a file; return an exit status.

    Of the worker's open files, only those in ``keep`` stay: the file of errors, and the pipe.
    """
    try:
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # Linux: PR_SET_PDEATHSIG
        if os.getppid() != worker:
            return 1
        signal.alarm(int(min(limits.seconds, _LONGEST)) + 2)  # other systems: the worker may end
        nothing = os.open(os.devnull, os.O_RDWR)
        for stream, target in enumerate((nothing, nothing, keep[0])):
            os.dup2(target, stream)
        # a pipe of the worker that stays open here hides the worker's end
        _close_all_but(keep)
        sys.stdout = sys.stderr = os.fdopen(2, "w", errors="backslashreplace", closefd=False)
        if (base := _address_space()) is not None:
            limit_memory(limits.memory_gb, base)
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


def _close_all_but(keep):
    """Close all files but the standard ones and those to keep."""
    try:
        opened = [int(path.name) for path in Path("/proc/self/fd").iterdir()]
    except OSError:
        opened = range(_DESCRIPTORS)
    for descriptor in opened:
        if descriptor > 2 and descriptor not in keep:
            with suppress(OSError):
                os.close(descriptor)


def _address_space():
    """Return the size of this process's address space in bytes; None if the system hides it."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[0])
    except (OSError, ValueError, IndexError):
        return None
    return pages * resource.getpagesize()


def limit_memory(memory_gb, base=0):
    """Limit the address space of this process to ``base`` bytes plus ``memory_gb`` GiB.

    Raises
    ------
    MemoryError
        The address space is already larger.
    """
    memory = base + int(memory_gb * 2**30)
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    if hard != resource.RLIM_INFINITY:
        memory = min(memory, hard)
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if (size := _address_space()) is not None and size > memory:
        raise MemoryError


def lacks_memory(error):
    """Return whether an error, or one that caused it, means that memory was short.

    Messages with a path are not searched: a folder may have any name.
    """
    if error is None:
        return False
    if isinstance(error, PandisError):
        short = str(error).startswith("not enough memory")
    elif isinstance(error, OSError) and error.errno is not None:
        short = error.errno == errno.ENOMEM
    elif isinstance(error, OSError | ImportError | RuntimeError):
        short = _says_memory(str(error))  # shared libraries that fail to load give no number
    else:
        short = isinstance(error, MemoryError)
    return short or lacks_memory(error.__cause__)


def _says_memory(text):
    return any(words in text for words in _SHORT_OF_MEMORY)


def _raise_failure(status, errors, limits):
    """Raise the error that an exit status and the standard error stand for, if any."""
    if not status:
        return
    message = (errors.strip().splitlines() or ["no message"])[-1]
    kind, _, what = message.partition(": ")
    # a line of our own may contain a path
    uncaught = "Traceback" in errors and kind in ("ImportError", "OSError", "RuntimeError")
    short = (uncaught and _says_memory(what)) or (status < 0 and _says_memory(errors))
    if kind.endswith("MemoryError") or short:
        raise LimitError(f"needs more than {limits.memory_gb:g} GiB of memory")
    if limits.cpu is not None and status == -signal.SIGPROF:
        lent, limits.cpu.left = limits.cpu.left, 0.0
        raise CpuTimeError(f"took longer than {lent:.2g} CPU s")
    if status < 0:
        raise ToolError(f"crashed (signal {-status})")
    raise MissingError(what) if kind == "ModuleNotFoundError" else ToolError(message)
