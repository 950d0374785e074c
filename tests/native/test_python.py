"""A field as an object of Python: closed, copied, pickled, shown, and asked what it refuses."""

import copy
import pickle

import numpy as np
import pytest

import pandis
from pandis.base.errors import ArtifactError
from pandis.base.frame import Frame
from pandis.pipeline.kinds.field import INVALID
from pandis.runtime.field import NativeField
from pandis.runtime.scene import NativeScene, Placed

POINTS = np.random.default_rng(0).uniform(-0.5, 0.5, (50, 3))


def test_it_is_closed_at_the_end_of_its_block(files):
    with pandis.load(files["exact"]) as field:
        assert np.isfinite(field.query(POINTS).distance).all()
        assert repr(field).startswith(f"<NativeField {files['exact']}: mesh, ")
    for ask in (field.query, field.force, field.gradient, field.faces):
        with pytest.raises(ValueError, match="has been closed"):
            ask(POINTS)
    assert repr(field).endswith("closed>")
    field.close()


def test_what_reads_its_bytes_is_closed_with_it(files):
    """They read a file that is no longer mapped, else: the process would crash."""
    field = NativeField(files["exact"])
    placed, moving = field.placed(Frame((1.0, 2.0, 3.0), 2.0)), field.moving()
    again = placed.placed(field.frame)
    scene = NativeScene([Placed(field, np.eye(3), np.zeros(3), 1.0, 1.0)])
    field.close()
    for other in (placed, moving, again):
        with pytest.raises(ValueError, match="has been closed"):
            other.query(POINTS)
    answers = scene.answer(POINTS)
    assert not answers.force.any()
    assert (answers.flag[answers.queries > 0] == INVALID).all()


def test_another_field_of_the_file_lives_on(files):
    one, other = NativeField(files["spline"]), NativeField(files["spline"])
    wanted = other.query(POINTS)
    one.close()
    assert np.array_equal(other.query(POINTS).distance, wanted.distance)


def test_a_copy_answers_when_the_original_is_gone(files):
    """It shared the original's memory, and answered NaN."""
    field = NativeField(files["exact"])
    wanted = field.query(POINTS).distance
    copies = [copy.copy(field), copy.deepcopy(field), pickle.loads(pickle.dumps(field))]
    del field
    for one in copies:
        assert np.array_equal(one.query(POINTS).distance, wanted)


def test_a_pickle_of_bytes_holds_them(files):
    field = NativeField(files["spline"].read_bytes())
    again = pickle.loads(pickle.dumps(field))
    assert np.array_equal(again.query(POINTS).distance, field.query(POINTS).distance)


def test_a_pickle_of_a_file_that_has_changed_is_refused(files, tmp_path):
    path = tmp_path / "field.pandis"
    path.write_bytes(files["spline"].read_bytes())
    kept = pickle.dumps(NativeField(path))
    path.write_bytes(files["exact"].read_bytes())
    with pytest.raises(ArtifactError, match="has changed"):
        pickle.loads(kept)
    path.unlink()
    with pytest.raises(ArtifactError, match="is gone"):
        pickle.loads(kept)


def test_what_was_made_of_a_field_is_neither_pickled_nor_copied_in_part(files):
    field = NativeField(files["exact"])
    moving = field.moving()
    for refused in (copy.copy, copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError):
            refused(moving)
    with pytest.raises(TypeError, match="pickle the field"):
        pickle.dumps(field.placed(field.frame))


@pytest.mark.parametrize("k", [-1.0, np.nan, np.inf, -np.inf])
def test_a_stiffness_that_is_none_is_refused(files, k):
    with pytest.raises(ValueError, match="finite and not negative"):
        NativeField(files["exact"]).force(POINTS, k=k)


def test_complex_points_are_refused(files):
    with pytest.raises(ValueError, match="real"):
        NativeField(files["exact"]).query(POINTS * 1j)
