"""Presses a simulated device onto a field: checks limits and energy, finds the safe stiffness.

The C loop for a real device runs here on a simulated one, in simulated time. It reads positions,
sends forces through the guard, and keeps to HDAPI's order of calls and errors. The hand presses on
surface points of every class of inscribed radius, and slides along the evaluation trajectory.
"""

from typing import NamedTuple

import numpy as np

from pandis.base.frame import UNIT_SIDE
from pandis.engine.threads import thread_count
from pandis.pipeline.judge.servo.devices import RAMP
from pandis.pipeline.judge.stress.coupled import CALM, LADDER, QUIET, START, shaking
from pandis.pipeline.run.host.processes import each
from pandis.pipeline.run.records.hardware import Pressed
from pandis.runtime.device import DONE, Order, run_simulated
from pandis.runtime.scene import NativeScene, Placed

#: Duration of a press, and of the slide, ms.
TICKS, SLIDE = 1200, 2000
#: Heights above the surface (m). A press begins at the lowest one where the field has no force.
_HEIGHTS = START * 2.0 ** np.arange(7)
#: A press of up to this multiple of the friction might never reach the wall.
_STUCK = 1.5
#: Pressing force as a share of what the wall holds: a sudden press overshoots to twice its force.
_GENTLE = 0.5
#: Energy (J) that the device may appear to gain: an encoder step times the pressing force.
SLACK = 2e-5


#: Dampings (Ns/m) of the hands for which safe stiffnesses are determined: light, medium, firm.
HANDS = (0.3, 1.0, 3.0)


class Hand(NamedTuple):
    """The hand that holds the device.

    ``stiffness``, N/m; ``damping``, Ns/m; ``press``: pressing force, N; ``delay``: delay of the
    force, ticks.
    """

    stiffness: float
    damping: float
    press: float
    delay: int


class Contact(NamedTuple):
    """Points at which the hand presses and slides, m, in the device's workspace.

    Attributes
    ----------
    points, normals : ndarray, shape (n, 3)
        Surface points above a trajectory, and their outward normals.
    feet, outward : ndarray, shape (m, 3)
        Surface points to press on, and their outward normals.
    radius : ndarray, shape (m,)
        Inscribed radii at ``feet``.
    hard_feet, hard_outward : ndarray, shape (p, 3)
        Likewise, for full-force presses through a proxy; includes points on the thinnest walls.
    """

    points: np.ndarray
    normals: np.ndarray
    feet: np.ndarray
    outward: np.ndarray
    radius: np.ndarray
    hard_feet: np.ndarray
    hard_outward: np.ndarray


def contact(trajectory, places, thin, *, size):
    """Return the points at which a hand presses and slides, in the device's workspace.

    Parameters
    ----------
    trajectory : dict of str to ndarray
        ``points``, ``distance`` and ``normal`` in the unit frame.
    places, thin : pandis.pipeline.geometry.places.Stratified
        Surface points to press on, and to press hard through a proxy; unit frame.
    size : float
        Longest side, m.
    """
    normals, metres = trajectory["normal"], size / UNIT_SIDE
    above = trajectory["points"] - trajectory["distance"][:, None] * normals
    return Contact(
        above * metres,
        normals,
        places.feet * metres,
        places.outward,
        places.radius * metres,
        thin.feet * metres,
        thin.outward,
    )


class Setup(NamedTuple):
    """How a simulated device presses.

    Attributes
    ----------
    size, stiffness : float
        Longest side, m, and requested stiffness, N/m, which is capped at the device's largest.
    hand : Hand
    rate : float
        Ticks per second.
    """

    size: float
    stiffness: float
    hand: Hand
    rate: float

    @classmethod
    def of(cls, options):
        """Return the setup of a `pandis.pipeline.run.ask.tasks.ValidateTask`."""
        hand = Hand(**dict(options.hand))
        return cls(options.size, options.stiffness, hand, options.rate)


class Safe(NamedTuple):
    """The largest quiet and passive stiffness, N/m, and a clause on what limits it."""

    stiffness: float
    limit: str


def tried_hands(hand):
    """Return the configured hand, those of other dampings, and a weight in place of a hand."""
    others = [hand._replace(damping=damping) for damping in HANDS if damping != hand.damping]
    return [hand, *others, hand._replace(stiffness=0.0, damping=0.0)]


def find_safe(field, spec, surface, *, setup, feel=None):
    """Return the stiffness that is `Safe` for the hand of a setup; parameters as in `press`."""
    rig = _Rig(field, spec, surface, setup=setup, feel=feel)
    return rig.safe(min(setup.stiffness, spec.stiffness))


def press(field, spec, surface, *, setup, feel=None, safe=None):
    """Press a device onto a mesh with the forces of a field, and slide along it.

    Parameters
    ----------
    field : pandis.runtime.field.NativeField
    spec : pandis.pipeline.judge.servo.devices.Specification
    surface : Contact
    setup : Setup
    feel : pandis.runtime.contact.Feel, optional
        Probe with a proxy, and its surface; None for penalty forces.
    safe : list of Safe, optional
        For each of `tried_hands`, from `find_safe`; determined here if None.

    Returns
    -------
    Pressed
    """
    hands = tried_hands(setup.hand)
    if safe is None:  # in simulated time nothing is late, however many run in parallel
        setups = [setup._replace(hand=hand) for hand in hands]
        safe = list(
            each(lambda one: find_safe(field, spec, surface, setup=one, feel=feel), setups,
                 thread_count())
        )  # fmt: skip
    rig = _Rig(field, spec, surface, setup=setup, feel=feel)
    hand, stiffness = setup.hand, min(setup.stiffness, spec.stiffness)
    runs = rig.presses(stiffness)
    slide = rig.slide(stiffness)
    every = [*runs, slide]
    ended = next((run.sentence for run in every if run.cause != DONE), "")
    cut = sum(run.cut for run in every)
    energy = min(run.worst for run in every)
    reach = max(float(np.linalg.norm(run.path, axis=1).max()) for run in every)
    stiffest = {
        one.damping: most.stiffness for one, most in zip(hands[:-1], safe[:-1], strict=True)
    }
    return Pressed(
        hand=hand.damping,
        hands={f"{damping:g}": stiffest[damping] for damping in sorted(stiffest)},
        released_n_m=safe[-1].stiffness,
        stiffness=stiffness,
        strongest_n=max(run.strongest for run in every),
        steepest_n_per_ms=max(run.steepest for run in every) * 1e-3 * setup.rate,
        cut=int(cut),
        energy_j=float(energy),
        quiet=rig.quiet(stiffness),
        unarmed=sum(run.armed_at < 0 for run in runs),
        reach_m=reach,
        ended=ended,
        within_limits=not cut and not ended and reach <= spec.workspace,
        passive=bool(energy >= -SLACK),
        safe_n_m=safe[0].stiffness,
        limited_by=safe[0].limit,
    )


class _Rig:
    def __init__(self, field, spec, surface, *, setup, feel):
        self.feel, rate, size = feel, setup.rate, setup.size
        self.field, self.spec, self.hand, self.period = field, spec, setup.hand, 1 / rate
        self.size, self.surface, self._pressed = size, surface, {}
        starts = self._free(surface.feet, surface.outward)
        self.picked = list(zip(surface.feet, surface.outward, surface.radius, starts, strict=True))
        # the hand waits above the surface until the force has ramped up
        self.wait = round(RAMP * rate)
        self.ticks = self.wait + round(TICKS * 1e-3 * rate)

    def _free(self, feet, outward):
        """For each surface point, return the lowest place (n, 3) above it at which no force acts.

        A device is armed only where no force acts, and a force grid also pushes in free space.
        """
        heights = _HEIGHTS[:, None, None] + (self.feel.radius if self.feel else 0.0)
        places = feet + heights * outward
        scene = NativeScene([Placed.at(self.field, self.size, 1.0)])
        pushed = scene.ask_all(places.reshape(-1, 3)).reshape(places.shape).any(axis=2)
        return places[np.argmin(pushed, axis=0), np.arange(len(feet))]

    def strength(self, stiffness, radius):
        """Return the hand's pressing force (N) where the inscribed radius is ``radius`` (m)."""
        return min(self.hand.press, _GENTLE * stiffness * radius)

    def order(self, stiffness, ticks):
        placed = Placed.at(self.field, self.size, stiffness)
        scene = self.feel.scene(placed) if self.feel else NativeScene([placed])
        limits = self.spec.limits(self.period, stiffness)
        limits.most_damping = 0.0  # a safe stiffness must not depend on added damping
        return Order(scene, ticks, limits, self.period, armed=True)

    def simulated(self, wall):
        hand = self.hand
        return self.spec.simulated(
            (hand.stiffness, hand.damping), delay=hand.delay, period=self.period, wall=wall
        )

    def presses(self, stiffness):
        if stiffness not in self._pressed:  # cached: the ladder includes the requested stiffness
            order, device = self.order(stiffness, self.ticks), self.simulated(stiffness)
            self._pressed[stiffness] = []
            for point, normal, radius, start in self.picked:
                press = self.strength(stiffness, radius)
                rest, push = (
                    np.tile(point, (self.ticks, 1)),
                    np.tile(-press * normal, (self.ticks, 1)),
                )
                rest[: self.wait], push[: self.wait] = start, 0.0
                if self.feel:
                    order.scene.restart()
                run = run_simulated(device, start, rest, press=push, order=order)
                self._pressed[stiffness].append(run)
        return self._pressed[stiffness]

    def slide(self, stiffness):
        """Make the hand follow the trajectory, one step per millisecond."""
        count = min(SLIDE, len(self.surface.points))
        at = np.arange(round(count * 1e-3 / self.period)) * self.period * 1e3
        steps = np.arange(len(self.surface.points))
        rest, push = (
            np.stack([np.interp(at, steps, values[:, k]) for k in range(3)], axis=1)
            for values in (self.surface.points, -self.hand.press * self.surface.normals)
        )
        start = self._free(self.surface.points[:1], self.surface.normals[:1])[0]
        rest = np.concatenate([np.tile(start, (self.wait, 1)), rest])
        push = np.concatenate([np.zeros((self.wait, 3)), push])
        device, order = self.simulated(stiffness), self.order(stiffness, len(rest))
        return run_simulated(device, start, rest, press=push, order=order)

    def is_quiet(self, run):
        path = run.path[self.wait + (len(run.path) - self.wait) * 2 // 3 :]
        return run.cause == DONE and shaking(path, self.period) < QUIET

    def quiet(self, stiffness):
        """Return the share of presses that reach a wall and stay still there.

        Presses that friction may have stopped before the wall are ignored. If that leaves none,
        the share is 1.
        """
        shares = []
        for run, (_, _, radius, _) in zip(self.presses(stiffness), self.picked, strict=True):
            touched = bool(run.force.any())
            carried = self.strength(stiffness, radius) <= _STUCK * self.spec.friction
            if touched or not carried or run.armed_at < 0:
                shares.append(touched and self.is_quiet(run))
        return float(np.mean(shares)) if shares else 1.0

    def safe(self, stiffness):
        """Return the largest stiffness that is `Safe`."""
        last, why = 0.0, ""
        for trial in LADDER * stiffness:
            runs = self.presses(trial)
            if self.quiet(trial) < CALM:
                why = "beyond that it shakes, or holds nothing"
            if min(run.worst for run in runs) < -SLACK:
                why = "beyond that the wall gives energy"
            if any(run.cause != DONE for run in runs):
                why = "beyond that a run ends early"
            if why:
                break
            last = float(trial)
            if trial > self.spec.stiffness:
                break
        if last >= self.spec.stiffness:
            return Safe(self.spec.stiffness, "the largest tried on this device")
        return Safe(last, why or "larger values were not tried")
