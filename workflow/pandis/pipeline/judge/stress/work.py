"""Measures work around closed loops: a force that adds energy can drive a device by itself.

A penalty force -k·φ·∇φ is the gradient of -k·φ²/2 and does no net work. Where direction and
distance do not match, or jump from cell to cell, a circling hand gains or loses energy.
"""

import numpy as np

from pandis.base.forces import penalty_force

#: Ranges of a loop's depth and radius (unit frame), and its number of steps.
DEPTHS, RADII, STEPS = (0.018, 0.045), (0.05, 0.2), 4000
#: Speed of the hand (m/s): the device's damping resists with damping · speed newtons.
SPEED = 0.1
_ROUNDS = 3


def loops(places, engine, rng):
    """Return closed loops below the surface, one around each place.

    They are circles on tangent planes, moved below the surface along the exact normal. The depth
    oscillates one to three times per loop, and is smaller where the part is thin.

    Parameters
    ----------
    places : pandis.pipeline.geometry.places.Stratified
    engine : object
        The exact distance of a `pandis.pipeline.geometry.body.Body`.
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (n, STEPS, 3), unit frame
    """
    feet, normals, count = places.feet, places.outward, len(places.feet)
    turn = 2 * np.pi * np.arange(STEPS) / STEPS
    one = np.cross(normals, rng.normal(size=(count, 3)))
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    other = np.cross(normals, one)
    circle = np.cos(turn)[:, None] * one[:, None] + np.sin(turn)[:, None] * other[:, None]
    path = feet[:, None] + rng.uniform(*RADII, count)[:, None, None] * circle
    times, phase = rng.integers(1, 4, count)[:, None], rng.uniform(0, 2 * np.pi, count)[:, None]
    middle, swing = np.mean(DEPTHS), np.ptp(DEPTHS) / 2
    share = (places.depth(max(DEPTHS)) / max(DEPTHS))[:, None]
    depth = (share * (middle + swing * np.cos(times * turn + phase))).reshape(-1)
    path = path.reshape(-1, 3)
    for _ in range(_ROUNDS):
        distance, normal = engine.distance_and_normal(path, check=False)
        path = path - (distance + depth)[:, None] * normal
    return path.reshape(count, STEPS, 3)


def loop_work(answer, paths):
    """Return the work (m,) around every loop, k = 1, unit frame, and the loops' lengths (m,)."""
    force = penalty_force(*answer(paths.reshape(-1, 3))).reshape(paths.shape)
    way = np.roll(paths, -1, axis=1) - paths
    mean = (force + np.roll(force, -1, axis=1)) / 2
    return (mean * way).sum(axis=(1, 2)), np.linalg.norm(way, axis=2).sum(axis=1)


def work(answer, exact, paths, *, scale, device):
    """Measure the work around loops.

    The exact force does no net work, but where it jumps, the sum over steps is not zero. A field's
    limit on the same loop is raised by that amount.

    Returns
    -------
    dict
        ``work``: root mean square of the work as a share of k·d²/2, where d is the mean depth of
        loops in thick parts; ``push_n``: work per length of the worst loop, newtons; ``limit``: the
        damping force at `SPEED` plus the allowance of that loop; ``passed``: on every loop.
    """
    (energy, length), (rest, _) = (loop_work(a, paths) for a in (answer, exact))
    push, forgiven = (np.abs(w / length) * scale.newtons for w in (energy, rest))
    limit = device.damping * SPEED + forgiven
    worst = int(np.argmax(np.where(np.isnan(push), np.inf, push) - limit))
    share = np.sqrt((energy**2).mean()) / (np.mean(DEPTHS) ** 2 / 2)
    return {
        "work": float(share),
        "push_n": float(push[worst]),
        "limit": float(limit[worst]),
        "passed": bool(push[worst] <= limit[worst]),
    }
