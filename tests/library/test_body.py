"""A body: opened from an artifact or made from arrays, a mesh or a closed form."""

import numpy as np
import pytest

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.shapes import SHAPES
from support import artifact, box_mesh

VERTICES, FACES = box_mesh()
RNG = np.random.default_rng(2)


def torus():
    vertices, faces = SHAPES["torus"].tessellation()
    return Body(vertices, faces, shape="torus")


def answers(body, points):
    """Distance and normal at points, all in mesh units."""
    distance, normal = body.distance.distance_and_normal(body.frame.to_unit(points))
    return distance / body.frame.scale, normal


def test_a_body_opened_is_one_made_from_arrays():
    made = Body(VERTICES, FACES)
    attributes = {**made.frame.attributes(), "shape": None}
    opened = Body.open(artifact("mesh", {"vertices": VERTICES, "faces": FACES}, attributes))
    points = RNG.uniform(-1, 1, (200, 3))
    for one, other in zip(answers(made, points), answers(opened, points), strict=True):
        assert (one == other).all()
    assert (made.corners == opened.corners).all()
    assert np.abs(made.corners).max() == pytest.approx(0.9)


def test_a_closed_form_answers_by_its_formula_and_is_sampled_exactly():
    body, points = torus(), RNG.uniform(-1, 1, (200, 3))
    wanted = SHAPES["torus"].distance_and_normal(points)
    for one, other in zip(answers(body, points), wanted, strict=True):
        assert one == pytest.approx(other, abs=1e-12)
    drawn = body.surface.draw(500, RNG)[0]
    assert np.abs(body.distance.distance_and_normal(drawn)[0]).max() < 1e-12
    assert (body.bytes, body.size, body.can_be_scanned) == (0, 1, False)


def test_a_mesh_is_counted_and_can_be_scanned():
    body, points = Body(VERTICES, FACES), RNG.uniform(-1, 1, (50, 3))
    assert body.size == len(FACES)
    assert body.bytes > 80 * len(FACES)
    assert body.can_be_scanned
    for one, other in zip(body.scan(points), answers(body, points), strict=True):
        assert one == pytest.approx(other, abs=1e-12)


def test_elsewhere_and_in_other_units_it_answers_the_same():
    factor, offset = 1000.0, np.array([3.0, -20.0, 0.5])
    body, moved = Body(VERTICES, FACES), Body(factor * (VERTICES + offset), FACES)
    points = RNG.uniform(-1, 1, (300, 3))
    distance, normal = answers(body, points)
    there, turned = answers(moved, factor * (points + offset))
    assert there / factor == pytest.approx(distance, abs=1e-9)
    assert turned == pytest.approx(normal, abs=1e-6)
    assert moved.frame.scale == pytest.approx(body.frame.scale / factor)
