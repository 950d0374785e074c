"""Closed forms: distances by formula, and tessellations that are valid meshes."""

import numpy as np
import pytest

from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.mesh.diagnosis import diagnose


@pytest.mark.parametrize("name", SHAPES)
def test_tessellation_is_valid_and_on_the_shape(name):
    shape = SHAPES[name]
    vertices, faces = shape.tessellation()
    found = diagnose(vertices, np.asarray(faces, np.int64))
    assert found.valid
    assert found.self_intersections == 0
    assert np.abs(shape.distance_and_normal(vertices)[0]).max() < 1e-14
    assert np.abs(np.abs(vertices).max(axis=0) - shape.half_extent).max() < 1e-14


@pytest.mark.parametrize("name", SHAPES)
def test_closed_form_is_a_distance(name):
    shape = SHAPES[name]
    points = np.random.default_rng(0).uniform(-2, 2, (4000, 3))
    distance, normal = shape.distance_and_normal(points)
    assert np.abs(np.linalg.norm(normal, axis=1) - 1).max() < 1e-12
    foot = points - distance[:, None] * normal
    assert np.abs(shape.distance_and_normal(foot)[0]).max() < 1e-12
    step = 1e-6
    gradient = np.stack(
        [
            (shape.distance_and_normal(points + step * e)[0]
             - shape.distance_and_normal(points - step * e)[0]) / (2 * step)
            for e in np.eye(3)
        ],
        axis=1,
    )  # fmt: skip
    smooth = np.linalg.norm(gradient - normal, axis=1) < 1e-4
    assert smooth.mean() > 0.999  # all but points next to the medial axis


def test_closed_form_at_its_centre_is_finite():
    for shape in SHAPES.values():
        distance, normal = shape.distance_and_normal(np.zeros((1, 3)))
        assert np.isfinite(distance).all()
        assert np.linalg.norm(normal) == pytest.approx(1)
