"""The paper's other methods, on its sphere: section 3.4 and Table 5."""

from functools import cache

import numpy as np
import pytest

from pandis.base.errors import PandisError
from pandis.base.forces import penalty_force
from pandis.base.frame import UNIT, Frame
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.distance import MeshDistance
from pandis.pipeline.geometry.sampling import Surface
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.geometry.trajectories import trace
from pandis.pipeline.kinds.field import BOUND
from pandis.pipeline.kinds.grid.dense import DenseGrid
from pandis.pipeline.kinds.grid.spec import CONTENTS
from pandis.pipeline.kinds.opening import open_field
from pandis.pipeline.kinds.paper.maps import build_planes
from pandis.pipeline.kinds.paper.proxy import ProxyField
from pandis.pipeline.kinds.paper.spec import PLANES
from pandis.pipeline.run.ask.catalogue import parse_field
from pandis.pipeline.run.ask.options import TrajectoryOptions
from pandis.pipeline.run.job.stage import silent_progress
from support import artifact, box_mesh

FRAME = Frame((0.0, 0.0, 0.0), 0.9)
AT = FRAME.attributes()
BODY = Body(*SHAPES["sphere"].tessellation(), FRAME, shape="sphere")
ENGINE = BODY.distance
#: Mean error as a share of the mean force: what correct code gives, computed apart from this
#: code with NumPy scripts, for a spiral of 2,000 samples 2 to 5 % deep and 100³ nodes.
EXPECTED = {
    "nearest-100": 0.15,
    "trilinear-100": 0.0025,
    "salisbury": 0.015,
    "kim-100": 0.0024,
    "kim-ray-100": 0.0023,
    "kim-cell-100": 0.33,
    "kim-algebraic-100": 0.95,
    "support-planes-only": 0.073,
    "support-planes-distance": 0.054,
    "support-planes": 0.0027,
}


@cache
def held(name):
    """The artifact that a field of the sphere is opened from."""
    spec = parse_field(name, ())
    spec = spec.through or spec
    vertices, faces = SHAPES["sphere"].tessellation()
    if spec.artifact == "mesh":
        return artifact("mesh", {"vertices": vertices, "faces": faces}, AT | {"shape": "sphere"})
    if spec.form in PLANES:
        return artifact(
            "planes", build_planes(FRAME.to_unit(vertices), ENGINE, silent_progress), AT
        )
    grid = DenseGrid(
        ENGINE, CONTENTS[spec.form], spec.size, band=(0.06, 0.02), progress=silent_progress
    )
    values = {"values": np.concatenate(list(grid.slabs(32)))}
    return artifact("grid", values, grid.attributes() | AT)


def opened(name):
    spec = parse_field(name, ())
    key = name if spec.form not in PLANES else "support-planes"
    return open_field(spec, held(key))


def spiral(samples=2000):
    options = TrajectoryOptions(kind="spiral", samples=samples)
    path, _ = trace(BODY, options, 0, progress=silent_progress)
    return path["points"], penalty_force(path["distance"], path["normal"])


def share(field, points, exact):
    """Mean error of the force as a share of the mean force."""
    off = penalty_force(*field.answer(points)) - exact
    return np.linalg.norm(off, axis=1).mean() / np.linalg.norm(exact, axis=1).mean()


@pytest.mark.parametrize("name", EXPECTED)
def test_table_5_is_what_correct_code_gives(name):
    assert share(opened(name), *spiral()) == pytest.approx(EXPECTED[name], rel=0.2)


def test_spiral_is_as_deep_as_it_should_be():
    points, exact = spiral()
    depth = np.linalg.norm(exact, axis=1) / 0.9
    assert depth.min() == pytest.approx(0.02, abs=1e-4)
    assert depth.max() == pytest.approx(0.05, abs=1e-4)
    around = np.unwrap(np.arctan2(points[1:-1, 1], points[1:-1, 0]))
    assert np.ptp(around) / (2 * np.pi) == pytest.approx(6, abs=0.01)


def test_spiral_is_for_spheres():
    torus = Body(*SHAPES["torus"].tessellation(), FRAME, shape="torus")
    with pytest.raises(PandisError, match=r"trajectory\.kind: a spiral is for analytic:sphere"):
        trace(torus, TrajectoryOptions(kind="spiral"), 0, progress=silent_progress)


# --- [22] ---------------------------------------------------------------------------------


def test_the_contact_point_lags_by_the_angle_between_samples():
    """In steady sliding the relative error is about the angular step."""
    coarse, fine = (share(opened("salisbury"), *spiral(n)) for n in (400, 2000))
    assert coarse / fine == pytest.approx(5, rel=0.2)


def test_the_contact_point_depends_on_the_way_and_forgets_it_outside():
    field = opened("salisbury")
    z = np.array([0.0, 0, 1])
    deep = np.array([[0.0, 0, 0.85], [0.0, 0.1, 0.85], [0.0, 0.2, 0.82]])
    slid = field.answer(deep)
    alone = field.answer(deep[-1:])
    assert abs(slid[0][-1] - alone[0][0]) > 1e-4  # it lags
    left = field.answer(np.concatenate([deep, [z * 1.2], deep[-1:]]))
    assert left[0][3] == pytest.approx(0.3)
    assert left[0][4] == pytest.approx(alone[0][0], abs=1e-12)
    assert field.ordered


def test_a_contact_point_is_held_on_its_side_of_a_thin_plate():
    """Where the penalty force turns around in the middle of the plate."""
    frame = UNIT
    vertices, faces = box_mesh()
    plate = MeshDistance(vertices * [0.9, 0.9, 0.02] / np.abs(vertices).max(0), faces)

    class Exact:
        bytes, ordered = 0, False

        def answer(self, points):
            return plate.distance_and_normal(points)

    exact = Exact()
    exact.frame = frame
    path = np.array([0.1, 0.05, 1.0]) * np.linspace(0.03, -0.015, 60)[:, None] ** [0, 0, 1]
    force = penalty_force(*ProxyField("p", exact).answer(path))
    flipped = penalty_force(*exact.answer(path))
    assert flipped[-1, 2] < 0
    assert force[-1, 2] == pytest.approx(0.035, abs=1e-6)
    assert (np.diff(force[:, 2]) >= -1e-9).all()


@pytest.mark.slow
def test_contact_points_need_a_field_that_knows_the_outside():
    with pytest.raises(ValueError, match="trilinear-64 has no distances outside"):
        parse_field("salisbury-trilinear-64", ())
    with pytest.raises(ValueError, match="on a field, not on another"):
        parse_field("salisbury-salisbury", ())
    assert parse_field("salisbury-tricubic-64", ()).artifact == "grid-distance-64"
    assert share(opened("salisbury-tricubic-100"), *spiral()) == pytest.approx(0.015, rel=0.2)


# --- [10], [16] ----------------------------------------------------------------------------


def test_kims_potential_is_refused_where_it_is_none():
    mesh = artifact("mesh", {}, AT | {"shape": "torus"})
    with pytest.raises(PandisError, match="only a sphere has this potential"):
        open_field(parse_field("kim-algebraic-20", ()), mesh)


@pytest.mark.full
def test_planes_touch_a_box_and_maps_hold_the_depth_below_them():
    vertices, faces = box_mesh()
    vertices = vertices * 0.9 / np.abs(vertices).max()
    engine = MeshDistance(vertices, faces)
    arrays = build_planes(vertices, engine, silent_progress)
    directions = arrays["normals"]
    assert directions.shape == (642, 3)
    assert np.abs(np.linalg.norm(directions, axis=1) - 1).max() < 1e-6
    cosine = directions @ directions.T - 2 * np.eye(642)
    assert 6 < np.degrees(np.arccos(cosine.max())) < 9
    above = directions @ vertices.T - arrays["offsets"][:, None]
    assert np.abs(above.max(axis=1)).max() < 1e-6
    field = open_field(parse_field("support-planes", ()), artifact("planes", arrays, AT))
    # a convex body: next to the middle of a face the nearest plane is that of the face
    points, normals, _, _ = Surface(vertices, faces).draw(4000, np.random.default_rng(0))
    flat = (np.abs(points) < 0.8 * np.abs(vertices).max(axis=0)).sum(axis=1) == 2
    inner = points[flat] - 0.01 * normals[flat]
    distance, normal = field.answer(inner)
    assert np.median(np.abs(distance + 0.01)) < 1e-3
    assert np.median(np.linalg.norm(normal - normals[flat], axis=1)) < 0.05


@pytest.mark.parametrize("name", EXPECTED)
def test_bad_points_get_no_answer_and_far_ones_no_contact(name):
    points = np.array([[np.nan, 0, 0], [5.0, 5, 5], [0, 0, 0.88]])
    distance, normal = opened(name).answer(points)
    assert np.isnan(distance[0])
    assert np.isnan(normal[0]).all()
    assert penalty_force(distance[1:], normal[1:])[0].max() == 0
    assert np.allclose(np.linalg.norm(normal[1:], axis=1), 1)


@pytest.mark.parametrize("name", ["support-planes-only", "support-planes-distance"])
def test_planes_answer_far_away_and_at_what_is_no_point(name):
    field = opened(name)
    far = np.array([[1e300, 0, 0], [0, -np.inf, 0], [5.0, 5.0, 5.0]])
    answer = field.query(far)
    assert (answer.distance > 1).all()
    assert (answer.flag == BOUND).all()
    assert np.isnan(field.answer(np.array([[np.nan, 0, 0]]))[0]).all()
