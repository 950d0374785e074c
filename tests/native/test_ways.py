"""2,000 ways of pressing, sliding and leading away: none is left behind, deep, or kicks."""

import sys
from dataclasses import replace
from functools import cache
from itertools import islice
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

from bodies import UNIT, field_of
from leaving import meshes

from oracle import Solid
from pandis.base.frame import Frame
from pandis.pipeline.geometry.body import Body
from pandis.runtime.contact import NativeContact
from pandis.runtime.scene import Placed
from ways import MM, SHAPES, draw, is_free, judge

#: Takes long: `make test-slow`.
pytestmark = pytest.mark.slow

#: Shapes in which approximate fields are rounded.
HOLLOWS = ("corner of 3", "corner of 5", "corner of 8", "groove", "slit")
#: Kinds of field, the largest radius of a probe (mm of 100), and of how many shapes.
KINDS = {
    "exact": (5.0, SHAPES),
    "compact-16": (5.0, SHAPES),
    "tricubic-96": (1.0, HOLLOWS),
    "trilinear-normal-96": (1.0, HOLLOWS),
    "spline-100K": (1.0, ("corner of 3", "groove")),
    "network-100": (5.0, ("slit",)),
}
COUNT = 61


@pytest.mark.parametrize(
    ("kind", "name"), [(k, n) for k, (_, named) in KINDS.items() for n in named]
)
def test_a_proxy_always_comes_along(kind, name):
    """In corners and slits a compact field folds faces; approximate ones are rounded there."""
    rng = np.random.default_rng(5)
    mesh, places = SHAPES[name](rng)
    turn = Rotation.random(random_state=5).as_matrix()
    vertices = mesh.vertices @ turn.T
    frame = Frame.of_bounds(vertices.min(0), vertices.max(0))
    vertices, faces = frame.to_unit(vertices), np.asarray(mesh.faces, np.int32)
    body, solid = Body(vertices, faces, UNIT), Solid(vertices, faces)
    field = field_of(body, kind)
    ways = draw(solid, (places, turn, frame), COUNT, rng)
    seen, worst = judge(field, kind, solid, ways, KINDS[kind][0])
    assert seen["held"] == seen["left"] == seen["late"] == 0, worst
    assert seen["passes"] == seen["bounds"] == 0
    assert seen["slow"] <= COUNT / 10


def test_a_proxy_that_stays_on_a_free_way_is_seen():
    """A proxy that is held in free air counts, however few looks it has; one at a wall does not."""
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    solid = Solid(np.array(box.vertices), np.asarray(box.faces, np.int32))
    on_top = np.array([0.1, 0.1, 0.5])
    away = SimpleNamespace(proxies=[on_top[None]], probe=on_top + (0.2, 0, 0.1), radius=0.0)
    assert is_free(solid.distance, away)
    assert is_free(solid.distance, replaced(away, probe=on_top + (0.2, 0, 0)))
    assert not is_free(solid.distance, replaced(away, probe=on_top + (0.2, 0, -0.01)))
    assert not is_free(solid.distance, replaced(away, probe=np.array([0.7, 0.1, 0.3])))
    assert not is_free(solid.distance, replaced(away, radius=0.01, probe=on_top - (0, 0, 0.01)))


def replaced(one, **values):
    """Return a copy of a namespace with other values."""
    return SimpleNamespace(**(vars(one) | values))


@pytest.mark.parametrize("kind", ["exact", "compact-16"])
def test_large_balls_leave_the_creases_of_their_own_offset_surface(kind):
    """Free balls were looked for so near the proxy that none joined the one it stood on."""
    rng = np.random.default_rng(5)
    mesh, _ = SHAPES["waves"](rng)
    frame = Frame.of_bounds(*mesh.bounds)
    vertices, faces = frame.to_unit(mesh.vertices), np.asarray(mesh.faces, np.int32)
    body, solid = Body(vertices, faces, UNIT), Solid(vertices, faces)
    ways = []
    for drawn in draw(solid, None, 600, rng):
        way = replace(drawn, radius=rng.uniform(0.3, 1), moving=False)
        begin = MM * way.path(5 * way.radius)[:1]
        if solid.distance(begin)[0] > 5 * way.radius * MM:
            ways.append(way)
    seen, worst = judge(field_of(body, kind), kind, solid, ways, 5.0)
    assert seen["left"] == seen["late"] == seen["passes"] == seen["bounds"] == 0, worst


def test_a_corner_of_trilinear_cells_lets_nothing_through():
    """A ball that was halved, because less was free than it said, led proxies 0.15 mm in."""
    name, vertices, faces, where = next(islice(meshes(np.random.default_rng(2), 5), 4, None))
    assert name == "corner of 3"
    body, solid = Body(vertices, faces.astype(np.int32), UNIT), Solid(vertices, faces)
    kind = "trilinear-normal-96"
    ways = draw(solid, where, 300, np.random.default_rng(7))
    assert judge(field_of(body, kind), kind, solid, ways, 1.0)[0]["passes"] == 0


@cache
def block(kind):
    """Return a block of 1.8 x 1.2 x 1.0, placed in its unit frame."""
    mesh = trimesh.creation.box((1.8, 1.2, 1.0))
    body = Body(np.array(mesh.vertices), np.asarray(mesh.faces, np.int32), UNIT)
    return Placed(field_of(body, kind), np.eye(3), np.zeros(3), 1.0, 400.0)


@pytest.mark.parametrize("kind", ["trilinear-normal-96", "tricubic-96", "spline-100K"])
def test_a_probe_that_leaves_a_surface_at_a_grazing_angle_is_followed(kind):
    """It was so close to it that each ball of free air was hardly larger than the last one."""
    placed = block(kind)
    for slope in (0.1, 0.01, 1e-3):
        for height in (0, 1e-9, 1e-6):
            start = np.array([0.1, 0.1, 0.4])
            for _ in range(8):  # onto the field's own surface
                distance, normal = placed.field.distance_and_normal(start)
                start = start - distance * normal
            start = start + height * normal
            end = start + 0.3 * np.array([1, 0, slope])
            contact = NativeContact(placed)
            contact.set(budget=8)
            rest = 0.05 + 0.3 / contact.options.slide
            path = np.concatenate([start[None], np.repeat(end[None], int(1e3 * rest), 0)])
            steps = contact.follow(path)
            assert np.abs(steps.proxy[-1] - end).max() < 1e-9


@pytest.mark.parametrize("radius", [0.02, 0.07, 0.09])
def test_a_large_probe_beyond_the_box_of_a_network_is_followed(radius):
    """All that is known there is a bound; of a quarter of it a large ball would not move."""
    for start, end in ((1.04, 0.1, 0.1), (1.6, 0.1, 0.1)), ((1.02, 0, 0), (1.3, 0.2, 0.1)):
        contact = NativeContact(block("network-100"), radius)
        rest = 0.05 + np.linalg.norm(np.subtract(end, start)) / contact.options.slide
        steps = contact.follow(np.concatenate([[start], np.repeat([end], int(1e3 * rest), 0)]))
        assert np.abs(steps.proxy[-1] - end).max() < 1e-9


@pytest.mark.parametrize("kind", ["exact", "compact-16"])
@pytest.mark.parametrize("thick", [5e-5, 1e-4, 3e-4, 2e-3])
def test_nothing_walks_through_a_foil(kind, thick):
    """On less than a step of matter a place straight towards the probe is free: beyond it."""
    foil = trimesh.creation.box((1.2, 1.2, thick))
    turn = Rotation.random(random_state=5).as_matrix()
    body = Body(foil.vertices @ turn.T, np.asarray(foil.faces, np.int32), UNIT)
    placed = Placed(field_of(body, kind), np.eye(3), np.zeros(3), 1.0, 400.0)
    rng = np.random.default_rng(0)
    for radius in (0.0, thick):
        for _ in range(4):
            begin, pressed, aside = rng.uniform(-0.2, 0.2, (3, 3))
            begin[2], pressed[2], aside[2] = 0.05, -rng.uniform(1e-3, 0.1), -0.03
            there, back = np.linspace(begin, pressed, 40), np.linspace(pressed, aside, 40)
            rests = (np.repeat(place[None], 300, 0) for place in (pressed, aside))
            path = np.concatenate([there, next(rests), back, next(rests)])
            steps = NativeContact(placed, radius).follow(path @ turn.T)
            assert (steps.proxy @ turn)[:, 2].min() > thick / 2 + radius - 3e-5
            assert steps.force[-1].any()
