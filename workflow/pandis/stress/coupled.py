"""Device, hand and field in a closed loop: up to which stiffness they stay quiet.

A virtual wall answers a position that is a tick old, on average half of one: energy. Damping of
device and hand takes it away up to K < b / (T/2 + n·T), n the ticks that a force comes late
(Colgate and Schenkel 1997; Abbott and Okamura 2005 with friction and encoder). A kink or a seam
of the field lowers what is left.
"""

from collections import deque

import numpy as np
from scipy.linalg import expm
from scipy.ndimage import uniform_filter1d

from pandis.forces import penalty_force
from pandis.stress.physical import TICK

#: Stiffnesses that are tried, as shares of the one asked for.
LADDER = 2 ** (np.arange(-6, 11) / 2)
#: Ticks of a run; quiet is what shakes less than QUIET (m) in the last third of them.
TICKS, QUIET = 900, 1e-4
#: So many of the points pressed on must stay quiet: on some the shape lets the probe slip off.
CALM = 0.8
#: Ticks of the mean that shaking is measured from: what is slower than 30 Hz is sliding.
_MEAN = 33
#: Above the surface (m) where a run starts.
START = 2e-4
#: Steps of the friction within a tick.
_SUBSTEPS = 4


def motion(device, dt):
    """Return the matrices that move (x, v) by ``dt`` under a constant force: exact.

    m·x″ = u − (b + b_hand)·x′ − k_hand·x, x from where the hand would rest.
    """
    damping = device.damping + device.hand_damping
    state = np.zeros((3, 3))
    state[0, 1] = 1
    state[1] = -device.hand_stiffness / device.mass, -damping / device.mass, 1 / device.mass
    step = expm(state * dt)
    return step[:2, :2], step[:2, 2]


def simulate(answer, points, normals, stiffness, scale, device, ticks=TICKS, start=START):
    """Press a device onto surface points.

    Parameters
    ----------
    answer : callable
        Answers (distance, normal) at points (n, 3), unit frame.
    points, normals : ndarray, shape (n, 3), unit frame
        The hand presses against the normal there.
    stiffness : ndarray, shape (n,)
        N/m.
    scale : pandis.stress.physical.Scale
    device : pandis.stress.physical.Device
    ticks : int
    start : float or ndarray, shape (n, 1)
        Height above the points where it starts from rest, m.

    Returns
    -------
    swing : ndarray, shape (n,)
        How far it shakes in the last third, above 30 Hz, peak to peak, m.
    energy : ndarray, shape (n,)
        What the wall has taken from the device, J; negative: it has given.
    """
    (xx, xv), (xu, vu) = (m.T for m in motion(device, TICK / _SUBSTEPS))
    move = np.array([xx, xv]).T
    position, speed = start * normals, np.zeros_like(normals)
    press = -device.press * normals
    late = deque([np.zeros_like(normals)] * device.delay)
    path = []
    energy, slip = np.zeros(len(points)), device.friction / device.mass * TICK / _SUBSTEPS
    for tick in range(ticks):
        seen = np.round(position / device.encoder) * device.encoder if device.encoder else position
        depth = penalty_force(*answer(points + seen * scale.metre)) / scale.metre
        force = stiffness[:, None] * depth
        size = np.linalg.norm(force, axis=1, keepdims=True)
        force *= np.minimum(1, device.force_limit / np.maximum(size, 1e-12))
        late.append(force)
        force = late.popleft()
        before = position
        for _ in range(_SUBSTEPS):
            push = force + press
            position, speed = (
                move[0, 0] * position + move[0, 1] * speed + xu * push,
                move[1, 0] * position + move[1, 1] * speed + vu * push,
            )
            if slip:
                fast = np.linalg.norm(speed, axis=1, keepdims=True)
                speed = speed * np.maximum(0, 1 - slip / np.maximum(fast, 1e-12))
        energy -= (force * (position - before)).sum(axis=1)
        if tick >= ticks * 2 // 3:
            path.append(position)
    return shaking(np.array(path)), energy


def shaking(path, period=TICK):
    """Return how far a path (t, ..., 3) shakes above 30 Hz, peak to peak: what is slower slides.

    ``period`` is that of the path's ticks, s.
    """
    mean = round(_MEAN * TICK / period)
    fast = path - uniform_filter1d(path, mean, axis=0)
    return np.linalg.norm(np.ptp(fast[mean:-mean], axis=0), axis=-1)


def stable_stiffness(answer, points, normals, scale, device):
    """Return the largest stiffness of the ladder up to which CALM of the points do not shake."""
    count, ladder = len(points), LADDER * scale.stiffness
    every = np.tile(points, (len(LADDER), 1)), np.tile(normals, (len(LADDER), 1))
    swing, _ = simulate(answer, *every, np.repeat(ladder, count), scale, device)
    quiet = (swing < QUIET).reshape(len(LADDER), count).mean(axis=1) >= CALM
    steps = int(np.logical_and.accumulate(quiet).sum())
    return float(ladder[steps - 1]) if steps else 0.0


def closed_loop(answer, points, normals, wanted, scale, device):
    """Find the largest stable stiffness.

    ``wanted`` is that of the exact field: where the shape itself lets a probe slip off, no field
    is to blame.

    Returns
    -------
    dict
        ``stable_n_m``; ``limit``: the stiffness asked for, or what the exact field reaches;
        ``passed``.
    """
    stable = stable_stiffness(answer, points, normals, scale, device)
    limit = float(min(scale.stiffness, wanted))
    return {"stable_n_m": stable, "limit": limit, "passed": stable >= limit}
