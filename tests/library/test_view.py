"""The page's view of a mesh: what it is drawn from."""

import base64
import json

import numpy as np
import pytest

from pandis.base.frame import UNIT, Frame
from pandis.pipeline.geometry.distance import MeshDistance
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.judge.errors.view import DEPTHS, coarsen, surface_errors
from pandis.pipeline.kinds.field import Field
from pandis.pipeline.report.view import DECADES, view
from pandis.pipeline.run.job.stage import silent_progress


class Shallower(Field):
    """The exact field, its surface 0.01 deeper where x > 0."""

    def __init__(self, engine):
        super().__init__("shallower", UNIT, 0)
        self.engine = engine

    def answer(self, points):
        distance, normal = self.engine.distance_and_normal(points)
        return distance + np.where(points[:, 0] > 0, 0.01, 0.0), normal


@pytest.fixture(scope="module")
def torus():
    vertices, faces = SHAPES["torus"].tessellation(400, 100)
    frame = Frame.of_bounds(vertices.min(axis=0), vertices.max(axis=0))
    return frame.to_unit(vertices), faces


def test_a_large_mesh_is_coarsened_and_stays_closed(torus):
    coarse, faces = coarsen(*torus)
    assert 15_000 <= len(faces) <= 16_000
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    assert coarsen(coarse, faces)[1] is faces


def test_errors_stand_where_the_field_errs(torus):
    engine, (vertices, faces) = MeshDistance(*torus), torus
    found = surface_errors(
        [Shallower(engine)], engine, vertices, faces=faces, progress=silent_progress
    )
    vertices, error = found["view_vertices"], found["view_error_shallower"]
    assert np.abs(engine.distance_and_normal(vertices)[0]).max() < 1e-6
    # a wall that begins 0.01 deeper lacks 0.01 of force, and less where there is less
    wrong = np.mean(np.minimum(DEPTHS, 0.01))
    assert error[vertices[:, 0] > 0.05] == pytest.approx(wrong, rel=0.02)
    assert error[vertices[:, 0] < -0.05].max() < 1e-9


def test_the_page_gets_positions_and_shades_that_can_be_read_back():
    vertices = np.array([[-1, 0, 0.5], [0.25, 1, 0], [0, 0, 0.9]], np.float32)
    arrays = {
        "view_vertices": vertices,
        "view_faces": np.array([[0, 1, 2]], np.int32),
        "view_error_a": np.array([1e-3, 1e-2, 1e-6], np.float32),
        "paths": np.zeros((2, 5, 3), np.float32),
    }
    held = json.loads(view(arrays, 10.0, ["a", "b"], first="b"))
    whole = np.frombuffer(base64.b64decode(held["vertices"]), "<i2").reshape(-1, 3)
    assert np.abs(whole / 32767 - vertices).max() < 2e-5
    assert np.array_equal(np.frombuffer(base64.b64decode(held["faces"]), "<u2"), [0, 1, 2])
    assert len(held["paths"]) == 2
    assert held["first"] == "a"  # nothing is known of b
    assert (held["high"], held["low"]) == (2.0, 2.0 - DECADES)
    shades = np.frombuffer(base64.b64decode(held["errors"]["a"]), "u1")
    assert np.array_equal(shades, [round(255 * 2 / 3), 255, 0])
