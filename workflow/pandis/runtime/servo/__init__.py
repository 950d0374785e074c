"""The servo loop: the binding of ``servo.c``."""

import ctypes
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pandis.engine.compiler import load

_LOCKED, _REALTIME = 1, 2
#: Time, s, of polling before each tick: sleeping is not accurate enough, and it evicts data from
#: the caches.
SPIN = 2.5e-4


class Run(NamedTuple):
    """Measurements of a servo run, per tick.

    Attributes
    ----------
    compute : ndarray, shape (n,)
        Seconds to compute the force.
    lateness : ndarray, shape (n,)
        Seconds between the tick's due time and its start.
    force : ndarray, shape (n, 3)
        Force at stiffness 1, mesh units; zero where nothing was computed.
    locked, realtime : bool
        Whether the system allowed locked memory and real-time priority.
    """

    compute: np.ndarray
    lateness: np.ndarray
    force: np.ndarray
    locked: bool
    realtime: bool


@cache
def library():
    """Return the compiled library with its functions' types declared."""
    lib = load(Path(__file__).with_name("servo.c"))
    pointer, i64 = ctypes.c_void_p, ctypes.c_int64
    path, ticks = [pointer, pointer, i64, ctypes.c_double], [i64, i64, i64, ctypes.c_int]
    lib.servo_run.argtypes = [*path, *ticks, *[pointer] * 3]
    return lib


def run_ticks(field, points, count, *, rate, again=True):
    """Compute a field's force once per tick of a fixed-rate clock.

    Parameters
    ----------
    field : pandis.runtime.field.NativeField or None
        None: run the clock without work.
    points : ndarray, shape (m, 3), mesh units
        The probe's path; repeated as often as needed.
    count : int
        Number of ticks.
    rate : float
        Ticks per second.
    again : bool
        Whether to repeat the last query while waiting for a tick, because sleeping evicts the
        field's bytes from the caches.

    Returns
    -------
    Run
    """
    points = np.ascontiguousarray(points, np.float64).reshape(-1, 3)
    if not len(points) or count < 1:
        raise ValueError("at least one point and one tick are needed")
    compute, lateness, force = np.empty(count), np.empty(count), np.empty((count, 3))
    columns = (column.ctypes.data for column in (compute, lateness, force))
    period = round(1e9 / rate)
    allowed = library().servo_run(
        field.address if field else None, points.ctypes.data, len(points), 1.0, count, period,
        min(round(SPIN * 1e9), period // 2), again, *columns,
    )  # fmt: skip
    return Run(compute, lateness, force, bool(allowed & _LOCKED), bool(allowed & _REALTIME))
