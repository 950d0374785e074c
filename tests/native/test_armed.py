"""Armed runs: every fault ends at zero, and no record shows more than was allowed.

What is checked is each tick's record of what the device was given, by the test's own arithmetic.
"""

import subprocess

import numpy as np
import pytest
from test_devices import (  # noqa: F401
    HDAPI,
    HELD,
    HERE,
    LIMITS,
    RADIUS,
    STIFFNESS,
    TOUCH,
    added,
    order,
    run,
    stand_in,
)

from pandis.pipeline.judge.stress.coupled import shaking
from pandis.runtime import device as hdapi

#: As an attached run has them, with a button to hold; the ramp is short, for a run is.
ARMED = {"ramp": 4, "step": 0.33, "needs": hdapi.NEEDS_BUTTON, "continuous": 0.88}
BOTH = hdapi.NEEDS_BUTTON | hdapi.NEEDS_SWITCH


def allowed(session, stiffness=STIFFNESS, limits=None):
    """Check that on no tick a force, its change or its stiffness was more than allowed."""
    own = LIMITS | ARMED | (limits or {})
    force, size = session.force, np.linalg.norm(session.force, axis=1)
    assert np.isfinite(force).all()
    assert (size <= own["force"] * (1 + 1e-9)).all()
    assert (added(force) <= own["step"] * (1 + 1e-9)).all()
    last = np.vstack([np.zeros(3), force[:-1]])
    change = np.linalg.norm(force - last, axis=1)
    assert (change[size > 0] <= own["impulse"] * (1 + 1e-9)).all()
    known = np.isfinite(session.position).all(axis=1)
    depth = np.maximum(RADIUS - np.linalg.norm(session.position, axis=1), 0)
    way = np.linalg.norm(np.diff(session.position, axis=0, prepend=session.position[:1]), axis=1)
    damping = own["most_damping"] * way / np.maximum(session.since, 1e-3)
    bound = stiffness * depth + damping + 1e-9
    assert (size[known] <= bound[known]).all()
    assert np.nanmin(booked(session, stiffness)) > -1e-3  # J: what may be spent, and a tick
    if session.armed_at >= 0:
        assert not force[: session.armed_at].any()
        assert depth[session.armed_at] == 0


FAULTS = {
    **{f"error 60 {code:x}": hdapi.ERROR for code in sorted(hdapi.ERRORS)},
    "error 60 777": hdapi.ERROR,
    "nan 60": hdapi.NUMBER,
    "jump 60": hdapi.SPEED,
    "uncalibrated 60": hdapi.CALIBRATION,
    "open 60": hdapi.SWITCH,
    "hot 60": hdapi.HOT,
    "burning 60": hdapi.HOT,
}


@pytest.mark.parametrize("fault", FAULTS)
def test_every_fault_is_zero_from_its_tick_on(fault, run):  # noqa: F811
    limits = {"ramp": 4, "needs": BOTH} if fault.startswith("open") else ARMED
    session, seen = run(fault, limits=limits)
    assert session.cause == FAULTS[fault], session.sentence
    late = 40 if fault.startswith("uncalibrated") else 0  # looked at every 100 ticks
    at = 60 if not late else 100
    assert session.force[59].any()
    assert not session.force[at:].any()
    assert not any(seen.last)
    allowed(session, limits=limits)


def test_an_error_of_the_write_itself_turns_the_motors_off_at_once(run):  # noqa: F811
    """Nobody may call again: no later tick could send a zero."""
    session, seen = run("ending 60 302", limits=ARMED, patience=0.2)
    assert session.cause == hdapi.ERROR
    assert session.force[59].any()
    assert not session.force[60:].any()
    assert len(session.force) == 61
    assert seen.disabled >= 2  # in that tick, and when the run ended


def test_a_touch_and_go_while_the_force_comes_in_is_no_fault(files):
    """Half of a ramp: what the wall stores there is that of half its stiffness."""
    ticks = 700
    rest = np.zeros((ticks, 3))
    rest[:, 0] = RADIUS + np.interp(
        np.arange(ticks), [150, 250, 280, 380], [1e-3, -5e-3, -5e-3, 1e-3]
    )
    spec = hdapi.Simulated(
        **(TOUCH | {"hand_stiffness": 1500.0, "hand_damping": 15.0, "friction": 0.0})
    )
    wanted = order(files, ticks, limits=LIMITS | ARMED | {"needs": 0, "ramp": 500})
    start = np.array([RADIUS + 1e-3, 0, 0])
    session = hdapi.run_simulated(spec, start, rest, press=np.zeros(3), order=wanted)
    assert session.strongest > 0.5
    assert (session.cause, session.signs) == (hdapi.DONE, 0), session.sentence


def test_a_force_that_is_asked_for_every_third_tick_is_held_between(files):
    """Simulated time alone has it, for rates that no device has."""
    ticks = 150
    rest = np.zeros((ticks, 3))
    rest[:, 0] = RADIUS - 2e-3 + 1e-3 * np.sin(0.03 * np.arange(ticks))
    limits = LIMITS | ARMED | {"needs": 0, "step": 3.3}
    wanted = order(files, ticks, limits=limits, hold=3)
    spec = hdapi.Simulated(**(TOUCH | {"hand_stiffness": 400.0, "hand_damping": 8.0}))
    start = np.array([RADIUS + 1e-3, 0, 0])
    session = hdapi.run_simulated(spec, start, rest, press=np.zeros(3), order=wanted)
    assert session.cause == hdapi.DONE, session.sentence
    assert session.damped == 0
    late = session.force[30:ticks].reshape(-1, 3, 3)  # after the ramp
    assert (late == late[:, :1]).all()
    assert len(np.unique(late[:, 0], axis=0)) > 5


@pytest.mark.parametrize("fault", ["frozen 60", "creep 60 14", "creep 60 64"])
def test_an_encoder_that_sticks_or_drifts_ends_the_run(fault, run):  # noqa: F811
    """A position that crept into the wall at 20 or 100 mm/s gave 3.3 N to the end of the run."""
    session, _ = run(fault, limits=ARMED, ticks=400)
    assert session.cause == hdapi.ENCODER, session.sentence
    assert 60 < len(session.force) < 60 + 150
    assert session.force[60].any()
    assert session.strongest < 1.8
    assert not session.force[-hdapi.RELEASE :].any()
    allowed(session)


BAD = [(name, bad) for name, _ in hdapi.Limits._fields_[:-1] for bad in (np.nan, np.inf, -1.0)]


@pytest.mark.parametrize(("name", "bad"), BAD)
def test_limits_that_are_none_are_refused(name, bad, run):  # noqa: F811
    """With a damping that is no number, NaN was written to the device."""
    session, _ = run(limits=ARMED | {name: bad})
    assert session.cause == hdapi.LIMITS, session.sentence
    assert len(session.force) == 0
    assert session.model == ""  # it was not even opened


NEVER = {
    "uncalibrated -1": (hdapi.CALIBRATION, "inkwell"),
    "update": (hdapi.CALIBRATION, "calibrate it"),
    "init": (hdapi.DEVICE, ""),
    "start": (hdapi.DEVICE, ""),
    "weak": (hdapi.DEVICE, "another model"),
    "fast": (hdapi.DEVICE, "another rate"),
    "released -1": (hdapi.DONE, ""),
    "open -1": (hdapi.DONE, ""),
    "hot -1": (hdapi.HOT, "let it cool"),
    "nan -1": (hdapi.NUMBER, ""),
}


@pytest.mark.parametrize("fault", NEVER)
def test_what_is_not_ready_gets_no_force(fault, run):  # noqa: F811
    session, seen = run(fault, expected=3.3, limits=ARMED | {"needs": BOTH})
    cause, said = NEVER[fault]
    assert session.cause == cause, session.sentence
    assert said in session.sentence
    assert not session.force.any()
    assert seen.largest == 0
    assert session.armed_at == -1


def test_a_run_that_begins_inside_gets_no_force_until_it_was_outside(run):  # noqa: F811
    session, seen = run(place=RADIUS - 0.002, limits=ARMED)
    assert session.cause == hdapi.DONE
    assert (np.linalg.norm(session.position, axis=1) < RADIUS).all()
    assert seen.largest == 0
    # pulled out, and only then in again
    kind = f"300 6 {RADIUS + 0.003}"
    session, _ = run(place=RADIUS - 0.002, kind=kind, limits=ARMED, ticks=200)
    outside = np.flatnonzero(np.linalg.norm(session.position, axis=1) >= RADIUS)
    assert session.armed_at == outside[0]
    allowed(session)


def test_letting_go_of_the_button_ends_the_force_at_once(run):  # noqa: F811
    session, seen = run("released 60", limits=ARMED)
    assert session.cause == hdapi.DONE  # somebody let go: no fault
    assert session.force[59].any()
    assert not session.force[60:].any()
    assert not any(seen.last)
    allowed(session)


def test_motors_are_not_loaded_for_longer_than_they_stand(run):  # noqa: F811
    """Held against a wall: the mean square of the force ends at the continuous one's."""
    kind = f"2000 20 {RADIUS - 0.01}"
    session, _ = run("tired", kind=kind, limits=ARMED | {"most_damping": 0.0}, ticks=4000)
    assert session.limits.continuous == pytest.approx(0.2)
    sizes = np.linalg.norm(session.force, axis=1)
    assert sizes.max() > 0.5
    assert sizes[-1] <= 0.2 * 1.05
    load = np.zeros(len(sizes))
    for tick in range(1, len(sizes)):
        load[tick] = load[tick - 1] + session.since[tick] / 10 * (
            sizes[tick - 1] ** 2 - load[tick - 1]
        )
    assert load.max() <= 0.2**2 * 1.01


def test_the_object_lies_in_the_middle_of_the_devices_own_workspace(run):  # noqa: F811
    session, _ = run("aside", place=RADIUS + 0.0305, kind=f"300 6 {RADIUS + 0.026}", limits=ARMED)
    assert session.cause == hdapi.DONE
    x = session.position[:, 0]
    touching = np.linalg.norm(session.force, axis=1) > 0
    assert touching.any()
    assert (x[touching] < RADIUS + 0.03).all()


def test_a_late_call_makes_no_fast_probe(run):  # noqa: F811
    """Ten ticks late, a probe of 0.2 m/s has gone 2 mm: by the nominal period that is 2 m/s."""
    kind = f"20 6 {RADIUS - 0.05}"
    session, _ = run("skip 60", place=RADIUS + 0.05, kind=kind, limits=ARMED | {"speed": 1.0})
    gone = np.linalg.norm(np.diff(session.position, axis=0), axis=1)
    assert gone[59:62].max() > 1e-3  # more than the limit, in one nominal period
    assert session.cause == hdapi.DONE, session.sentence


def test_a_pull_device_is_driven_by_the_clock(files):
    """A device without a scheduler: the same guard, the same forces."""
    spec = hdapi.Simulated(**(TOUCH | {"hand_stiffness": 300.0, "hand_damping": 6.0}))
    side = np.array([1.0, 0, 0])
    wanted = order(files, 200, limits=ARMED)
    start, rest = (RADIUS + 5e-4) * side, (RADIUS - 0.004) * side
    pulled = hdapi.run_simulated(spec, start, rest, press=0 * side, order=wanted, clock=True)
    assert pulled.cause == hdapi.DONE, pulled.sentence
    assert len(pulled.force) == 200
    assert pulled.strongest > 0.1
    allowed(pulled)


def booked(session, stiffness):
    """The balance of a wall and a device, by the records alone: what energy.h books.

    Where a simulated device really was is known; else where it said it was.
    """
    balance, strongest, beyond, found = 0.0, 0.0, 0.0, [0.0]
    places = session.position[1:] if session.path is None else session.path[:-1]
    way = np.diff(places, axis=0, prepend=session.position[:1])
    for step, force, dt in zip(way, session.force[:-1], session.since[1:], strict=True):
        size, length = np.linalg.norm(force), np.linalg.norm(step)
        if size == 0:
            balance = strongest = beyond = 0.0
        else:
            strongest = max(strongest, size)
            work = force @ step
            balance = min(balance, strongest**2 / (2 * stiffness) + beyond)
            balance += TOUCH["damping"] * length**2 / dt - work
            if size > 3.3 * (1 - 1e-6):
                beyond = max(0, beyond - work)
        found.append(balance)
    return np.array(found)


def swings(position, since):
    """Return where (n,) the probe has gone to and fro by 0.1 mm within a thirtieth of a second."""
    now, found = np.cumsum(since), np.zeros(len(position), bool)
    for axis in range(3):
        turns, extreme, up = [], position[0, axis], False
        for tick, place in enumerate(position[:, axis]):
            extreme = max(extreme, place) if up else min(extreme, place)
            if abs(place - extreme) > 1e-4:
                turns, extreme, up = [*turns, now[tick]], place, not up
                if len(turns) > 2 and turns[-1] - turns[-3] < 1 / 30:
                    found[tick] = True
    return found


@pytest.mark.parametrize("damping", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("times", [2, 4, 8])
def test_an_unstable_wall_is_damped_or_ended(times, damping, files):
    """A livelier stand-in: little friction, forces three ticks late.

    Within 50 ms of the first sign it is damped, or the run ends; the hand gets 1 mJ at most.
    """
    lively = TOUCH | {"friction": 0.02, "delay": 3, "hand_damping": damping, "encoder": 20e-6}
    side = np.array([1.0, 0, 0])

    def go(stiffness):
        limits = {"stiffness": stiffness, "needs": 0, "ramp": 0, "encoder": 20e-6}
        spec = hdapi.Simulated(**(lively | {"wall": stiffness}))
        wanted = order(files, 1500, stiffness, LIMITS | ARMED | limits)
        start, rest = (RADIUS + 2e-4) * side, RADIUS * side
        return hdapi.run_simulated(spec, start, rest, press=-0.5 * side, order=wanted)

    ladder = 20 * 2 ** (np.arange(18) / 2)
    calm = [k for k in ladder if (r := go(k)).cause == hdapi.DONE and not r.signs
            and shaking(r.path[1000:]) < 1e-4]  # fmt: skip
    safe = calm[-1]
    session = go(times * safe)
    limits = {"needs": 0, "ramp": 0}
    allowed_free = limits | {"stiffness": times * safe}
    allowed(session, times * safe, allowed_free)
    balance = booked(session, times * safe)
    wrong = (balance < -2e-5) | swings(session.position, session.since)
    if session.cause == hdapi.DONE:
        now = np.cumsum(session.since)
        begun = None
        for tick in np.flatnonzero(wrong):
            if begun is None or not wrong[max(0, tick - 33) : tick].any():
                begun = now[tick]
            assert now[tick] - begun <= 0.085  # 50 ms, and a swing to see that it is over
    else:
        assert session.cause == hdapi.UNSTABLE
        first = np.flatnonzero(wrong)
        assert len(first)
        assert not session.force[-1].any()
    work = (session.force[:-1] * np.diff(session.position, axis=0)).sum(axis=1)
    gone = np.minimum.accumulate(balance).min()
    print(times, damping, safe, session.cause, len(session.force), gone, session.signs, work.sum())
    assert gone > -1e-3


def test_what_damping_does_not_mend_ends_after_fifty_milliseconds(files):
    """A hand that trembles against the wall 60 times a second, without the wall's giving energy."""
    ticks = 600
    rest = np.zeros((ticks, 3))
    tremble = 4e-4 * np.sin(2 * np.pi * 60 * 1e-3 * np.arange(ticks))
    rest[:, 0] = RADIUS - 3e-3 + np.where(np.arange(ticks) > 200, tremble, 0)
    spec = hdapi.Simulated(**(TOUCH | {"hand_stiffness": 4000.0, "hand_damping": 20.0}))
    wanted = order(files, ticks, limits=LIMITS | ARMED | {"needs": 0})
    start = np.array([RADIUS + 5e-4, 0, 0])
    session = hdapi.run_simulated(spec, start, rest, press=np.zeros(3), order=wanted)
    assert session.cause == hdapi.UNSTABLE
    assert session.signs == 1
    first = np.flatnonzero(swings(session.position, session.since))[0]
    last = np.flatnonzero(np.linalg.norm(session.force, axis=1))[-1]
    assert first > 200
    assert 40 <= last - first <= 50
    assert booked(session, STIFFNESS).min() > -1e-3
    allowed(session, limits={"needs": 0})


@pytest.fixture(scope="module")
def guard_program(tmp_path_factory):
    """Return the program that leads a guard by a script."""
    program = tmp_path_factory.mktemp("guard") / "guards"
    command = ["gcc", "-std=c99", "-Wall", "-Wextra", "-Wno-unused-function", "-I", HDAPI]
    subprocess.run([*command, HERE / "guards.c", "-o", program, "-lm"], check=True)

    def go(script):
        done = subprocess.run([program, script], capture_output=True, text=True, check=True)
        cause, debt, signs = done.stdout.split()
        return int(cause), float(debt), int(signs)

    return go


def test_shaking_counts_though_energy_was_missing_before(guard_program):
    """Only a sign that began with shaking was counted: 17 shakes in a second ended nothing."""
    assert guard_program("shakes")[0] == hdapi.UNSTABLE


def test_a_probe_that_slides_and_presses_while_the_force_comes_in_owes_nothing(guard_program):
    """What its own losses had paid for was charged again when it withdrew."""
    cause, debt, signs = guard_program("ramp")
    assert (cause, signs) == (hdapi.DONE, 0)
    assert debt > -2e-5


def test_a_force_that_outlives_its_wall_is_booked(guard_program):
    """By a wall that stores little, it gives more than it took, and nothing saw it."""
    assert guard_program("vanishes")[0] == hdapi.UNSTABLE


def test_whatever_a_guard_is_given_it_keeps_its_rules(tmp_path):
    """20,000 runs of odd limits, states and forces; each of a guard's own causes ends some."""
    command = ["gcc", "-std=c99", "-Wall", "-Wextra", "-Wno-unused-function", "-I", HDAPI]
    subprocess.run([*command, HERE / "guard_fuzz.c", "-o", tmp_path / "fuzz", "-lm"], check=True)
    done = subprocess.run([tmp_path / "fuzz", "20000", "1"], capture_output=True, check=True)
    broken, causes = map(int, done.stdout.split())
    assert broken == 0
    own = "SPEED", "NUMBER", "CALIBRATION", "SWITCH", "HOT", "UNSTABLE", "LIMITS", "ENCODER"
    for cause in own:
        assert causes >> getattr(hdapi, cause) & 1, cause
