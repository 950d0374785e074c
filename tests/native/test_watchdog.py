"""What a watchdog does that cannot take the device, or is alone with it."""

import ctypes
import os
import subprocess
import sys

import numpy as np
import pytest
from test_devices import compile_stand_in, needs_gcc, stand_in  # noqa: F401

from pandis.runtime import device as hdapi
from pandis.runtime.device.watchdog import OVER, READY, REFUSED, STARTS

#: As it is started, but that it says what it did, and how the device is left.
WATCH = """
import ctypes, sys
compiled, library, name, file, run = sys.argv[1:]
print(ctypes.CDLL(compiled).client_watch(library.encode(), name.encode(), int(file), int(run)))
"""


def watch(library, name="", fault="", *, state=STARTS, run=None, record=None):
    """Run a watchdog; return what it says, and the state that it leaves."""
    extra = {"PANDIS_FAULT": fault, "PANDIS_SHARED": "1", "PANDIS_RECORD": str(record or "")}
    file = os.memfd_create("pulse")
    os.ftruncate(file, 4096)
    os.pwrite(file, int(state).to_bytes(4, sys.byteorder), ctypes.sizeof(ctypes.c_longlong))
    words = hdapi.library()._name, str(library), name, str(file), str(run or os.getpid())
    done = subprocess.run(
        [sys.executable, "-c", WATCH, *words], env=os.environ | extra, pass_fds=[file],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    left = os.pread(file, 4, ctypes.sizeof(ctypes.c_longlong))
    os.close(file)
    return int(done.stdout), int.from_bytes(left, sys.byteorder)


@pytest.mark.parametrize(
    ("name", "fault"), [("", "init"), ("", "nothing"), ("", "doubtful"), ("Left Device", "")]
)
def test_it_says_that_it_cannot_take_the_device(name, fault, stand_in):  # noqa: F811
    assert watch(stand_in, name, fault) == (0, REFUSED)


@needs_gcc
def test_it_says_that_a_library_is_none_of_hdapi(tmp_path):
    old = compile_stand_in(tmp_path / "libHD.so", "-DhdGetString=hdGetText")
    assert watch(old) == (0, REFUSED)
    assert watch(tmp_path / "none.so") == (0, REFUSED)


def test_without_a_pulse_it_ends(stand_in):  # noqa: F811
    words = str(stand_in).encode(), b"", -1, os.getpid()
    assert hdapi.library().client_watch(*words) == 0


def test_it_lets_go_of_the_device_where_the_run_is_over(stand_in):  # noqa: F811
    assert watch(stand_in, state=OVER) == (0, OVER)


def test_it_ends_the_force_of_a_run_that_is_gone(stand_in, tmp_path):  # noqa: F811
    record = tmp_path / "record"
    for name in ("", "Default Device"):
        np.array([0.5, 0.5, 1.0, 0.0]).tofile(record)  # the motors are on
        assert watch(stand_in, name, run=1 << 22, record=record) == (1, READY)
        assert not np.fromfile(record)[1:3].any()
