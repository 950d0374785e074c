"""What is said of a field on a device: limits, energy, safe stiffness, and what ran at all."""

from functools import partial

import numpy as np
import pytest
from test_devices import RADIUS

from pandis.base.physical import Scale
from pandis.pipeline.geometry.trajectories import trace
from pandis.pipeline.judge.controls import controls
from pandis.pipeline.judge.servo.attached import Safety, Span, run_attached, stiffness_for
from pandis.pipeline.judge.servo.devices import DEVICES
from pandis.pipeline.judge.servo.pressing import Hand, Setup, contact, press
from pandis.pipeline.judge.servo.validation import _attached, _statement, press_devices
from pandis.pipeline.judge.servo.verdict import (
    device_sentence,
    judge,
    machine_sentence,
    machine_verdict,
)
from pandis.pipeline.judge.servo.walls import compare, open_walls
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.run.ask.options import AttachedOptions, TrajectoryOptions
from pandis.pipeline.run.ask.tasks import ValidateTask
from pandis.pipeline.run.job.stage import silent_progress
from pandis.runtime.contact import Feel
from pandis.runtime.device import Order
from pandis.runtime.field import NativeField
from shapes import open_shape
from verdicts import PRESSED, SOUND, TIMES, WHOLE, changed

HAND = {"stiffness": 20.0, "damping": 3.0, "press": 0.5, "delay": 0}
SIZE = 0.1
SCALE = Scale(SIZE, 400.0)


def task(**options):
    return ValidateTask(**({"contact": {}} | options), fields=[], hand=HAND, seed=0)


@pytest.fixture(scope="module")
def surface(fields):
    """Return where the torus is pressed on: as `trajectory` gives it."""
    held, _ = trace(
        fields["exact"].body, TrajectoryOptions(samples=400), 2, progress=silent_progress
    )
    walls = open_walls(fields["exact"], SCALE, 3)
    return contact(held, walls.pressed, walls.thin, size=SIZE)


def pressed(name, files, surface, device="touch", stiffness=400.0, feel=None, **hand):
    field = NativeField(files[name])
    spec = DEVICES[device]
    setup = Setup(SIZE, stiffness, Hand(**(HAND | hand)), 1000.0)
    return press(field, spec, surface, setup=setup, feel=feel)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["exact", "spline", "tricubic"])
def test_a_proxy_is_safe_up_to_what_a_penalty_force_is(name, files, surface):
    for device in ("touch-x", "omega-3"):
        stiffness = DEVICES[device].stiffness / 2
        with_it = pressed(name, files, surface, device, stiffness, Feel())
        without = pressed(name, files, surface, device, stiffness)
        assert without.safe_n_m > 0
        assert with_it.safe_n_m >= without.safe_n_m
        assert all(with_it.hands[hand] >= most for hand, most in without.hands.items())


@pytest.mark.slow
def test_an_exact_surface_is_safe_on_every_device(files, surface):
    for device, spec in DEVICES.items():
        found = pressed("exact", files, surface, device)
        assert found.within_limits == (device != "falcon")
        assert found.passive
        assert found.quiet == 1
        assert found.safe_n_m <= spec.stiffness
        sentence = device_sentence(device, found, WHOLE)
        if device == "falcon":  # whose workspace has a radius of 40 mm, the torus one of 50
            assert judge(found, WHOLE) == "fail"
            assert "reaches 50 mm from the middle of a workspace with a radius of 40 mm" in sentence
            continue
        assert judge(found, WHOLE) == "pass"
        assert "keeps still and gives no energy" in sentence


def test_a_stepped_field_gives_energy_and_is_told_so(files, surface):
    """The nearest of 20³ nodes: its force jumps at every cell, and work goes missing."""
    found = pressed("nearest", files, surface)
    assert not found.passive
    assert found.energy_j < -1e-4
    assert judge(found, WHOLE) == "fail"
    sentence = device_sentence("touch", found, WHOLE)
    assert "mJ more than the device loses" in sentence
    assert "use at most" in sentence or "do not use it" in sentence
    assert found.safe_n_m < pressed("exact", files, surface).safe_n_m


def test_a_field_that_pushes_in_free_space_is_pressed_from_above_its_ghosts(files, surface):
    """No device is armed within a force: pressed from 0.2 mm, it got none, and was called calm."""
    found = pressed("trilinear", files, surface)
    assert found.unarmed == 0
    assert found.strongest_n > 0.3


def test_a_press_that_gets_no_force_is_not_calm(files, surface, monkeypatch):
    monkeypatch.setattr("pandis.pipeline.judge.servo.pressing._HEIGHTS", np.full(7, -3e-4))
    found = pressed("exact", files, surface)
    assert found.unarmed == len(surface.feet)
    assert found.quiet == 0
    assert found.safe_n_m == 0
    assert judge(found, WHOLE) == "fail"
    assert "presses got no force" in device_sentence("touch", found, WHOLE)


def test_a_hard_push_is_beyond_the_devices_limit(files, surface):
    found = pressed("exact", files, surface, press=6.0)
    assert found.cut > 0
    assert found.strongest_n == pytest.approx(DEVICES["touch"].force)
    assert judge(found, WHOLE) == "fail"
    assert "required more than its 3.3 N" in device_sentence("touch", found, WHOLE)


def test_late_forces_lower_the_safe_stiffness(files, surface):
    """On a device whose friction does not carry it: the Touch X."""
    prompt, late = (
        pressed("exact", files, surface, "touch-x", 1000.0, delay=delay) for delay in (0, 10)
    )
    assert late.safe_n_m < prompt.safe_n_m


def test_the_verdict_is_the_same_again(files, surface):
    assert pressed("tricubic", files, surface) == pressed("tricubic", files, surface)


@pytest.mark.slow
def test_every_device_is_named(files, surface):
    options = task(devices=["touch", "falcon"])
    found = press_devices(NativeField(files["torus"]), surface, WHOLE, options=options)
    assert list(found) == ["touch", "falcon"]
    assert found["touch"].verdict == "pass"
    walls = changed(WHOLE, pressed_missing=2)
    failed = press_devices(NativeField(files["torus"]), surface, walls, options=options)["touch"]
    assert failed.verdict == "fail"
    assert "the force is missing at 2 of the points that a device presses on" in failed.sentence
    assert "do not use it" in failed.sentence
    walls = changed(WHOLE, missing=0.02, holds=False)
    lacking = press_devices(NativeField(files["torus"]), surface, walls, options=options)["touch"]
    assert lacking.verdict == "fail"
    assert "on 2.00% of the surface the force is missing; do not use it" in lacking.sentence
    assert found["falcon"].sentence.startswith(
        "On a simulated Falcon in a hand of 3 Ns/m at 400 N/m"
    )


def test_a_slow_machine_is_told_what_to_do():
    lacking = changed(WHOLE, holds=False, missing=0.02)
    slow = {"in_time": False, "miss_share": 0.25, "late_share": 0.5}
    verdict = changed(SOUND, **slow, compute_us=TIMES | {"p99.9": 900.0})
    good = changed(verdict, in_time=True)
    options = task()
    assert "25 % of the ticks compute longer than 800 µs" in machine_sentence(verdict, options)
    said = machine_sentence(good, options)
    assert said == "It holds 1000 Hz here: 900 of 800 µs in 99.9 % of the ticks."
    assert "export it again" in machine_sentence(changed(verdict, agrees=False), options)
    late = machine_sentence(changed(good, punctual=False), options)
    assert "Not judged: the machine was late. 50 % of the ticks began more than 800 µs late" in late
    changes = ({}, {"punctual": False}, {"punctual": False, "in_time": False})
    verdicts = [machine_verdict(changed(good, **change)) for change in changes]
    assert verdicts == ["pass", "late", "fail"]
    assert machine_verdict(changed(good, walls=lacking)) == "fail"
    gone = machine_sentence(changed(good, walls=lacking), options)
    assert "Do not use it: on 2.00% of the surface the force is missing" in gone


@pytest.mark.slow
@pytest.mark.parametrize("name", ["plate-2", "finned-ball", "blade", "cage"])
def test_no_control_passes_the_hardware_verdict(name):
    """A field of no force was called “pass … it keeps still and gives no energy”."""
    shape = open_shape(name)
    exact = ExactField("exact", shape.body)
    walls = open_walls(exact, SCALE, 1)
    # the blade's edge tapers to nothing: too much of it is too thin for any field to be sold
    assert compare(exact, walls).holds == (name != "blade")
    for control in controls(exact, SCALE):
        found = compare(control, walls)
        assert not found.holds
        assert found.missing > 0.005


#: What allows a device to be armed: a stiffness that is safe for a light hand, and all walls.
SAFE = changed(PRESSED, hands={"0.3": 1e3})


def attach(library, files, monkeypatch, arm=True, fault="", place=RADIUS + 5e-4, allowed=True):
    monkeypatch.setenv("PANDIS_FAULT", fault)
    monkeypatch.setenv("PANDIS_PLACE", f"{place} 0 0")
    monkeypatch.setenv("PANDIS_STANDIN", f"300 6 {place - 4.5e-3}")
    monkeypatch.setenv("PANDIS_ARM", "1")
    monkeypatch.setattr(
        "pandis.pipeline.judge.servo.attached.Order", partial(Order, gap=100.0, patience=100.0)
    )
    options = AttachedOptions(library=str(library), arm=arm)
    safety = Safety(SAFE, WHOLE) if allowed else Safety()
    field, span = NativeField(files["sphere"]), Span(0.05, 10)
    return run_attached(field, Scale(SIZE, 1e4), options, span=span, safety=safety)


@pytest.mark.parametrize(("arm", "fault"), [(True, ""), (False, ""), (True, "error 20 301")])
def test_a_stand_in_is_never_a_device(arm, fault, libraries, files, monkeypatch):
    arrays, found = attach(libraries[0], files, monkeypatch, arm, fault)
    assert found.stand_in
    assert not found.hardware
    assert found.stiffness == DEVICES["touch"].stiffness
    assert "this is not a hardware result" in found.statement
    assert arrays["force"].any() == arm
    statement = _statement({"sphere": changed(SOUND, attached=found)})
    assert "forces were sent" not in statement
    assert "stand-in" in statement


def test_what_is_said_of_a_device(libraries, files, monkeypatch):
    """A hardware result is a run to the end in which forces were sent, and nothing else."""
    arrays, found = attach(libraries[1], files, monkeypatch)
    assert found.hardware
    assert "forces were sent to it" in found.statement
    assert arrays["force"].any()
    for said, changes in {
        "no force was sent": {"arm": False},
        "was not touched": {"place": 0.08},
        "ended early: the device reported an error: HD_COMM_ERROR": {"fault": "error 20 302"},
        "No device ran": {"fault": "init"},
    }.items():
        _, found = attach(libraries[1], files, monkeypatch, **changes)
        assert said in found.statement
        assert not found.hardware


def test_arming_needs_a_word_of_its_own_for_each_run(libraries, files, monkeypatch):
    order = partial(Order, gap=100.0, patience=100.0)
    monkeypatch.setattr("pandis.pipeline.judge.servo.attached.Order", order)
    monkeypatch.delenv("PANDIS_ARM", raising=False)
    monkeypatch.setenv("PANDIS_PLACE", f"{0.9 * RADIUS} 0 0")
    options = AttachedOptions(library=str(libraries[1]), arm=True)
    field = NativeField(files["sphere"])
    arrays, found = run_attached(
        field, SCALE, options, span=Span(0.05, 8e-4), safety=Safety(SAFE, WHOLE)
    )
    assert not arrays["force"].any()
    assert not found.armed
    assert "PANDIS_ARM is not set" in found.statement


def test_an_armed_device_gets_what_is_safe_for_a_light_hand():
    touch = DEVICES["touch"]
    assert stiffness_for(1e4, touch, Safety(SAFE, WHOLE)) == (touch.stiffness, "")
    weak = changed(SAFE, hands={"0.3": 200.0, "3": 1e3})
    assert stiffness_for(400.0, touch, Safety(weak, WHOLE)) == (pytest.approx(140.0), "")
    assert stiffness_for(100.0, touch, Safety(weak, WHOLE)) == (100.0, "")
    assert (
        "does not give its field's forces"
        in stiffness_for(400.0, touch, Safety(SAFE, WHOLE, sound=False))[1]
    )
    for known, why in {
        (None, None): "no safe stiffness is known",
        (0, 1): "lacks a part of the surface",
        (0, 2): "lacks a part of the surface",
        (1, 0): "no stiffness is safe",
    }.items():
        pressed = (
            (SAFE, changed(SAFE, hands={"0.3": 0.0}))[known[0]] if known[0] is not None else None
        )
        walls = (WHOLE, changed(WHOLE, holds=False), changed(WHOLE, pressed_missing=1))
        walls = walls[known[1]] if known[1] is not None else None
        found = stiffness_for(400.0, touch, Safety(pressed, walls))
        assert why in found[1]


def test_without_a_safe_stiffness_no_force_is_sent(libraries, files, monkeypatch):
    arrays, found = attach(libraries[1], files, monkeypatch, allowed=False)
    assert not found.armed
    assert not arrays["force"].any()
    assert "although arming was asked for: no safe stiffness is known" in found.statement


def test_the_stiffness_that_is_sent_is_the_one_found_safe(libraries, files, monkeypatch):
    """On every tick, by the record: at most 0.7 of what is safe for a light hand."""
    monkeypatch.setitem(SAFE.hands, "0.3", 100.0)
    arrays, found = attach(libraries[1], files, monkeypatch)
    assert found.stiffness == pytest.approx(70.0)
    depth = np.maximum(RADIUS - np.linalg.norm(arrays["position"], axis=1), 0)
    assert arrays["force"].any()
    assert (np.linalg.norm(arrays["force"], axis=1) <= 70.0 * depth + 0.05).all()


def test_a_whole_validation_arms_with_no_more_than_its_own_figure(libraries, files, surface):
    """The simulated device of the attached model is pressed though nobody asked for it."""
    options = task(devices=[], seconds=0.05, attached={"library": str(libraries[0])})
    _, found = _attached(NativeField(files["exact"]), surface, SOUND, devices={}, options=options)
    alone = options.model_copy(update={"devices": ["touch"]})
    own = press_devices(NativeField(files["exact"]), surface, WHOLE, options=alone)["touch"]
    assert found.stiffness == pytest.approx(min(400.0, 0.7 * own.hands["0.3"]))


def test_no_library_is_said(files, tmp_path):
    options = AttachedOptions(library=str(tmp_path / "none.so"))
    _, found = run_attached(NativeField(files["sphere"]), SCALE, options, span=Span(0.01, 8e-4))
    assert found.statement.startswith("No device ran: the device's library cannot be used")
    assert not found.hardware
