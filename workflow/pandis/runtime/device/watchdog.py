"""A separate process that ends a device's force when the run's process is killed or halted."""

import ctypes
import mmap
import os
import subprocess
import sys
import time

#: States in ``watchdog.h``.
STARTS, READY, REFUSED, OVER = range(4)
#: Time allowed for the process to start and open the device, and later to end, s.
_PATIENCE = 5.0
_PROGRAM = (
    "import ctypes, sys; compiled, library, name, file, run = sys.argv[1:]; "
    "ctypes.CDLL(compiled).client_watch(library.encode(), name.encode(), int(file), int(run))"
)


class _Pulse(ctypes.Structure):
    _fields_ = (("beat", ctypes.c_longlong), ("state", ctypes.c_int))


class Watchdog:
    """A context manager around a run; starts the process once the run has opened the device.

    Parameters
    ----------
    compiled : str
        Path of the library compiled from ``client.c``.
    library, name : str
        Library and name of the device: see `pandis.runtime.device.run_device`.

    Attributes
    ----------
    pulse : ctypes.Structure
        State shared by both processes.
    """

    def __init__(self, compiled, library, name):
        self._words, self._process = (compiled, library, name), None

    def __enter__(self):
        # in memory: a tick that writes to a file on disk may block
        self._file = os.memfd_create("pandis-pulse")
        os.ftruncate(self._file, mmap.PAGESIZE)
        self._memory = mmap.mmap(self._file, mmap.PAGESIZE)
        self.pulse = _Pulse.from_buffer(self._memory)
        return self

    def __exit__(self, *_):
        self.pulse.state = OVER
        self._end(_PATIENCE)
        os.close(self._file)

    def _end(self, patience):
        """Wait up to ``patience`` seconds for the process to end, then kill it."""
        if self._process is None:
            return
        try:
            self._process.wait(patience)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def start(self):
        """Start the process; return 1 once it has opened the device, 0 if it cannot."""
        numbers = str(self._file), str(os.getpid())
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", "-c", _PROGRAM, *self._words, *numbers],
                pass_fds=[self._file], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL, start_new_session=True,
            )  # fmt: skip
        except OSError:
            return 0
        until = time.monotonic() + _PATIENCE
        while self.pulse.state == STARTS and time.monotonic() < until:
            if self._process.poll() is not None:
                return 0
            time.sleep(0.002)
        if self.pulse.state == READY:
            return 1
        self.pulse.state = OVER
        self._end(0)
        return 0
