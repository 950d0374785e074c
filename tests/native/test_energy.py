"""What a wall gives a hand, by the arithmetic of the test: the force times the way of the device.

The device loses by its damping what its specification says, and by its friction what it really has,
of which the guard knows nothing.
"""

from functools import cache

import numpy as np
import pytest
from test_devices import PATIENT, run, stand_in  # noqa: F401

from pandis.pipeline.judge.servo.devices import DEVICES
from pandis.pipeline.judge.servo.pressing import Contact, Hand, Setup, _Rig
from pandis.runtime import device as hdapi
from pandis.runtime.field import NativeField
from pandis.runtime.scene import NativeScene, Placed

#: Of the object's longest side, m; of a run, s; until the hand moves, s: the force comes in before.
SIZE, SECONDS, WAIT = 0.1, 2.0, 0.6
#: J that a hand may get, and the way that it goes in a second at most, m.
MOST, FAST = 1e-3, 0.2
#: A hand is light: Ns/m. It holds the device with a spring, N/m.
DAMPING, SPRINGS = 0.3, (100.0, 400.0)


def placed(field, stiffness):
    return Placed.at(field, SIZE, stiffness)


@pytest.fixture(scope="module")
def allowed(files):
    """Return the stiffness that an attached device is given at a period: see `stiffness_for`."""
    field = NativeField(files["box"])
    high = np.array(field.bounds[1]) * placed(field, 1.0).scale
    count = 2000
    heights = np.linspace(-0.3, 0.3, 5) * high[1]
    feet = np.stack([np.full(5, high[0]), heights, 0 * heights], axis=1)
    way = np.stack([np.full(count, high[0]), np.linspace(-0.3, 0.3, count) * high[1],
                    np.zeros(count)], axis=1)  # fmt: skip
    outward = np.array([1.0, 0, 0])
    surface = Contact(way, np.tile(outward, (count, 1)), feet, np.tile(outward, (5, 1)),
                      np.full(5, high[0]), feet, np.tile(outward, (5, 1)))  # fmt: skip

    @cache
    def find(model, period):
        hand = Hand(20.0, DAMPING, 1.0, 0)
        setup = Setup(SIZE, DEVICES[model].stiffness, hand, 1 / period)
        rig = _Rig(field, DEVICES[model], surface, setup=setup, feel=None)
        safe, _ = rig.safe(DEVICES[model].stiffness)
        return min(0.7 * safe, DEVICES[model].stiffest(period))

    return field, high[0], find


def ways(side, period, rng):
    """Yield hands: where they would rest (n, 3), m, at most ``FAST``."""
    wait, count = round(WAIT / period), round(SECONDS / period)
    now = np.arange(count) * period
    start = np.array([side + 2e-3, 3e-3, 1e-3])

    def resting(depth, before=wait):
        rest = np.tile(start, (before + len(depth), 1))
        rest[before:, 0] = side - depth
        return rest

    for _ in range(3):  # in and out
        far = rng.uniform(2e-3, 12e-3)
        yield resting(far * np.sin(FAST / far * now) - 0.3 * far)
    yield resting(np.minimum(FAST * now, 4e-3) - 2e-3)
    wandering = np.interp(now, np.arange(0, SECONDS, 0.04), rng.uniform(-4e-3, 4e-3, 50))
    yield resting(wandering + 2e-3)
    # into the wall while the force comes in, held there, and out again
    path = [-2e-3, -1e-3, 6e-3, 6e-3, -2e-3]
    yield resting(np.interp(now, [0, 0.02, 0.15, 0.6, 0.7], path), 0)


def given(field, spec, period, stiffness, friction, spring, rest):
    """Return the most energy (J) that any row of contacts gives a hand, and how the run ended."""
    device = spec._replace(friction=friction).simulated(
        (spring, DAMPING), delay=0, period=period, wall=stiffness
    )
    limits = spec.limits(period, stiffness)
    limits.needs = 0
    order = hdapi.Order(
        NativeScene([placed(field, stiffness)]), len(rest), limits, period, armed=True, **PATIENT
    )
    session = hdapi.run_simulated(device, rest[0], rest, press=np.zeros(3), order=order)
    force, way = session.force[1:-1], np.diff(session.path[:-1], axis=0)
    length, pushed = np.linalg.norm(way, axis=1), force.any(axis=1)
    lost = spec.damping * length**2 / period + friction * length
    gone = np.cumsum((force * way).sum(axis=1) - np.where(pushed, lost, 0.0))
    free = np.concatenate([[0.0], gone[~pushed]])  # between contacts nothing is stored
    return (free - np.minimum.accumulate(free)).max(), session.cause


@pytest.mark.parametrize("period", [None, 2e-3, 3e-3, 4e-3])
@pytest.mark.parametrize("model", DEVICES)
def test_a_light_hand_gets_a_millijoule_at_most(model, period, allowed):
    """With its nominal friction booked as lost, a device that had none gave many times as much."""
    field, side, find = allowed
    spec, rng = DEVICES[model], np.random.default_rng(0)
    period = period or 1 / spec.rate
    stiffness = find(model, period)
    assert stiffness >= 100  # a wall that is none gives nothing
    most = MOST + (0.5 * stiffness * (FAST * period) ** 2 if period > 2e-3 else 0)
    worst = 0.0
    for friction in (0.0, spec.friction / 2, spec.friction):
        for spring in SPRINGS:
            for rest in ways(side, period, rng):
                got, _ = given(field, spec, period, stiffness, friction, spring, rest)
                worst = max(worst, got)
    print(f"{model} {1e3 * period:g} ms, {stiffness:.0f} N/m: {1e3 * worst:.3f} mJ")
    assert worst <= most


def test_a_device_that_calls_too_seldom_is_not_armed(run):  # noqa: F811
    session, seen = run(period=5e-3)
    assert session.cause == hdapi.DEVICE
    assert "every 4 ms" in session.sentence
    assert seen.largest == 0


@pytest.mark.parametrize("damping", [1.0, 3.0])
def test_a_touch_as_its_maker_says_runs_to_its_end(damping, allowed):
    """What is not counted on is there: the guard ends nothing that is sound."""
    field, side, find = allowed
    spec, rng = DEVICES["touch"], np.random.default_rng(1)
    for rest in ways(side, 1e-3, rng):
        _, cause = given(field, spec, 1e-3, find("touch", 1e-3), spec.friction, 100.0, rest)
        assert cause == hdapi.DONE
