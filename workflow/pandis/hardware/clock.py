"""A servo clock in Python: absolute deadlines, nothing allocated on purpose in the loop."""

import gc
import time

import numpy as np

_SPIN = 0.0004


def run_ticks(servo, points, count, rate):
    """Call ``servo`` once per tick of a fixed-rate clock.

    Parameters
    ----------
    servo : callable
        Takes a point (1, 3), returns a force (1, 3).
    points : ndarray, shape (m, 3)
        The probe's path; taken over and over.
    count : int
        Ticks.
    rate : float
        Ticks per second.

    Returns
    -------
    compute : ndarray, shape (count,)
        Seconds that the servo took.
    lateness : ndarray, shape (count,)
        Seconds between the tick's due time and its start.
    forces : ndarray, shape (count, 3)
    """
    compute, lateness, forces = np.empty(count), np.empty(count), np.empty((count, 3))
    path = [np.ascontiguousarray(point[None]) for point in points]
    clock, period, length = time.perf_counter, 1.0 / rate, len(path)
    for index in range(200):
        servo(path[index % length])
    collecting = gc.isenabled()
    gc.disable()
    try:
        start = clock() + 0.01
        for tick in range(count):
            due = start + tick * period
            left = due - clock()
            if left > _SPIN:
                time.sleep(left - _SPIN)
            while clock() < due:
                pass
            begin = clock()
            force = servo(path[tick % length])
            end = clock()
            forces[tick] = force[0]
            compute[tick], lateness[tick] = end - begin, begin - due
    finally:
        if collecting:
            gc.enable()
    return compute, lateness, forces
