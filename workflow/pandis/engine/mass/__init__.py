"""Binding of ``mass.c``, which models a device and a hand as one mass with friction."""

import ctypes
from functools import cache
from pathlib import Path

import numpy as np

from pandis.engine.compiler import load


@cache
def library():
    """Return the compiled library with its functions' types declared."""
    lib = load(Path(__file__).with_name("mass.c"))
    pointer, i64 = ctypes.c_void_p, ctypes.c_int64
    lib.mass_steps.argtypes = [pointer, i64, i64, pointer, pointer, pointer]
    return lib


def mass_steps(oscillator, position, speed, *, push, steps):
    """Return positions and speeds (n, 3) after a number of steps under constant pushes (n, 3).

    Parameters
    ----------
    oscillator : ndarray, shape (9,)
        Three factors that give the position after a step from position, speed and push; three that
        give the speed; then friction (N), stiffness of the hand (N/m) and duration of a step (s).
    position, speed, push : array-like, shape (n, 3)
        In m, m/s and N; not modified.
    steps : int
    """
    oscillator = np.ascontiguousarray(oscillator, np.float64)
    arrays = np.broadcast_arrays(position, speed, push)
    position, speed, push = (np.array(array, np.float64, order="C") for array in arrays)
    library().mass_steps(
        oscillator.ctypes.data,
        len(position),
        steps,
        position.ctypes.data,
        speed.ctypes.data,
        push.ctypes.data,
    )
    return position, speed
