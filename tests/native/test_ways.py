"""2,000 ways of pressing, sliding and leading away: none is left behind, deep, or kicks."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from oracle import Solid
from pandis.export.native import native_bytes
from pandis.fields.exact import ExactField
from pandis.geometry.body import Body
from pandis.geometry.frame import Frame
from pandis.grids.compact import file_parts, pack_body
from pandis.native.runtime import COMPACT, NativeField
from pandis.native.runtime.files import pack
from ways import SHAPES, draw, judge

UNIT = Frame((0.0, 0.0, 0.0), 1.0)


@pytest.mark.parametrize("kind", ["exact", "compact"])
@pytest.mark.parametrize("name", SHAPES)
def test_a_proxy_always_comes_along(name, kind):
    """In sharp corners some of a compact field's faces are folded by its lattice."""
    rng = np.random.default_rng(5)
    mesh, places = SHAPES[name](rng)
    turn = Rotation.random(random_state=5).as_matrix()
    vertices = mesh.vertices @ turn.T
    frame = Frame.of_bounds(vertices.min(0), vertices.max(0))
    vertices, faces = frame.to_unit(vertices), np.asarray(mesh.faces, np.int32)
    body, solid = Body(vertices, faces, UNIT), Solid(vertices, faces)
    if kind == "exact":
        field = NativeField(native_bytes(ExactField("exact", body), "exact", {}))
    else:
        field = NativeField(pack(COMPACT, UNIT, *file_parts(*pack_body(body, 16)), {}, 3))
    ways = draw(solid, (places, turn, frame), 100, rng)
    seen, worst = judge(field, kind, solid, ways, 5.0)
    assert seen["left"] == 0, worst
    assert seen["passes"] == seen["bounds"] == 0
    assert seen["late"] <= 10
