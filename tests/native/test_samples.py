"""Closed forms as fields: those that the workflow exports, of any size."""

import numpy as np
import pytest
from test_header import points_for

import pandis
from pandis.__main__ import main
from pandis.base.errors import PandisError
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.runtime.contact import NativeContact
from pandis.runtime.field import NativeField
from pandis.runtime.samples import SIZES, sample_bytes
from pandis.runtime.scene import NativeScene, Placed


@pytest.mark.parametrize("name", SHAPES)
def test_a_sample_answers_as_what_the_workflow_exports(files, name):
    """To the last bit, and in the same frame."""
    made, exported = pandis.sample(name), NativeField(files[name])
    points = points_for(made)
    assert made.frame == exported.frame
    for one, other in zip(made.query(points), exported.query(points), strict=True):
        assert np.array_equal(one, other)
    assert set(SIZES) == set(SHAPES)


@pytest.mark.parametrize("name", SHAPES)
def test_a_size_is_a_size(name):
    """Ten times as large: ten times as far, from the same places of the frame."""
    small, large = pandis.sample(name), pandis.sample(name, *(10 * size for size in SIZES[name]))
    points = points_for(small)
    near, far = small.query(points), large.query(10 * points)
    assert far.distance == pytest.approx(10 * near.distance, rel=1e-12, abs=1e-12)
    assert np.allclose(far.normal, near.normal, atol=1e-9)


def test_a_sample_has_a_proxy_and_a_scene():
    """It says where its surface lies, and that its distances are exact."""
    field = pandis.sample("box", 0.05, 0.05, 0.01)
    contact = NativeContact(Placed.at(field, 0.1, 400.0))
    way = np.linspace([0, 0, 0.02], [0, 0, 0.008], 50)
    touches = contact.follow(way)
    assert touches.force[-1] == pytest.approx([0, 0, 400 * 0.002])
    # a scene does not query an object whose box is far away
    away = NativeScene([Placed.at(field, 0.1, 400.0)]).answer(
        np.array([[0.0, 0, 0.2], [0.2, 0, 0]])
    )
    assert not away.queries.any()


@pytest.mark.parametrize(
    ("given", "why"),
    [
        (("cube",), "choose one of sphere, torus, box, capsule"),
        (("torus", 1.0), "2 finite sizes above zero"),
        (("sphere", -1.0), "a finite size above zero"),
        (("sphere", np.inf), "a finite size above zero"),
    ],
)
def test_what_is_no_shape_is_refused(given, why):
    with pytest.raises(PandisError, match=why):
        sample_bytes(*given)


def test_the_command_writes_a_file(tmp_path, capsys):
    path = tmp_path / "torus.pandis"
    assert main(["sample", "torus", str(path), "3", "1"]) == 0
    assert pandis.load(path).query([[3.0, 0, 0]]).distance == pytest.approx(-1.0)
    assert main(["sample", "torus", str(path), "3"]) == 3
    assert "2 finite sizes above zero" in capsys.readouterr().err
    assert path.stat().st_size < 1000


def test_commands_replace_a_file_only_with_force(tmp_path, capsys):
    path = tmp_path / "kept.pandis"
    assert main(["sample", "sphere", str(path)]) == 0
    before = path.read_bytes()
    assert main(["sample", "box", str(path)]) == 3
    assert "kept.pandis exists; --force" in capsys.readouterr().err
    for ending, command in ((".vdb", ["volume", str(path)]), (".html", ["view", str(path)])):
        output = tmp_path / f"kept{ending}"
        output.write_text("mine")
        words = ["--output", str(output)] if command[0] == "view" else [str(output)]
        assert main([*command, *words]) == 3
        assert output.read_text() == "mine"
    assert path.read_bytes() == before
    assert main(["sample", "box", str(path), "--force"]) == 0
    assert path.read_bytes() != before
    assert main(["view", str(path), "--output", str(tmp_path / "part.stl")]) == 3
