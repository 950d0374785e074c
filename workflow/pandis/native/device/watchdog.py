"""A process of its own that ends a device's force when the run's process is killed or halted."""

import contextlib
import ctypes
import mmap
import subprocess
import sys
import tempfile
import time

#: As in ``watchdog.h``.
STARTS, READY, REFUSED, OVER = range(4)
#: Seconds in which a process that starts and opens the device has to say so.
_PATIENCE = 5.0
_PROGRAM = (
    "import ctypes, sys; compiled, library, name, file = sys.argv[1:]; "
    "ctypes.CDLL(compiled).client_watch(library.encode(), name.encode(), int(file))"
)


class _Pulse(ctypes.Structure):
    _fields_ = (("beat", ctypes.c_longlong), ("state", ctypes.c_int))


class Watchdog:
    """Starts the process, once the run has the device; used as a context around the run.

    Parameters
    ----------
    compiled : str
        The library of ``client.c``.
    library, name : str
        Of the device: see `pandis.native.device.run_device`.

    Attributes
    ----------
    pulse : ctypes.Structure
        What both processes share.
    """

    def __init__(self, compiled, library, name):
        self._words, self._process = (compiled, library, name), None

    def __enter__(self):
        self._file = tempfile.TemporaryFile()
        self._file.truncate(mmap.PAGESIZE)
        self._memory = mmap.mmap(self._file.fileno(), mmap.PAGESIZE)
        self.pulse = _Pulse.from_buffer(self._memory)
        return self

    def __exit__(self, *_):
        self.pulse.state = OVER
        if self._process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_PATIENCE)
        self._file.close()

    def start(self):
        """Start the process; return 1 once it has the device, 0 if it cannot."""
        file = self._file.fileno()
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", "-c", _PROGRAM, *self._words, str(file)],
                pass_fds=[file], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL, start_new_session=True,
            )  # fmt: skip
        except OSError:
            return 0
        until = time.monotonic() + _PATIENCE
        while self.pulse.state == STARTS and time.monotonic() < until:
            if self._process.poll() is not None:
                return 0
            time.sleep(0.002)
        return int(self.pulse.state == READY)
