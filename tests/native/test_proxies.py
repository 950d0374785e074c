"""A field through a proxy in the hardware validation: what it costs, what is safe, what is sent."""

import numpy as np
import pytest
from test_verdict import SCALE, SIZE, task

from pandis.base.errors import PandisError
from pandis.base.frame import UNIT_SIDE
from pandis.pipeline.geometry.shapes import Sphere
from pandis.pipeline.judge.servo.attached import Safety, Span, run_attached, stiffness_for
from pandis.pipeline.judge.servo.devices import DEVICES
from pandis.pipeline.judge.servo.passes import Oracle
from pandis.pipeline.judge.servo.pressing import Contact
from pandis.pipeline.judge.servo.proxies import (
    LEAST,
    MOST,
    Surfaces,
    Truth,
    feel_for,
    felt_again,
    time_proxy,
    touch_device,
    touch_devices,
)
from pandis.pipeline.judge.servo.validation import _attached, _Felt
from pandis.pipeline.judge.servo.verdict import paragraph, proxy_sentence, proxy_verdict
from pandis.pipeline.run.ask.contacts import ContactOptions, MaterialOptions
from pandis.pipeline.run.ask.options import AttachedOptions
from pandis.runtime.contact import Feel, Material, TouchedScene
from pandis.runtime.device import Order
from pandis.runtime.field import NativeField
from verdicts import PRESSED, SOUND, WHOLE, changed

METRES = SIZE / UNIT_SIDE
PLAIN = Surfaces({}, {})


@pytest.fixture(scope="module")
def ball():
    """Return where a hand presses on a ball of 10 cm, its oracle, and a way into it; metres."""
    vertices, faces = Sphere(0.9).tessellation()
    rng = np.random.default_rng(0)
    outward = rng.normal(size=(6, 3))
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    feet = 0.05 * outward
    turn = np.linspace(0, 3, 400)
    round_it = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    places = Contact(0.05 * round_it, round_it, feet, outward, np.full(6, 0.05), feet, outward)
    way = np.concatenate([np.linspace(0.06, 0.048, 50)[:, None] * round_it[0], 0.048 * round_it])
    return Truth(Oracle(vertices * METRES, faces), feet, places, WHOLE), way


def test_a_feel_is_of_the_configuration_and_fits_into_the_deadline(files):
    exact, grid = NativeField(files["exact"]), NativeField(files["trilinear"])
    rubs = ContactOptions(sticking=0.5, radius=1e-3, materials={"fur": MaterialOptions(drag=2.0)})
    feel, surfaces, lacks = feel_for(exact, None, rubs, size=SIZE, seconds=1e-6, deadline=8e-4)
    assert (feel.radius, feel.queries, lacks) == (1e-3, MOST, "")
    assert (feel.materials[0].sticking, feel.materials[0].sliding) == (0.5, 0.5)
    assert list(surfaces.materials) == ["the surface"]  # its file names no materials
    assert feel_for(exact, None, rubs, size=SIZE, seconds=4e-5, deadline=8e-4)[0].queries == 10
    assert feel_for(exact, None, rubs, size=SIZE, seconds=1e-3, deadline=8e-4)[0].queries == LEAST
    seven = rubs.model_copy(update={"queries": 7})
    assert feel_for(exact, None, seven, size=SIZE, seconds=1e-6, deadline=8e-4)[0].queries == 7
    assert (
        "has no distances outside"
        in feel_for(grid, None, rubs, size=SIZE, seconds=1e-6, deadline=8e-4)[2]
    )
    penalty = rubs.model_copy(update={"kind": "penalty"})
    assert feel_for(exact, None, penalty, size=SIZE, seconds=1e-6, deadline=8e-4)[0] is None


@pytest.mark.slow
def test_a_ball_lets_no_hand_through_and_a_smaller_one_does(files, ball):
    truth, way = ball
    field = NativeField(files["sphere"])
    options = task(devices=["touch", "omega-3"], stiffness=100.0)
    found = time_proxy(field, Feel(), PLAIN, path=way, options=options)
    assert found.in_time
    assert 0 < found.queries["p50"] <= 4
    devices = touch_devices(field, Feel(), truth, options=options)
    assert list(devices) == options.devices
    for name, device in devices.items():
        assert device.presses == 6
        assert (device.passes, device.verdict) == (0, "pass")
        assert device.safe_n_m > 1e3 or device.safe_n_m == DEVICES[name].stiffness
        assert "no wall lets it through in 6 presses" in device.sentence
    # the omega's 12 N are more than the ball's 5 cm hold at 100 N/m, the Touch's 3.3 N are not
    assert [device.penalty_passes for device in devices.values()] == [0, 6]
    # the mesh is a larger ball: 0.5 mm deep is a pass, unless the field's own error is as large
    judge = Oracle(truth.oracle.vertices * 1.01, truth.oracle.faces)
    for feet, passes in ((np.empty((0, 3)), 6), (1.01 * truth.feet, 0)):
        other = truth._replace(oracle=judge, feet=feet)
        found = touch_device("touch", field, Feel(), truth=other, options=options)
        assert found.passes == passes
        assert found.verdict == ("fail" if passes else "pass")


def test_a_proxy_that_a_wall_lets_through_arms_nothing(ball, files):
    field, options = NativeField(files["sphere"]), task(devices=["touch"])
    found = touch_device("touch", field, Feel(), truth=ball[0], options=options)
    spec = DEVICES["touch"]
    assert stiffness_for(400.0, spec, Safety(found, WHOLE)) == (pytest.approx(0.7 * 400), "")
    through = changed(found, passes=1)
    assert "walls let its proxy through" in stiffness_for(400.0, spec, Safety(through, WHOLE))[1]
    # nothing was pressed, so nothing has come through
    untried = changed(found, presses=0, passes=0)
    assert proxy_verdict(untried) == "fail"
    assert "no room" in proxy_sentence(untried)
    assert "do not use it" in proxy_sentence(untried)
    assert "nothing is known of its walls" in stiffness_for(400.0, spec, Safety(untried, WHOLE))[1]


def test_a_proxy_that_touched_nothing_is_not_called_in_time(ball, files):
    way = ball[1]
    field, options = NativeField(files["sphere"]), task(devices=[])
    beside = way + 10 * np.abs(way).max()
    found = time_proxy(field, Feel(), PLAIN, path=beside, options=options)
    assert (found.touching_share, found.in_time) == (0.0, False)
    assert "touched nothing" in paragraph(SOUND, {}, options, proxy=found)


def test_without_the_file_that_knows_its_materials_a_proxy_is_refused(ball, files, tmp_path):
    """Felt again on a device, it would rub everywhere as its first material does."""
    way = ball[1]
    field, options = NativeField(files["sphere"]), task(devices=[])
    rubber, steel = {"sticking": 0.9, "sliding": 0.7}, {"sticking": 0.1, "sliding": 0.1}
    made = Surfaces({"the surface": rubber}, {})
    one = time_proxy(field, Feel(), made, path=way, options=options)
    (same,) = felt_again(field, one, SIZE, folder=tmp_path).materials
    assert (same.sticking, same.sliding) == (0.9, 0.7)
    two = one.model_copy(update={"materials": {"rubber": rubber, "steel": steel}})
    with pytest.raises(PandisError, match="the materials rubber, steel, and no file here"):
        felt_again(field, two, SIZE, folder=tmp_path)


def test_what_is_sent_is_what_was_found_safe_for_the_proxy(libraries, files, monkeypatch, ball):
    """Led from outside deep into the ball: the force is the spring's, at that stiffness."""
    radius = 0.05
    monkeypatch.setenv("PANDIS_PLACE", f"{1.1 * radius} 0 0")
    monkeypatch.setenv("PANDIS_STANDIN", f"300 6 {0.7 * radius}")
    monkeypatch.setenv("PANDIS_ARM", "1")
    scenes = []

    def order(scene, *given, **named):
        scenes.append(scene)
        return Order(scene, *given, gap=100.0, patience=100.0, **named)

    monkeypatch.setattr("pandis.pipeline.judge.servo.attached.Order", order)
    options = AttachedOptions(library=str(libraries[1]), arm=True)
    safe = changed(PRESSED, hands={"0.3": 100.0})
    field = NativeField(files["sphere"])
    known = {"span": Span(0.8, 10), "safety": Safety(safe, WHOLE)}
    feel = Feel(materials=(Material(0.2, 0.2),))
    arrays, found = run_attached(field, SCALE, options, **known, feel=feel)
    assert (found.contact, found.stiffness) == ("proxy", pytest.approx(70.0))
    depth = np.maximum(radius - np.linalg.norm(arrays["position"], axis=1), 0)
    strength = np.linalg.norm(arrays["force"], axis=1)
    assert strength.max() > 0.1  # it is touched while the force comes in, which waits
    assert (strength <= 70.0 * depth + 0.05).all()
    assert run_attached(field, SCALE, options, **known)[1].contact == "penalty"
    assert [isinstance(scene, TouchedScene) for scene in scenes] == [True, False]


@pytest.mark.slow
def test_a_whole_validation_arms_with_the_proxys_own_figure(libraries, files, ball):
    truth, way = ball
    field, options = (
        NativeField(files["sphere"]),
        task(devices=[], seconds=0.05, attached={"library": str(libraries[0])}),
    )
    feel = Feel()
    verdict = time_proxy(field, feel, PLAIN, path=way, options=options)
    assert verdict.devices == {}
    felt = _Felt(feel, verdict, truth)
    _, found = _attached(field, truth.surface, SOUND, devices={}, options=options, felt=felt)
    own = touch_device("touch", field, feel, truth=truth, options=options)
    assert found.contact == "proxy"
    assert found.stiffness == pytest.approx(min(400.0, 0.7 * own.hands["0.3"]))
    slow = changed(verdict, in_time=False, miss_share=0.5)
    assert "A proxy does not hold the rate" in paragraph(SOUND, {}, options, proxy=slow)
    _, refused = _attached(
        field, truth.surface, SOUND, devices={}, options=options, felt=felt._replace(verdict=slow)
    )
    assert refused.armed is False
