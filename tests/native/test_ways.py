"""2,000 ways of pressing, sliding and leading away: none is left behind, deep, or kicks."""

import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

from bodies import UNIT, field_of

from oracle import Solid
from pandis.base.frame import Frame
from pandis.pipeline.geometry.body import Body
from pandis.runtime.contact import NativeContact
from pandis.runtime.scene import Placed
from ways import SHAPES, draw, judge

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
    assert seen["left"] == 0, worst
    assert seen["passes"] == seen["bounds"] == 0
    assert seen["late"] <= COUNT / 10


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
