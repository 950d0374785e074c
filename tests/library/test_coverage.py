"""Thickness and curvature against shapes that have known ones, and paths that stay or roam."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pandis.base.frame import Frame
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.distance import MeshDistance, ShapeDistance
from pandis.pipeline.geometry.sampling import Surface
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.geometry.thickness import inscribed_radius
from pandis.pipeline.judge.errors.coverage import coverage, curvature
from support import box_mesh


def test_the_largest_ball_inside_a_plate_is_half_as_thick():
    vertices, faces = box_mesh()
    vertices = vertices / np.abs(vertices).max(axis=0) * [0.9, 0.9, 0.05]
    engine = MeshDistance(vertices, faces)
    points = np.array([[0.1, 0.2, 0.05], [0.88, 0.0, 0.05], [0.9, 0.0, 0.0]])
    normals = np.array([[0, 0, 1.0], [0, 0, 1], [1, 0, 0]])
    found = inscribed_radius(engine, points, normals)
    assert found == pytest.approx([0.05, 0.02, 0.05], abs=1e-5)


def test_curvature_of_a_sphere_is_its_inverse_radius():
    shape = SHAPES["sphere"]
    vertices, faces = shape.tessellation()
    frame = Frame.of_bounds(vertices.min(axis=0), vertices.max(axis=0))
    engine = ShapeDistance(shape, frame)
    surface = Surface(frame.to_unit(vertices), faces, engine)
    points, _, _, _ = surface.draw(4000, np.random.default_rng(0))
    normals = engine.distance_and_normal(points)[1]
    found = curvature(cKDTree(points), points, normals)
    assert np.median(found) == pytest.approx(1 / 0.9, rel=0.02)


def test_a_path_that_stays_in_one_place_covers_less_than_one_that_roams():
    vertices, faces = SHAPES["torus"].tessellation(200, 100)
    body = Body(vertices, faces)
    everywhere = body.surface.draw(2000, np.random.default_rng(1))[0][None]
    still = np.repeat(everywhere[:, :1], 2000, axis=1)
    assert coverage(body, still, 0)["curvature"] == 1
    roaming = coverage(body, everywhere, 0)
    assert (roaming["curvature"], roaming["thickness"]) == (10, 10)
    assert sum(roaming["share_thickness"]) == pytest.approx(1)
