"""Finds the stiffness up to which the closed loop of device, hand and field stays quiet.

A virtual wall reacts to a position up to a tick old (half a tick on average), which adds energy.
The damping of device and hand removes it while K < b / (T/2 + n·T), with n the number of ticks by
which a force is late (Colgate and Schenkel 1997; Abbott and Okamura 2005 with friction and
encoder). Kinks and seams of the field lower this limit.
"""

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm
from scipy.ndimage import uniform_filter1d

from pandis.base.forces import penalty_force
from pandis.base.physical import Scale
from pandis.engine.mass import mass_steps
from pandis.pipeline.judge.stress.physical import TICK, Device

#: Stiffnesses that are tried, as multiples of the requested one.
LADDER = 2 ** (np.arange(-6, 11) / 2)
#: Ticks of a run. A run is quiet if it shakes by less than QUIET (m) in its last third.
TICKS, QUIET = 900, 1e-4
#: Minimum share of presses that stay calm. It is below 1 because the shape lets the probe slip off
#: at some points.
CALM = 0.8
#: A press that is calm on the exact field may shake or give way on at most this share of the area.
ALLOWED = 0.1
#: A wall holds a press if its mean force in a run's last third is at least this share of the
#: pressing force.
HOLDS = 0.5
#: Length (ticks) of the moving mean that is subtracted to measure shaking: motion below 30 Hz is
#: sliding.
_MEAN = 33
#: Height above the surface where a run starts, m.
START = 2e-4
#: Force of a hard press, as a share of what the wall must hold. A sudden press overshoots to twice
#: its force.
_HARD = 0.5
#: A press of up to this multiple of the friction might not reach the wall within a run.
_STUCK = 1.5
#: Number of integration steps per tick, to resolve the friction.
_SUBSTEPS = 4


class Mass:
    """A device and the hand that holds it, as one mass with Coulomb friction.

    m·x″ = u − (b + b_hand)·x′ − k_hand·x, with x measured from the hand's rest position. Friction
    opposes motion; at rest, it balances any force up to its own magnitude. Steps are exact for
    constant u.

    Parameters
    ----------
    device : pandis.pipeline.judge.stress.physical.Device
    dt : float
        Length of a step, s.
    """

    def __init__(self, device, dt):
        damping = device.damping + device.hand_damping
        state = np.zeros((3, 3))
        state[0, 1] = 1
        state[1] = -device.hand_stiffness / device.mass, -damping / device.mass, 1 / device.mass
        after = expm(state * dt)
        self._oscillator = [*after[0], *after[1], device.friction, device.hand_stiffness, dt]

    def step(self, position, speed, push, *, steps=1):
        """Return positions and speeds (n, 3) after a number of steps under pushes (n, 3)."""
        return mass_steps(self._oscillator, position, speed, push=push, steps=steps)


class Press(NamedTuple):
    """Outcome of presses on surface points.

    Attributes
    ----------
    swing : ndarray, shape (n,)
        How far the probe shakes, peak to peak and above 30 Hz, in the last third of the run, m.
    energy : ndarray, shape (n,)
        Energy that the wall took from the device during the run, J. It is negative if the wall
        added energy.
    share : ndarray, shape (n,)
        Mean outward force of the wall in the last third of the run, as a share of the pressing
        force. It is infinite if friction alone might stop the device before it reaches the wall.
    """

    swing: np.ndarray
    energy: np.ndarray
    share: np.ndarray

    @property
    def calm(self):
        """Return the mask (n,) of the points where the probe neither shakes nor goes through."""
        return (self.swing < QUIET) & (self.share >= HOLDS)


class Loop(NamedTuple):
    """A field in a control loop with a device.

    Attributes
    ----------
    answer : callable
        Returns (distance, normal) at points (n, 3), unit frame.
    scale : pandis.base.physical.Scale
    device : pandis.pipeline.judge.stress.physical.Device
    """

    answer: Callable
    scale: Scale
    device: Device


def simulate(loop, places, stiffness, *, press, ticks=TICKS, start=START):
    """Press a device onto surface points.

    Parameters
    ----------
    loop : Loop
    places : tuple of ndarray, shape (n, 3), unit frame
        Surface points, and the outward normals against which the hand presses.
    stiffness : ndarray, shape (n,)
        Stiffness at each point, N/m.
    press : ndarray, shape (n,)
        Force with which the hand presses, N.
    ticks : int
    start : float or ndarray, shape (n, 1)
        Height above the points at which the device starts from rest, m.

    Returns
    -------
    Press
    """
    (answer, scale, device), (points, normals) = loop, places
    mass = Mass(device, TICK / _SUBSTEPS)
    position, speed = start * normals, np.zeros_like(normals)
    pressing = -press[:, None] * normals
    late = deque([np.zeros_like(normals)] * device.delay)
    path, answered = [], np.zeros(len(points))
    energy = np.zeros(len(points))
    for tick in range(ticks):
        seen = np.round(position / device.encoder) * device.encoder if device.encoder else position
        depth = penalty_force(*answer(points + seen * scale.metre)) / scale.metre
        force = stiffness[:, None] * depth
        size = np.linalg.norm(force, axis=1, keepdims=True)
        force *= np.minimum(1, device.force_limit / np.maximum(size, 1e-12))
        late.append(force)
        force = late.popleft()
        before = position
        position, speed = mass.step(position, speed, force + pressing, steps=_SUBSTEPS)
        energy -= (force * (position - before)).sum(axis=1)
        if tick >= ticks * 2 // 3:
            path.append(position)
            answered += np.einsum("ij,ij->i", force, normals)
    carried = answered / np.maximum(press * len(path), 1e-12)
    # friction may stop such a press before the wall
    carried[press <= _STUCK * device.friction] = np.inf
    return Press(shaking(np.array(path)), energy, carried)


def shaking(path, period=TICK):
    """Return the peak-to-peak shaking of a path (t, ..., 3) above 30 Hz; slower motion is sliding.

    ``period`` is the period of the path's ticks, s.
    """
    mean = round(_MEAN * TICK / period)
    fast = path - uniform_filter1d(path, mean, axis=0)
    return np.linalg.norm(np.ptp(fast[mean:-mean], axis=0), axis=-1)


def stable_stiffness(loop, places, force):
    """Return the largest stiffness of the ladder up to which at least CALM of the area is calm.

    The pressing force is the hand's, or half of what walls must hold at that stiffness if this is
    less. ``force`` is what they must hold at the requested stiffness. A missing wall does not
    shake, but holds nothing, so it does not count as calm.
    """
    count, ladder = len(places.feet), LADDER * loop.scale.stiffness
    holds = _HARD * np.outer(LADDER, force).ravel()
    press = np.minimum(loop.device.press, holds)
    repeated = [np.tile(part, (len(LADDER), 1)) for part in (places.feet, places.outward)]
    runs = simulate(loop, repeated, np.repeat(ladder, count), press=press)
    calm = runs.calm.reshape(len(LADDER), count) @ places.weight >= CALM
    steps = int(np.logical_and.accumulate(calm).sum())
    return float(ladder[steps - 1]) if steps else 0.0


def presses(loop, places, force):
    """Press with half of what walls must hold: once capped at the hand's force, once uncapped.

    Returns
    -------
    ndarray, shape (2, n), bool
        Whether each press stays calm at the requested stiffness.
    """
    press = np.concatenate([np.minimum(loop.device.press, _HARD * force), _HARD * force])
    stiffness = np.full(len(press), loop.scale.stiffness)
    repeated = [np.tile(part, (2, 1)) for part in (places.feet, places.outward)]
    return simulate(loop, repeated, stiffness, press=press).calm.reshape(2, -1)


def closed_loop(loop, places, force, *, calm, rests):
    """Measure the area on which presses shake or go through, and the largest stable stiffness.

    Parameters
    ----------
    loop : Loop
    places : pandis.pipeline.geometry.places.Stratified
    force : ndarray, shape (n,)
        Force that walls must hold, N: see `pandis.pipeline.judge.stress.contact.wanted_force`.
    calm : ndarray, shape (2, n), bool
        Whether each press is calm on the exact field, from `presses`. Other presses do not count
        against a field, because the shape itself lets the probe slip off or through.
    rests : float
        Largest stable stiffness of the exact field, N/m.

    Returns
    -------
    dict
        ``restless``: share of the area on which a press is calm on the exact field but not on this
        one. Of the shares for light and hard presses, it is the larger. ``stable_n_m``: largest
        stable stiffness; ``least_n_m``: smallest value that ``stable_n_m`` may have, which is the
        requested stiffness, or ``rests`` if that is less; ``limit``: limit on ``restless``;
        ``passed``.
    """
    pressed = presses(loop, places, force)
    restless = float(((calm & ~pressed) * places.weight).sum(axis=1).max())
    stable = stable_stiffness(loop, places, force)
    least = float(min(loop.scale.stiffness, rests))
    passed = bool(restless <= ALLOWED and stable >= least)
    return {
        "restless": restless,
        "stable_n_m": stable,
        "least_n_m": least,
        "limit": ALLOWED,
        "passed": passed,
    }
