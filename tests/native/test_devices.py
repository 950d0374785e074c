"""Forces on devices: the simulated one against the stress suite's, and HDAPI against a stand-in.

No test here needs a device, or a loop that holds a rate: what is late is counted, not judged.
"""

import ctypes
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import pandis
from pandis.base.physical import Scale
from pandis.pipeline.judge.stress import coupled
from pandis.pipeline.judge.stress.physical import Device
from pandis.runtime import device as hdapi
from pandis.runtime.device import watchdog as watchdog_module
from pandis.runtime.device.watchdog import Watchdog
from pandis.runtime.field import NativeField
from pandis.runtime.scene import NativeScene, Placed

HERE = Path(__file__).parent
HDAPI = Path(pandis.__file__).parent / "runtime" / "device"
#: The sphere of the tests has radius 1; it lies at the workspace's origin with 5 cm.
RADIUS, STIFFNESS = 0.05, 400.0
LIMITS = {
    "force": 3.3, "continuous": 0.0, "step": 3.3, "impulse": 3.3, "speed": 1.5, "ramp": 100,
    "damping": 0.1, "encoder": 55e-6, "stiffness": STIFFNESS, "most_damping": 2.0, "needs": 0,
}  # fmt: skip
TOUCH = {
    "mass": 0.045, "damping": 0.1, "friction": 0.26, "encoder": 55e-6, "force": 3.3,
    "impulse": 3.3, "speed": 1.5, "hand_stiffness": 20.0, "hand_damping": 3.0, "period": 1e-3,
    "wall": STIFFNESS, "delay": 0,
}  # fmt: skip
needs_gcc = pytest.mark.skipif(not shutil.which("gcc"), reason="no gcc here")


#: The hand on the stand-in: it pulls the probe 4 mm into the ball (N/m, Ns/m, m).
HELD = f"300 6 {RADIUS - 0.004}"
#: A busy machine is late: how late is not what these tests ask.
PATIENT = {"deadline": 100.0, "gap": 100.0, "patience": 100.0}


def ball(files, stiffness=STIFFNESS):
    field = NativeField(files["sphere"])
    return NativeScene([Placed(field, np.eye(3), np.zeros(3), RADIUS, stiffness)])


def order(files, ticks=400, stiffness=STIFFNESS, limits=None, **changes):
    given = hdapi.Limits(**(LIMITS | (limits or {})))
    return hdapi.Order(
        ball(files, stiffness), ticks, given, **({"armed": True} | PATIENT | changes)
    )


def press(files, ticks=900, stiffness=STIFFNESS, limits=None, device=None, start=2e-4, **changes):
    """Press a simulated device onto the ball's side, or pull it ``deep`` (m) into it."""
    deep, pulled = changes.pop("deep", 0.0), {"hand_stiffness": 400.0, "hand_damping": 8.0}
    spec = hdapi.Simulated(**(TOUCH | (pulled if deep else {}) | (device or {})))
    side = np.array([1.0, 0, 0])
    wanted = order(files, ticks, stiffness, limits, **changes)
    first, rest = (RADIUS + start) * side, (RADIUS - deep) * side
    return hdapi.run_simulated(spec, first, rest, press=-0.5 * side, order=wanted)


# --- the simulated device ---------------------------------------------------------


@pytest.mark.parametrize("delay", [0, 2])
@pytest.mark.parametrize("friction", [0.0, 0.26])
def test_the_simulated_device_moves_as_the_stress_suite_s(delay, friction, files):
    """Two programs of the same equations, one of them in C: the same shaking."""
    scale, ticks = Scale(2 * RADIUS, 400.0), 600
    device = Device(0.045, 0.1, friction, 0.0, delay, 3.3, 20.0, 0.5, 0.5)
    side = np.array([[1.0, 0, 0]])

    def answer(points):
        length = np.linalg.norm(points, axis=1)
        return length - 0.9, points / length[:, None]

    press_n = np.array([device.press])
    loop, places = coupled.Loop(answer, scale, device), (0.9 * side, side)
    swing = coupled.simulate(loop, places, np.array([400.0]), press=press_n, ticks=ticks).swing
    changes = {"friction": friction, "delay": delay, "encoder": 0.0, "impulse": 1e9}
    session = press(
        files, ticks + 1, 400.0, {"ramp": 0, "step": 1e9, "impulse": 1e9, "damping": 10.0,
         "most_damping": 0.0},
        changes | {"hand_damping": 0.5}, start=coupled.START,
    )  # fmt: skip
    assert session.cause == hdapi.DONE
    assert session.path[:-1] == pytest.approx(session.position[1:], abs=1e-15)
    found = coupled.shaking(session.path[ticks * 2 // 3 : ticks])
    assert found == pytest.approx(swing[0], rel=1e-6, abs=1e-12)
    assert swing[0] > 1e-7 or friction


def test_forces_follow_the_position_that_the_device_reports(files):
    session = press(files, 300, limits={"ramp": 0})
    depth = np.maximum(RADIUS - np.linalg.norm(session.position, axis=1), 0)
    assert np.linalg.norm(session.force, axis=1) == pytest.approx(STIFFNESS * depth, abs=1e-9)
    assert session.simulated
    assert not session.stand_in
    assert session.model == "simulated"


def test_a_run_is_the_same_again(files):
    one, other = press(files), press(files)
    assert np.array_equal(one.position, other.position)
    assert np.array_equal(one.force, other.force)


def test_the_force_comes_in_by_a_ramp(files):
    whole, slow = press(files, 50, limits={"ramp": 0}), press(files, 50, limits={"ramp": 1000})
    assert 0 < slow.strongest < 0.3 * whole.strongest


def test_force_and_change_stay_below_their_limits(files):
    free = press(files, 300, limits={"ramp": 0}, deep=0.02)
    assert free.cut > 0
    assert free.strongest == pytest.approx(3.3, rel=1e-9)
    gentle = press(files, 300, limits={"ramp": 0, "step": 0.05}, deep=0.02)
    assert gentle.cause in (hdapi.DONE, hdapi.UNSTABLE)  # what comes late gives energy
    assert gentle.slowed > 0
    assert added(gentle.force).max() <= 0.05 * (1 + 1e-9)


def added(force):
    """What was added in every tick to the share of the last force that was kept (n,)."""
    last = np.vstack([np.zeros(3), force[:-1]])
    square = np.maximum((last**2).sum(axis=1), 1e-300)
    share = np.clip((force * last).sum(axis=1) / square, 0, 1)
    return np.linalg.norm(force - share[:, None] * last, axis=1)


def test_a_falling_force_is_not_held_back(files):
    """Pulled out of a wall, the probe is let go at once: what is limited is what is added."""
    ticks = 200
    rest = np.full((ticks, 3), [RADIUS - 0.01, 0, 0])
    rest[150:, 0] = RADIUS + 0.002
    start, still = np.array([RADIUS + 2e-4, 0, 0]), np.zeros(3)
    limits = {"ramp": 0, "step": 0.3, "most_damping": 0.0, "speed": 10}
    session = hdapi.run_simulated(
        hdapi.Simulated(**(TOUCH | {"hand_stiffness": 800.0, "hand_damping": 8.0, "speed": 10})),
        start, rest, press=still, order=order(files, ticks, limits=limits),
    )  # fmt: skip
    depth = np.maximum(RADIUS - np.linalg.norm(session.position, axis=1), 0)
    held = np.linalg.norm(session.force, axis=1)
    leaving = slice(155, None)
    assert held[150] > 0.5
    assert depth[leaving].min() == 0
    assert (held[leaving] <= STIFFNESS * depth[leaving] + 1e-9).all()


def test_the_devices_own_limits_count_where_they_are_lower(files):
    """Wider limits than the device's own are no reason to be refused by its driver."""
    wide = {"ramp": 0, "force": 50, "step": 50, "impulse": 50, "speed": 50, "most_damping": 0}
    for device in ({"force": 1.0}, {"impulse": 0.05}):
        session = press(files, 300, 400, wide, device, deep=0.01)
        assert session.cause in (hdapi.DONE, hdapi.UNSTABLE), session.sentence
        assert session.cut + session.slowed > 0
        assert session.strongest <= device.get("force", 3.3) * (1 + 1e-12)
        assert session.steepest <= device.get("impulse", 3.3) * (1 + 1e-12)
    session = press(files, 300, 400, wide, {"speed": 0.01}, deep=0.01)
    assert session.cause in (hdapi.SPEED, hdapi.ERROR)
    assert not session.force[-1].any()


def test_a_stiff_wall_gives_energy_and_a_soft_one_does_not(files):
    """K < 2 b / T without friction: 200 N/m at 0.1 Ns/m (Colgate and Schenkel)."""
    bare = {"friction": 0.0, "encoder": 0.0, "hand_damping": 0.0, "hand_stiffness": 0.0}
    losses = {"ramp": 0, "damping": 0.1, "force": 1e3, "step": 1e3, "speed": 1e3}
    wide = bare | {"force": 1e3, "impulse": 1e3, "speed": 1e3}
    soft, stiff = (
        press(files, 900, k, losses | {"stiffness": k}, wide | {"wall": k}) for k in (100.0, 1200.0)
    )
    assert soft.worst > -1e-9
    assert stiff.worst < -1e-6


@needs_gcc
def test_a_long_way_along_a_wall_excuses_nothing(tmp_path):
    """Losses of a slide count no longer than the wall can store energy."""
    source = tmp_path / "energy.c"
    source.write_text(
        '#include "energy.h"\n#include <stdio.h>\n'
        "int main(void) {\n"
        "    energy e = {0};\n"
        "    for (int k = 0; k < 1000; k++) energy_book(&e, 1, 0.5, 0, 1e-4, 400, 0);\n"
        "    for (int k = 0; k < 15; k++) energy_book(&e, 1, 0.5, 1.4e-3, 0, 400, 0);\n"
        '    printf("%g", e.worst);\n'
        "    return 0;\n}\n"
    )
    command = ["gcc", "-std=c99", "-I", HDAPI, source, "-o", tmp_path / "energy", "-lm"]
    subprocess.run(command, check=True)
    found = subprocess.run([tmp_path / "energy"], capture_output=True, text=True, check=True)
    assert float(found.stdout) == pytest.approx(0.5**2 / 800 - 15 * 1.4e-3, rel=1e-5)


def test_without_arming_nothing_is_sent(files):
    session = press(files, 200, armed=False)
    assert session.cause == hdapi.DONE
    assert not session.force.any()
    assert session.strongest == session.cut == 0
    assert np.linalg.norm(session.position, axis=1).min() < RADIUS - 1e-4


@pytest.mark.parametrize("limit", [0.01, 0.2])
def test_a_fast_probe_ends_the_run(limit, files):
    session = press(files, 500, limits={"speed": limit, "ramp": 0}, deep=0.03)
    assert session.cause == hdapi.SPEED
    assert not session.force[-1].any()
    assert len(session.force) < 500


# --- HDAPI, against the stand-in ----------------------------------------------------


@pytest.fixture(scope="module")
def stand_in(tmp_path_factory):
    """Return the path of a compiled stand-in."""
    if not shutil.which("gcc"):
        pytest.skip("no gcc here")
    return compile_stand_in(tmp_path_factory.mktemp("hd") / "libHD.so")


def compile_stand_in(path, *flags):
    command = [
        "gcc",
        "-std=c99",
        "-O2",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-Wno-unused-function",
        "-fPIC",
        "-shared",
        *flags,
    ]
    command += ["-I", HDAPI, HERE / "libhd.c", "-o", path, "-lpthread", "-lm"]
    subprocess.run(command, check=True)
    return path


class Seen(ctypes.Structure):
    """What reached the stand-in: see libhd.c."""

    _fields_ = (
        *((n, ctypes.c_longlong) for n in ("begun", "ended", "calls", "enabled", "disabled")),
        ("largest", ctypes.c_double),
        ("sum", ctypes.c_double * 3),
        ("last", ctypes.c_double * 3),
    )


@pytest.fixture
def run(stand_in, files, monkeypatch):
    """Return what runs an order on the stand-in with a fault, and says what reached it."""

    def go(fault="", name="", **changes):
        monkeypatch.setenv("PANDIS_FAULT", fault)
        monkeypatch.setenv("PANDIS_PLACE", f"{changes.pop('place', RADIUS + 0.0005)} 0 0")
        monkeypatch.setenv("PANDIS_STANDIN", changes.pop("kind", HELD))
        wanted = {"ticks": 150, "limits": {"ramp": 4}} | changes
        session = hdapi.run_device(str(stand_in), name, order(files, **wanted))
        seen = Seen.in_dll(ctypes.CDLL(str(stand_in)), "standin_seen")
        assert seen.begun == seen.ended
        # whatever ends a run, no force is left; or nobody asks for one any more
        assert not any(seen.last) or (session.cause == hdapi.WATCHDOG and seen.disabled)
        return session, seen

    return go


def test_a_run_on_the_stand_in(run):
    """Begun and ended, the force in newtons, and never said to be a device's."""
    # Other programs may hold ticks up: the ramp takes longer then, and so does the way to zero.
    for _ in range(5):
        session, seen = run(name="Default Device")
        on_time = seen.begun == 150 + hdapi.RELEASE
        if in_time := on_time and session.since[1:].max() < 2e-3:
            break
    assert (session.cause, session.code) == (hdapi.DONE, 0)
    assert session.stand_in
    assert session.model == "stand-in"
    assert len(session.force) == 150
    assert seen.begun >= 150 + hdapi.RELEASE
    assert seen.enabled == 1
    assert seen.disabled >= 1
    assert seen.largest == pytest.approx(session.strongest)
    assert 0.1 < session.strongest < 1.0
    more = np.array(seen.sum) - session.force.sum(axis=0)  # sent after the last recorded tick
    assert np.abs(more).max() <= (1e-9 if on_time else session.strongest * hdapi.RELEASE)
    depth = RADIUS - np.linalg.norm(session.position, axis=1)
    late = slice(30, None)  # after the ramp
    sizes = np.linalg.norm(session.force, axis=1)[late]
    whole = STIFFNESS * np.maximum(depth, 0)[late]
    assert (sizes <= whole + 1e-9).all()
    if in_time:
        assert sizes == pytest.approx(whole, abs=1e-9)
    assert session.report.rate == pytest.approx(1000)
    assert session.report.force == pytest.approx(3.3)


def test_unarmed_no_force_is_sent(run):
    session, seen = run(armed=False)
    assert session.cause == hdapi.DONE
    assert seen.enabled == 0
    assert seen.largest == 0
    assert session.position.any()


@pytest.mark.parametrize("code", sorted(hdapi.ERRORS))
def test_every_error_ends_the_run_without_force(code, run):
    session, seen = run(f"error 60 {code:x}")
    assert (session.cause, session.code) == (hdapi.ERROR, code)
    assert hdapi.ERRORS[code] in session.sentence
    assert session.force[59].any()
    assert not session.force[60:].any()
    assert len(session.force) == 60 + hdapi.RELEASE
    assert seen.calls == len(session.force)


def test_an_unknown_error_ends_it_too(run):
    session, _ = run("error 60 777")
    assert (session.cause, session.code) == (hdapi.ERROR, 0x777)
    assert "0x0777" in session.sentence


def test_a_device_that_is_unplugged(run):
    session, _ = run("unplugged 50", patience=0.2)
    assert session.cause == hdapi.WATCHDOG
    assert len(session.force) == 50
    assert "no call" in session.sentence


def test_a_callback_that_overruns(run):
    """One that is late is counted; several in a row end the run, as one far too long does."""
    once, _ = run("slow 40", deadline=0.02, overruns=2)
    assert once.cause == hdapi.DONE
    assert once.taken[40] > 0.02
    session, _ = run("slow 40", deadline=0.02, overruns=1)
    assert session.cause == hdapi.OVERRUN
    assert not session.force[40:].any()
    session, _ = run("slow 40", gap=0.02)
    assert session.cause == hdapi.GAP
    assert not session.force[40:].any()


def test_calls_that_are_too_far_apart(run):
    session, _ = run("apart 40", gap=0.05)
    assert session.cause == hdapi.GAP
    assert session.force[39].any()
    assert not session.force[41:].any()


HANGS = """
import signal, sys, time
# a shell has the jobs in its background ignore an interrupt
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.path[:0] = {path!r}
import numpy as np
from pandis.runtime import device as hdapi
from pandis.runtime.field import NativeField
from pandis.runtime.scene import NativeScene, Placed
field = NativeField({field!r})
scene = NativeScene([Placed(field, np.eye(3), np.zeros(3), 0.05, 400.0)])
limits = hdapi.Limits(3.3, 0, 3.3, 3.3, 1.5, 4, 0.1, 55e-6, 400.0, 2.0, 0)
order = hdapi.Order(scene, 150, limits, 1e-3, 100, 3, 100, {patience}, armed=True)
session = hdapi.run_device({library!r}, "", order)
print(session.cause, len(session.force))
again = hdapi.run_device({library!r}, "", order)
print(again.cause, again.sentence)
time.sleep(2)
"""


def in_a_process_of_its_own(stand_in, files, fault, patience=100.0):
    """Run an order twice; return what is printed, and the process's exit code."""
    code = HANGS.format(
        path=[str(Path(pandis.__file__).parents[1])],
        field=str(files["sphere"]),
        library=str(stand_in),
        patience=patience,
    )
    extra = {"PANDIS_FAULT": fault, "PANDIS_PLACE": f"{RADIUS + 0.0005} 0 0"}
    extra["PANDIS_STANDIN"] = HELD
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | extra,
        capture_output=True,
        text=True,
        check=False,
    )
    return done


def test_a_callback_that_hangs(stand_in, files):
    """The run ends though the callback does not, no other begins; what it writes to lives on."""
    done = in_a_process_of_its_own(stand_in, files, "hang 40", 0.2)
    assert done.returncode == 0, done.stderr
    first, second = done.stdout.splitlines()
    assert first == f"{hdapi.WATCHDOG} 40"
    assert second.startswith(f"{hdapi.WATCHDOG} ")
    assert "never returned" in second


def test_an_interrupt_ends_the_run_and_reaches_python(stand_in, files):
    for _ in range(3):  # beside other work the gap between two calls may end the run before
        done = in_a_process_of_its_own(stand_in, files, "raise 40")
        if done.returncode:
            break
    assert done.returncode != 0
    assert "KeyboardInterrupt" in done.stderr
    assert done.stdout == ""


#: An armed run in a process of its own, which something happens to; PANDIS_RECORD outlives it.
DIES = """
import os, signal, sys, threading, time
sys.path[:0] = {path!r}
import numpy as np
from pandis.runtime import device as hdapi
from pandis.runtime.field import NativeField
from pandis.runtime.scene import NativeScene, Placed
if {faulthandler}:
    import faulthandler
    faulthandler.enable()
field = NativeField({field!r})
scene = NativeScene([Placed(field, np.eye(3), np.zeros(3), 0.05, 400.0)])
limits = hdapi.Limits(3.3, 0, 3.3, 3.3, 1.5, 4, 0.1, 55e-6, 400.0, 2.0, 0)
order = hdapi.Order(scene, 100000, limits, 1e-3, 100, 3, 100, 100, armed=True)
if {outside}:
    def send():
        while os.path.getsize({record!r}) < 32 or np.fromfile({record!r})[1] < 0.1:
            time.sleep(0.001)
        os.kill(os.getpid(), {number})
    open({record!r}, "wb").close()
    threading.Thread(target=send, daemon=True).start()
hdapi.run_device({library!r}, "", order)
"""


@pytest.mark.parametrize("outside", [False, True])
@pytest.mark.parametrize(
    "name",
    ["SIGSEGV", "SIGBUS", "SIGFPE", "SIGABRT", "SIGXCPU", "SIGUSR1", "SIGALRM", "SIGTERM"],
)
def test_a_process_that_dies_lets_go_of_the_device(name, outside, stand_in, files, tmp_path):
    """In the callback, and from another thread: zero goes out, the motors are off, then it dies."""
    number, record = int(getattr(signal, name)), tmp_path / "record"
    code = DIES.format(
        path=[str(Path(pandis.__file__).parents[1])], field=str(files["sphere"]),
        library=str(stand_in), number=number, record=str(record), outside=outside,
        faulthandler=name == "SIGSEGV",
    )  # fmt: skip
    extra = {
        "PANDIS_FAULT": "" if outside else f"raise 60 {number:x}",
        "PANDIS_PLACE": f"{RADIUS + 0.0005} 0 0", "PANDIS_STANDIN": HELD,
        "PANDIS_RECORD": str(record),
    }  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | extra, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == -number, done.stderr
    largest, last, output, _ = np.fromfile(record)
    assert largest > 0.1
    assert last == output == 0
    assert "motors hold the last force" in done.stderr


def test_a_signal_that_the_program_has_plans_for_is_left_to_it(run):
    seen = []
    before = signal.signal(signal.SIGUSR1, lambda number, _: seen.append(number))
    try:
        session, _ = run(f"raise 60 {int(signal.SIGUSR1):x}")
        assert session.cause == hdapi.DONE
        assert session.force[60:].any()
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert seen == [signal.SIGUSR1]


@contextmanager
def armed_process(stand_in, files, record, *, shared):
    """Give an armed run in a process of its own, once it has sent a force."""
    record.write_bytes(b"")
    code = DIES.format(
        path=[str(Path(pandis.__file__).parents[1])], field=str(files["sphere"]),
        library=str(stand_in), number=0, record=str(record), outside=False, faulthandler=False,
    )  # fmt: skip
    extra = {
        "PANDIS_FAULT": "", "PANDIS_PLACE": f"{RADIUS + 0.0005} 0 0", "PANDIS_STANDIN": HELD,
        "PANDIS_RECORD": str(record),
    } | ({"PANDIS_SHARED": "1"} if shared else {})  # fmt: skip
    said = record.with_suffix(".said")
    with said.open("w") as log:
        process = subprocess.Popen(
            [sys.executable, "-c", code], env=os.environ | extra, stderr=log, text=True
        )
    try:
        wait_for(record, lambda last, _: last > 0.1)
        yield process, said
    finally:
        process.kill()
        process.wait()


def wait_for(record, reached, seconds=60.0):
    """Wait until the device is in a state (last force, whether the motors are on); return it."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        kept = np.fromfile(record)
        if len(kept) == 4 and reached(*kept[1:3]):
            return kept
    raise AssertionError(f"the device stays at {np.fromfile(record)}")


@pytest.mark.parametrize("name", ["SIGSTOP", "SIGKILL"])
def test_a_process_that_is_killed_or_halted_is_watched(name, stand_in, files, tmp_path):
    """Where the library lets a second process have the device, that one ends the force."""
    record = tmp_path / "record"
    with armed_process(stand_in, files, record, shared=True) as (process, said):
        sent = time.monotonic()
        process.send_signal(getattr(signal, name))
        kept = wait_for(record, lambda last, output: not last and not output)
        print(f"{name}: off after {1e3 * (kept[3] - sent):.0f} ms")
        if name == "SIGSTOP":  # it goes on, and finds the motors off
            process.send_signal(signal.SIGCONT)
            process.wait(60)
            assert not np.fromfile(record)[1:3].any()
    assert "motors hold the last force" not in said.read_text()


def test_arming_says_what_a_killed_process_leaves_where_nobody_can_watch(stand_in, files, tmp_path):
    record = tmp_path / "record"
    with armed_process(stand_in, files, record, shared=False) as (process, said):
        process.kill()
        process.wait()
        _, last, output, _ = np.fromfile(record)
    assert last > 0.1
    assert output
    assert "motors hold the last force" in said.read_text()
    assert "No second process could take the device" in said.read_text()


def test_a_watchdog_that_starts_too_late_goes(stand_in, monkeypatch, tmp_path):
    """It took the device after its run was over, and switched off the next one's force."""
    monkeypatch.setenv("PANDIS_SHARED", "1")
    monkeypatch.setenv("PANDIS_RECORD", str(tmp_path / "record"))
    monkeypatch.setattr(watchdog_module, "_PATIENCE", 0.0)  # it gives up at once
    compiled = hdapi.library()._name
    with Watchdog(compiled, str(stand_in), "") as watchdog:
        assert watchdog.start() == 0
        assert watchdog.pulse.state == watchdog_module.OVER
    assert watchdog._process.returncode is not None


def test_a_run_that_ends_is_not_ended_by_its_watchdog(run, monkeypatch, tmp_path):
    monkeypatch.setenv("PANDIS_SHARED", "1")
    monkeypatch.setenv("PANDIS_RECORD", str(tmp_path / "record"))
    session, _ = run()
    assert (session.cause, session.watched) == (hdapi.DONE, True)
    assert session.force.any()
    monkeypatch.delenv("PANDIS_SHARED")
    assert not run()[0].watched
    assert not run(armed=False)[0].watched


def test_a_second_run_is_refused_and_the_first_unharmed(run, files):
    """It left the device armed with nobody at the wheel; on a device it crashed the process."""
    refused = []

    def others(until):
        while not until.is_set():
            refused.append(press(files, 10).cause)

    over = threading.Event()
    threads = [threading.Thread(target=others, args=(over,)) for _ in range(3)]
    alone, _ = run(ticks=400)
    for thread in threads:
        thread.start()
    try:
        session, seen = run(ticks=400)
    finally:
        over.set()
        for thread in threads:
            thread.join()
    assert {hdapi.BUSY} <= set(refused) <= {hdapi.BUSY, hdapi.DONE}
    if session.cause == hdapi.BUSY:  # one of the others was first
        session, seen = run(ticks=400)
    assert session.cause == alone.cause == hdapi.DONE
    assert len(session.force) == 400
    assert seen.enabled == 1
    assert not any(seen.last)
    assert "wait for its end" in session._replace(cause=hdapi.BUSY).sentence


def test_two_runs_in_a_row(run):
    """What one leaves in the list of errors is not the next one's fault."""
    for _ in range(2):
        session, _ = run()
        assert session.cause == hdapi.DONE, session.sentence


@pytest.mark.parametrize(("fault", "said"), [("weak", "another model"), ("fast", "another rate")])
def test_a_device_that_is_not_the_one_expected_is_refused(fault, said, run):
    for armed in (True, False):
        session, seen = run(fault, expected=3.3, armed=armed)
        assert session.cause == hdapi.DEVICE
        assert said in session.sentence
        assert seen.enabled == seen.calls == 0


def test_a_device_that_tells_nothing_of_itself(run):
    """It runs within the limits that were asked for, but is armed as no particular model."""
    session, seen = run("mute", expected=3.3)
    assert session.cause == hdapi.DEVICE
    assert "another model" in session.sentence
    assert seen.enabled == 0
    session, seen = run("mute", expected=3.3, armed=False)
    assert (session.cause, session.model) == (hdapi.DONE, "")
    session, seen = run("mute")
    assert session.cause == hdapi.DONE
    assert 0.1 < seen.largest < 1.0
    assert session.report.force == session.report.rate == 0


def test_a_position_that_is_no_number(run):
    session, _ = run("nan 40")
    assert session.cause == hdapi.NUMBER
    assert session.force[39].any()
    assert not session.force[40:].any()


def test_a_position_that_jumps(run):
    session, _ = run("jump 40")
    assert session.cause == hdapi.SPEED
    assert not session.force[40:].any()


@pytest.mark.parametrize(
    ("fault", "name", "code"),
    [
        ("init", "", 0x0300),
        ("nothing", "", 0x0300),
        ("doubtful", "", 0x0302),
        ("", "Left Device", 0x0300),
    ],
)
def test_no_device(fault, name, code, run):
    session, seen = run(fault, name)
    assert (session.cause, session.code) == (hdapi.DEVICE, code)
    assert len(session.force) == 0
    assert seen.enabled == 0
    assert run()[0].cause == hdapi.DONE  # nothing of it is left open


def test_a_scheduler_that_does_not_start(run):
    session, _ = run("start")
    assert (session.cause, session.code) == (hdapi.DEVICE, 0x0304)
    assert len(session.force) == 0


def test_no_library(files, tmp_path):
    session = hdapi.run_device(str(tmp_path / "libHD.so"), "", order(files))
    assert session.cause == hdapi.LIBRARY
    assert "libHD.so" in session.sentence


@needs_gcc
def test_a_library_that_lacks_a_function(files, tmp_path):
    old = compile_stand_in(tmp_path / "libHD.so", "-DhdGetString=hdGetText")
    session = hdapi.run_device(str(old), "", order(files))
    assert session.cause == hdapi.LIBRARY
    assert "hdGetString" in session.sentence


def test_nothing_to_run(files):
    with pytest.raises(ValueError, match="at least one tick"):
        press(files, 0)
