"""Dry friction of the simulated device and hand: closed forms, in C and in Python."""

import numpy as np
import pytest
from scipy.linalg import expm
from test_devices import TOUCH, order

from pandis.pipeline.judge.stress.coupled import Mass
from pandis.pipeline.judge.stress.physical import TICK, Device
from pandis.runtime import device as hdapi

MASS, FRICTION, SPRING = 0.045, 0.26, 400.0
FREE = np.array([0.3, 0.0, 0.0])  # far from the ball
#: Time to swing from one side to the other, and what is lost of the swing on the way.
HALF, LOSS = np.pi * np.sqrt(MASS / SPRING), 2 * FRICTION / SPRING
DEVICE = Device(MASS, 0.0, FRICTION, 0.0, 0, 3.3, SPRING, 0.0, 0.0)


def in_c(files, start, rest, press, ticks, **changes):
    bare = {"damping": 0.0, "encoder": 0.0, "hand_damping": 0.0, "hand_stiffness": SPRING}
    device = hdapi.Simulated(**(TOUCH | bare | {"speed": 1e3} | changes))
    wanted = order(files, ticks, limits={"speed": 1e3})
    session = hdapi.run_simulated(device, FREE + start, FREE + rest, press=press, order=wanted)
    return (session.path - FREE)[:, 0]


def in_python(_, start, rest, press, ticks):
    """The same, one tick after the other, as the stress suite moves its devices."""
    mass = Mass(DEVICE, TICK / 4)
    rest = np.broadcast_to(rest, (ticks, 3))
    place, speed, path = np.array([start], float), np.zeros((1, 3)), []
    for tick in range(ticks):
        for _step in range(4):
            away = place - rest[tick]
            away, speed = mass.step(away, speed, np.array([press], float))
            place = rest[tick] + away
        path.append(place[0, 0])
    return np.array(path)


both = pytest.mark.parametrize("moved", [in_c, in_python])


@both
def test_a_swing_loses_the_same_at_every_turn_and_stops_where_friction_holds(moved, files):
    """Of a mass on a spring with Coulomb friction: 2 F / k from turn to turn (Den Hartog)."""
    begin = 0.006
    path = moved(files, np.array([begin, 0, 0]), np.zeros(3), np.zeros(3), 300)
    sides = [begin]
    while abs(sides[-1]) > FRICTION / SPRING:
        sides.append(-np.sign(sides[-1]) * (abs(sides[-1]) - LOSS))
    assert len(sides) > 3
    for turn, side in enumerate(sides[1:], 1):
        at = round(turn * HALF / TICK) - 1
        assert path[max(0, at - 1) : at + 2] == pytest.approx(side, abs=0.01 * begin)
    assert np.ptp(path[round(len(sides) * HALF / TICK) :]) == 0  # and not a bit further


@both
def test_a_block_that_is_pulled_sticks_and_then_slips(moved, files):
    """Pulled over a spring at a steady speed: nothing up to F / k, then v (t - sin(wt) / w)."""
    speed, ticks = 0.02, 400
    rest = np.zeros((ticks, 3))
    rest[:, 0] = speed * TICK * np.arange(ticks)
    path = moved(files, np.zeros(3), rest, np.zeros(3), ticks)
    slip = FRICTION / SPRING / speed / TICK
    assert path[: int(slip) - 1].any() == False  # noqa: E712
    t = (np.arange(ticks) + 1 - slip) * TICK
    w = np.sqrt(SPRING / MASS)
    wanted = np.where(t > 0, speed * (t - np.sin(w * t) / w), 0)
    assert np.abs(path - wanted).max() < 0.01 * wanted.max()
    assert path[-1] == pytest.approx(wanted[-1], rel=0.01)


@both
@pytest.mark.parametrize("share", [0.5, 0.99])
def test_below_breakaway_nothing_moves_for_a_minute(moved, share, files):
    """Pushed aside at an angle, too: less than an encoder's step, and indeed nothing."""
    push = share * FRICTION * np.array([0.6, 0.0, 0.8])
    path = moved(files, np.zeros(3), np.zeros(3), push, 60_000 if moved is in_c else 3000)
    assert np.abs(path).max() < 55e-6 / 1000


@both
def test_above_breakaway_it_moves(moved, files):
    push = 1.05 * FRICTION * np.array([1.0, 0.0, 0.0])
    path = moved(files, np.zeros(3), np.zeros(3), push, 400)
    assert path[-1] > 0.5 * 0.05 * FRICTION / SPRING


def naive_step(device, dt, position, speed, push):
    """One step of one mass, as the equations stand."""
    state = np.zeros((3, 3))
    damping = device.damping + device.hand_damping
    state[0, 1] = 1
    state[1] = -device.hand_stiffness / device.mass, -damping / device.mass, 1 / device.mass
    after = expm(state * dt)
    fast = np.linalg.norm(speed)
    along = speed if fast > 0 else push - device.hand_stiffness * position
    size = np.linalg.norm(along)
    if fast == 0 and size <= device.friction:
        return position, speed
    push = push - device.friction * along / max(size, 1e-300)
    to, then = (row @ np.array([position, speed, push]) for row in after[:2])
    if fast > 0 and speed @ then <= 0:
        share = fast / (fast + np.linalg.norm(then))
        return position + speed * share * dt / 2, np.zeros(3)
    return to, then


@pytest.mark.parametrize("friction", [0.0, 0.26])
@pytest.mark.parametrize("steps", [1, 4])
def test_steps_in_c_are_those_of_the_equations(friction, steps):
    rng = np.random.default_rng(5)
    device = Device(MASS, 1.5, friction, 0.0, 0, 3.3, SPRING, 0.7, 0.0)
    state = rng.normal(0, [[[0.002]], [[0.05]], [[0.5]]], (3, 300, 3))
    state[1, ::3] = 0  # at rest
    state[2, ::6], state[0, ::6] = 0.01, 0.0  # and held there
    position, speed, push = state
    wanted = []
    for place, fast, pushed in zip(position, speed, push, strict=True):
        moved = place, fast
        for _ in range(steps):
            moved = naive_step(device, TICK / 4, *moved, pushed)
        wanted.append(moved)
    before = state.copy()
    found = Mass(device, TICK / 4).step(position, speed, push, steps=steps)
    assert np.transpose(found, (1, 0, 2)) == pytest.approx(np.array(wanted), rel=1e-12, abs=1e-15)
    assert (state == before).all()
    if friction:
        assert (found[0][::6] == position[::6]).all()
