"""pandis-touch: a field on a device without the workflow, armed only with what is known of it."""

import json

import numpy as np
import pytest

from pandis.pipeline.judge.servo import touch
from pandis.runtime.contact import Feel, Material
from pandis.runtime.device import DONE
from pandis.runtime.field import NativeField
from verdicts import PRESSED, SOUND, changed, validated


@pytest.fixture
def exported(files, tmp_path):
    """An exported sphere beside a report that has found 200 N/m safe for a light hand."""
    folder = tmp_path / "export"
    folder.mkdir()
    path = folder / "exact.pandis"
    path.write_bytes(files["sphere"].read_bytes())
    pressed = changed(PRESSED, hands={"0.3": 200.0})
    field = changed(SOUND, sha256=touch.digest(path), devices={"touch": pressed})
    report = validated({"exact": field}).attributes()
    (tmp_path / "hardware.json").write_text(json.dumps(report))
    return path


def test_a_simulated_device_feels_the_sphere(exported, capsys):
    assert touch.main([str(exported), "--simulated", "--seconds", "1.5"]) == 0
    said = capsys.readouterr().out
    assert "A simulated device ran, and no other" in said
    assert "at 140 N/m" in said  # 0.7 of what is safe for a light hand


def test_the_simulated_device_is_led_into_the_object(exported):
    session = touch.touch_simulated(
        NativeField(exported), "touch", 0.1, stiffness=140.0, seconds=1.5
    )
    assert session.strongest > 0.5
    assert np.linalg.norm(session.position, axis=1).min() < 0.045


def test_with_a_proxy_the_force_points_back_to_where_the_probe_came_from(exported, files, capsys):
    material = Material(0.3, 0.3, 0.0, 0.0)
    for _ in range(5):  # in real time: if other programs hold ticks up, the run may end early
        held = touch.touch_simulated(
            NativeField(exported),
            "touch",
            0.1,
            stiffness=400.0,
            seconds=1.5,
            feel=Feel(materials=(material,)),
        )
        if held.cause == DONE or held.since[1:].max() < 2e-3:  # a failure on time counts
            break
    assert np.linalg.norm(held.proxy, axis=1).min() > 0.05 - 1e-6
    # the hand is stronger than the device: it comes through, and the force still points back
    assert held.position[:, 1].min() < 0
    deep = held.position[:, 1] < 0
    assert held.force[deep, 1].min() > 0.8  # what the motors stand for long
    words = [str(exported), "--simulated", "--proxy", "--friction", "0.3", "--seconds", "1.2"]
    assert touch.main(words) == 0
    assert "A simulated device ran" in capsys.readouterr().out
    assert touch.main([str(files["trilinear"]), *words[1:]]) == 1
    assert "has no distances outside" in capsys.readouterr().err
    with pytest.raises(SystemExit):  # a device has the contact that was validated
        touch.main([str(exported), "--proxy", "--friction", "0.3"])


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda path: path.write_bytes(path.read_bytes()[:-1] + b"x"), "is for another file"),
        (lambda path: (path.parent.parent / "hardware.json").unlink(), "does not exist"),
        (lambda path: (path.parent.parent / "hardware.json").write_text("{}"), "of this version"),
    ],
)
def test_what_is_known_of_another_file_arms_nothing(damage, said, exported):
    assert touch.known(exported, "touch", 0.1).pressed.hands == {"0.3": 200.0}
    damage(exported)
    found = touch.known(exported, "touch", 0.1)
    assert (found.pressed, found.walls) == (None, None)
    assert said in found.why


def test_another_size_or_device_is_not_what_was_found_safe(exported):
    assert "longest side of 0.1 m" in touch.known(exported, "touch", 0.2).why
    report = json.loads((exported.parent.parent / "hardware.json").read_text())
    for changes in ({"agrees": False, "sentence": "Fail"}, {"in_time": False, "sentence": "Fail"}):
        field = {"exact": report["fields"]["exact"] | changes}
        told = json.dumps(report | {"fields": field})
        (exported.parent.parent / "hardware.json").write_text(told)
        assert touch.known(exported, "touch", 0.1).why.endswith("says: Fail")
    (exported.parent.parent / "hardware.json").write_text(json.dumps(report | {"rate": 10_000.0}))
    assert "is for 10000 Hz" in touch.known(exported, "touch", 0.1).why
    (exported.parent.parent / "hardware.json").write_text(json.dumps(report))
    assert "does not cover falcon" in touch.known(exported, "falcon", 0.1).why


def test_a_damaged_field_is_one_sentence(exported, capsys):
    exported.write_bytes(b"nothing")
    assert touch.main([str(exported), "--simulated"]) == 1
    assert capsys.readouterr().err.startswith("error: ")


def test_what_cannot_be_attached_is_refused_before_anything_opens(exported, capsys):
    with pytest.raises(SystemExit):
        touch.main([str(exported), "--model", "falcon"])
    assert "only touch and touch-x can be attached" in capsys.readouterr().err


def test_no_number_is_no_agreement(exported):
    assert "pass it as --size" in touch.known(exported, "touch", float("nan")).why
