"""2,000 ways of pressing, sliding and leading away: none is left behind, deep, or kicks."""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

from bodies import UNIT, field_of

from oracle import Solid
from pandis.geometry.body import Body
from pandis.geometry.frame import Frame
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
COUNT = 60


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
