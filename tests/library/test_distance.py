"""The exact engine against closed forms, against all triangles one by one, and against libigl."""

import subprocess

import igl
import mpmath
import numpy as np
import pytest

from pandis.base.errors import PandisError
from pandis.base.frame import UNIT, Frame
from pandis.engine import compiler
from pandis.engine.bvh import INVALID, LEAF_BYTES, NODE_BYTES, ON_SURFACE, TIED, Bvh
from pandis.pipeline.geometry.distance import (
    SURFACE_DISTANCE,
    TIE_ANGLE,
    MeshDistance,
    ShapeDistance,
)
from pandis.pipeline.geometry.sampling import Surface
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.mesh.intake import read_mesh
from support import box_mesh, octahedron

REAL = (
    "watertight/fandisk_6475v_12946f.obj",
    "watertight/rockerarm_10044v_20088f.obj",
    "stanford/armadillo_49990v_99976f_ngp.obj",
)


def naive(vertices, faces, points):
    """Distance to all triangles, one by one (Ericson 2005, section 5.1.5), and closest points."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    n = np.cross(b - a, c - a)
    area = np.einsum("ij,ij->i", n, n)
    edges = [(p, q - p, np.einsum("ij,ij->i", q - p, q - p)) for p, q in ((a, b), (b, c), (c, a))]
    best, closest = np.empty(len(points)), np.empty((len(points), 3))
    for index, point in enumerate(points):
        ap = point - a
        s = np.einsum("ij,ij->i", np.cross(ap, c - a), n) / area
        t = np.einsum("ij,ij->i", np.cross(b - a, ap), n) / area
        height = np.einsum("ij,ij->i", ap, n) / area
        within = (s >= 0) & (t >= 0) & (s + t <= 1)
        feet = [np.where(within[:, None], point - height[:, None] * n, np.inf)]
        for start, side, length in edges:
            w = np.clip(np.einsum("ij,ij->i", point - start, side) / length, 0, 1)
            feet.append(start + w[:, None] * side)
        found = [np.linalg.norm(point - foot, axis=1) for foot in feet]
        kind = np.argmin([f.min() for f in found])
        best[index] = found[kind].min()
        closest[index] = feet[kind][found[kind].argmin()]
    return best, closest


def unit(path):
    """Read a real mesh into the unit frame."""
    vertices, faces = read_mesh(str(path), path)[0][:2]
    return Frame.of_bounds(vertices.min(0), vertices.max(0)).to_unit(vertices), faces


def near_and_far(vertices, faces, count, seed=0):
    """Return points near the surface, below it, and all over the box."""
    rng = np.random.default_rng(seed)
    points, normals, _, _ = Surface(vertices, faces).draw(count // 2, rng)
    points = points + rng.normal(0, 0.02, (len(points), 1)) * normals
    return np.concatenate([points, rng.uniform(-1, 1, (count - len(points), 3))])


def compare_with_naive(vertices, faces, points):
    engine = MeshDistance(vertices, faces)
    labels = engine.label(points)
    distance, closest = naive(engine.vertices, engine.faces, points)
    assert np.abs(np.abs(labels.distance) - distance).max() < 1e-12
    inside = igl.winding_number(engine.vertices, engine.faces.astype(np.int64), points) > 0.5
    assert np.array_equal(labels.distance < 0, inside)
    sign = np.where(inside, -1.0, 1.0)[:, None]
    wanted = sign * (points - closest) / distance[:, None]
    sure = ((labels.flags & TIED) == 0) & (distance > 1e-6)
    assert sure.mean() > 0.9
    assert np.linalg.norm(labels.normal - wanted, axis=1)[sure].max() < 1e-6
    corners = engine.vertices[engine.faces[labels.face]]
    feet = np.einsum("ij,ijk->ik", labels.barycentrics, corners)
    assert np.abs(np.linalg.norm(points - feet, axis=1) - distance).max() < 1e-12


def test_box_is_exact():
    vertices, faces = box_mesh()
    points = np.random.default_rng(0).uniform(-1.5, 1.5, (3000, 3))
    engine = MeshDistance(vertices, faces)
    labels = engine.label(points)
    exact, exact_normal = SHAPES["box"].distance_and_normal(points)
    assert np.abs(labels.distance - exact).max() < 1e-14
    free = (labels.flags & TIED) == 0
    assert free.mean() > 0.99
    assert np.abs(labels.normal - exact_normal)[free].max() < 1e-12


@pytest.mark.parametrize("shape", ["torus", "capsule", "sphere"])
def test_tessellations_agree_with_all_triangles(shape):
    vertices, faces = SHAPES[shape].tessellation()
    compare_with_naive(vertices, faces, near_and_far(vertices, faces, 300))


@pytest.mark.parametrize("path", [*REAL[:2], pytest.param(REAL[2], marks=pytest.mark.slow)])
def test_real_meshes_agree_with_all_triangles(path, meshes):
    vertices, faces = unit(meshes / path)
    compare_with_naive(vertices, faces, near_and_far(vertices, faces, 200))


@pytest.mark.full
@pytest.mark.parametrize("path", [*REAL[:2], "watertight/fertility_4494v_9000f.off"])
def test_real_meshes_agree_with_all_triangles_at_20_000_points(path, meshes):
    vertices, faces = unit(meshes / path)
    compare_with_naive(vertices, faces, near_and_far(vertices, faces, 20_000, seed=1))


@pytest.mark.parametrize("shape", SHAPES)
def test_closed_forms_agree_with_their_tessellations(shape):
    """Up to the sagitta of the tessellation, and in sign and direction off its facets."""
    form = SHAPES[shape]
    vertices, faces = form.tessellation()
    points = np.random.default_rng(3).uniform(-1.4, 1.4, (3000, 3))
    mesh, closed = MeshDistance(vertices, faces), ShapeDistance(form, UNIT)
    found, wanted = mesh.label(points), closed.label(points)
    assert np.abs(found.distance - wanted.distance).max() < 3e-3
    # the facets of a tessellated sphere tie around its centre: the closed form must say so there
    free = ((found.flags | wanted.flags) & TIED == 0) & (np.abs(wanted.distance) > 0.1)
    assert free.mean() > 0.5
    angle = np.einsum("ij,ij->i", found.normal, wanted.normal)[free]
    assert np.median(angle) > 0.9999


def test_distance_is_that_of_libigl():
    vertices, faces = SHAPES["torus"].tessellation()
    points = np.random.default_rng(1).uniform(-1.5, 1.5, (20_000, 3))
    distance, _ = MeshDistance(vertices, faces).distance_and_normal(points)
    squared, _, _ = igl.point_mesh_squared_distance(points, vertices, faces)
    assert np.abs(np.abs(distance) - np.sqrt(squared)).max() < 1e-15
    signed, _, _, _ = igl.signed_distance(
        points, vertices, faces, sign_type=igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL
    )
    assert np.array_equal(np.sign(signed), np.sign(distance))


def test_direction_on_the_surface_is_the_pseudonormal():
    vertices, faces = box_mesh()
    engine = MeshDistance(vertices, faces)
    corner, edge, flat = [1.0, 0.7, 0.5], [1.0, 0.7, 0.1], [1.0, 0.1, 0.07]
    labels = engine.label(np.array([corner, edge, flat]))
    assert (np.abs(labels.distance) <= SURFACE_DISTANCE).all()
    assert (labels.flags == ON_SURFACE).all()
    wanted = np.array([[1, 1, 1], [1, 1, 0], [1, 0, 0]], float)
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
    assert np.abs(labels.normal - wanted).max() < 1e-12


@pytest.mark.parametrize("gap", [1e-5, 1e-7, 3e-9])
def test_sign_is_right_down_to_the_surface(gap):
    vertices, faces = SHAPES["torus"].tessellation()
    engine = MeshDistance(vertices, faces)
    points, normals, _, _ = Surface(vertices, faces).draw(3000, np.random.default_rng(0))
    for side in (1, -1):
        distance, normal = engine.distance_and_normal(points + side * gap * normals)
        assert (np.sign(distance) == side).all()
        assert (np.einsum("ij,ij->i", normal, normals) > 0.99).all()


def test_a_thin_cone_has_the_right_sign_everywhere():
    """The normal of the closest face alone is wrong beside its tip (Bærentzen & Aanæs 2005)."""
    turn = 2 * np.pi * np.arange(12) / 12
    rim = np.stack([0.05 * np.cos(turn), 0.05 * np.sin(turn), np.full(12, -1.0)], axis=1)
    vertices = np.concatenate([rim, [[0, 0, 1.0]], [[0, 0, -1.0]]])
    k = np.arange(12)
    faces = np.concatenate(
        [
            np.stack([k, (k + 1) % 12, np.full(12, 12)], 1),
            np.stack([(k + 1) % 12, k, np.full(12, 13)], 1),
        ]
    )
    points = np.random.default_rng(0).uniform(-1, 1, (20_000, 3)) * [0.2, 0.2, 1.2]
    engine = MeshDistance(vertices, faces)
    distance, _ = engine.distance_and_normal(points, check=False)
    assert np.array_equal(distance < 0, igl.winding_number(vertices, faces, points) > 0.5)
    faces_alone = igl.per_face_normals(vertices, faces, np.zeros(3))
    labels = engine.label(points)
    offset = points - np.einsum("ij,ijk->ik", labels.barycentrics, vertices[faces[labels.face]])
    naive_sign = np.einsum("ij,ij->i", offset, faces_alone[labels.face]) < 0
    assert (naive_sign != (distance < 0)).any(), "the case is too easy to show anything"


# --- what answers may not depend on --------------------------------------------------


@pytest.mark.parametrize("threads", ["1", "2", "5"])
def test_answers_do_not_depend_on_batch_order_or_threads(monkeypatch, threads):
    vertices, faces = SHAPES["torus"].tessellation()
    points = np.random.default_rng(1).uniform(-1.5, 1.5, (6000, 3))
    whole = MeshDistance(vertices, faces).label(points)
    monkeypatch.setenv("IGL_NUM_THREADS", threads)
    engine = MeshDistance(vertices, faces)
    again = engine.label(points[::-1])
    assert all(np.array_equal(a, b[::-1]) for a, b in zip(whole, again, strict=True))
    few = [engine.label(points[i : i + 7]) for i in range(0, 700, 7)]
    parts = [np.concatenate(column) for column in zip(*few, strict=True)]
    assert all(np.array_equal(a[:700], b) for a, b in zip(whole, parts, strict=True))
    monkeypatch.setattr("pandis.pipeline.geometry.distance.CHUNK", 501)
    distance, normal = engine.distance_and_normal(points)
    assert np.array_equal(distance, whole.distance)
    assert np.array_equal(normal, whole.normal)


@pytest.mark.parametrize("count", [1, 8, 9, 64, 65, 700, 12_000])
def test_a_tree_has_the_same_bytes_on_however_many_threads(monkeypatch, count):
    """Threads build branches, which then come in the order in which a walk meets them."""
    vertices, faces = soup("lattice", count, np.random.default_rng(count))
    trees = []
    for threads, many in (("1", 10_000), ("2", 1), ("5", 1)):
        monkeypatch.setenv("IGL_NUM_THREADS", threads)
        monkeypatch.setattr("pandis.engine.bvh._MANY", many)
        trees.append(Bvh(vertices, faces))
    parts = [tree.parts() for tree in trees]
    assert parts[0] == parts[1] == parts[2]
    assert met_in_order(parts[0]["TREE"]) == (
        len(parts[0]["TREE"]) // NODE_BYTES,
        len(parts[0]["LEAF"]) // LEAF_BYTES,
    )
    points = np.random.default_rng(1).normal(0, 1, (100, 3))
    labels = trees[2].label(points, 0.0, check=False)
    assert np.array_equal(labels.distance, trees[2].scan(points)[0])


def met_in_order(tree):
    """Return how many nodes and leaves a walk through a tree's nodes meets, in their order."""
    places = [("low", "<f4", (3, 8)), ("high", "<f4", (3, 8)), ("child", "<i4", 8)]
    nodes, met, left = np.frombuffer(tree, np.dtype(places)), [0, 0], [0]
    assert nodes.itemsize == NODE_BYTES
    while left:
        child = left.pop()
        assert (child if child >= 0 else ~child) == met[child < 0]
        met[child < 0] += 1
        if child >= 0:
            node = nodes[child]
            left += node["child"][node["low"][0] <= node["high"][0]].tolist()[::-1]
    return tuple(met)


@pytest.mark.parametrize(("scale", "move"), [(1e-6, 0.0), (1e6, 0.0), (1.0, 1e6)])
def test_answers_follow_scale_and_place(scale, move):
    """To the rounding of the coordinates: at 1e6 a float64 keeps 1e-10."""
    vertices, faces = SHAPES["torus"].tessellation(48, 24)
    frame = Frame.of_bounds(vertices.min(0), vertices.max(0))
    moved = vertices * scale + move * np.array([1.0, -0.5, 0.25])
    there = Frame.of_bounds(moved.min(0), moved.max(0))
    points = np.random.default_rng(2).uniform(-1, 1, (3000, 3))
    one = MeshDistance(frame.to_unit(vertices), faces).label(points)
    other = MeshDistance(there.to_unit(moved), faces).label(points)
    rounding = 1e-14 + 4 * np.spacing(move)
    assert np.abs(one.distance - other.distance).max() < rounding
    free = (one.flags | other.flags) & TIED == 0
    angle = np.linalg.norm(one.normal - other.normal, axis=1) * np.abs(one.distance)
    assert angle[free].max() < 4 * rounding / np.sin(TIE_ANGLE)


# --- ties -------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", ["mesh", "closed form"])
def test_points_between_two_walls_are_tied(engine):
    points = np.array([[0.0, 0, 0], [0, 0, 0.01], [0.5, 0.2, 1e-7], [0.8, 0, 0.1], [1.5, 0, 0]])
    engines = {"mesh": MeshDistance(*box_mesh()), "closed form": ShapeDistance(SHAPES["box"], UNIT)}
    labels = engines[engine].label(points)
    assert (labels.flags & TIED).astype(bool).tolist() == [True, False, True, False, False]


def test_flat_and_gently_curved_walls_tie_nowhere_near_them():
    vertices, faces = SHAPES["sphere"].tessellation()
    surface = Surface(vertices, faces)
    points, normals, _, _ = surface.draw(5000, np.random.default_rng(0))
    flags = MeshDistance(vertices, faces).label(points - 0.05 * normals).flags
    assert not (flags & TIED).any()


# --- bad input, bad meshes ------------------------------------------------------------------

BAD = np.array([[np.nan, 0, 0], [0, np.inf, 0], [0, 0, -np.inf], [1e300, 0, 0]])


@pytest.mark.parametrize(
    "engine", [MeshDistance(*octahedron()), ShapeDistance(SHAPES["torus"], UNIT)]
)
def test_points_that_are_no_numbers_are_flagged_and_harm_no_other(engine):
    good = np.random.default_rng(0).uniform(-1, 1, (50, 3))
    mixed = np.insert(good, [0, 10, 20, 50], BAD, axis=0)
    bad = ~(np.abs(mixed) < 1e150).all(axis=1)
    labels, alone = engine.label(mixed), engine.label(good)
    assert np.isnan(labels.distance[bad]).all()
    assert np.isnan(labels.normal[bad]).all()
    assert (labels.flags[bad] == INVALID).all()
    assert (labels.face[bad] == -1).all()
    assert np.array_equal(labels.distance[~bad], alone.distance)
    assert np.array_equal(labels.normal[~bad], alone.normal)
    assert not engine.inside(BAD).any()


def test_far_points_are_answered():
    engine = MeshDistance(*box_mesh())
    points = np.array([[1e12, 0, 0], [0, -1e30, 0], [1e100, 1e100, 0]])
    distance, normal = engine.distance_and_normal(points)
    assert distance == pytest.approx([1e12, 1e30, 2**0.5 * 1e100])
    wanted = [[1, 0, 0], [0, -1, 0], [0.5**0.5, 0.5**0.5, 0]]
    assert np.abs(normal - wanted).max() < 1e-9


def test_signs_that_contradict_the_winding_number_stop_the_stage():
    """A box inside out has all signs wrong; an unclosed one some."""
    vertices, faces = box_mesh()
    points = np.random.default_rng(0).uniform(-1, 1, (5000, 3))
    for broken in (faces[:, ::-1], faces[:-1]):
        with pytest.raises(PandisError, match=r"signs of [\d,]+ of 5,000 points.* \[remesh\]"):
            MeshDistance(vertices, broken).label(points)


def test_the_exact_winding_number_overrules_a_wrong_sign():
    """A flap that hangs inside turns signs around it; the solid is the same."""
    vertices, faces = box_mesh()
    flap = np.array([[0.2, 0.2, 0.2], [0.3, 0.2, 0.2], [0.2, 0.3, 0.2]])
    count = len(vertices)
    both = np.concatenate([faces, [[count, count + 1, count + 2]]])
    tree = Bvh(np.concatenate([vertices, flap]), both)
    points = np.array([[0.22, 0.22, 0.21], [0.22, 0.22, 0.19]])
    labels = tree.label(points, SURFACE_DISTANCE)
    assert (labels.distance < 0).all()
    assert tree.overruled == 1


def test_winding_numbers_agree_with_libigl():
    vertices, faces = SHAPES["torus"].tessellation()
    points = near_and_far(vertices, faces, 500)
    rough, exact = Bvh(vertices, faces).winding(points)
    assert np.abs(exact - igl.winding_number(vertices, faces, points)).max() < 1e-9
    assert np.abs(rough - exact).max() < 0.3


# --- degenerate trees ------------------------------------------------------------------------


def test_many_triangles_at_one_place_and_slivers():
    """The splits find nothing to separate; the depth stays bounded and the answers exact."""
    rng = np.random.default_rng(0)
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    sliver = np.array([[0.0, 0, 0], [1, 1e-13, 0], [0.5, 0, 0]])
    point = np.zeros((3, 3))
    vertices = np.concatenate([np.tile(triangle, (3000, 1)), sliver, point])
    faces = np.arange(len(vertices)).reshape(-1, 3)
    points = rng.uniform(-1, 2, (200, 3))
    labels = Bvh(vertices, faces).label(points, SURFACE_DISTANCE, check=False)
    distance, _ = naive(vertices, faces[:1], points)
    assert np.abs(np.abs(labels.distance) - distance).max() < 1e-12
    assert set(labels.face) <= {0, 3000, 3001}  # of equals the first


def to_sixty_digits(point, corners):
    """The distance of a point to a triangle, in arithmetic of 60 digits."""
    with mpmath.workdps(60):
        p, a, b, c = ([mpmath.mpf(float(x)) for x in row] for row in (point, *corners))

        def minus(u, v):
            return [x - y for x, y in zip(u, v, strict=True)]

        def dot(u, v):
            return mpmath.fsum(x * y for x, y in zip(u, v, strict=True))

        def along(start, end):
            side, away = minus(end, start), minus(p, start)
            t = min(max(dot(side, away) / dot(side, side), 0), 1)
            return minus(away, [t * x for x in side])

        u, v, w = minus(b, a), minus(c, a), minus(p, a)
        uu, uv, vv, uw, vw = dot(u, u), dot(u, v), dot(v, v), dot(u, w), dot(v, w)
        det = uu * vv - uv * uv
        s, t = (vv * uw - uv * vw) / det, (uu * vw - uv * uw) / det
        feet = [along(a, b), along(b, c), along(c, a)]
        if s >= 0 and t >= 0 and s + t <= 1:
            feet.append([z - s * x - t * y for x, y, z in zip(u, v, w, strict=True)])
        return float(min(mpmath.sqrt(dot(foot, foot)) for foot in feet))


@pytest.mark.parametrize("aspect", [1e3, 1e6, 1e9, 1e12])
def test_needles_are_exact(aspect):
    """A tetrahedron so many times as long as thick, turned out of the axes."""
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1 / aspect, 0], [1, 0.3 / aspect, 1 / aspect]])
    vertices, faces = (
        (corners - 0.5) @ turn.T,
        np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]),
    )
    rng = np.random.default_rng(3)
    near = vertices[0] + rng.random((20, 1)) * (vertices[1] - vertices[0])
    points = np.concatenate(
        [rng.uniform(-0.6, 0.6, (20, 3)), near + rng.normal(size=(20, 3)) / aspect]
    )
    found = np.abs(MeshDistance(vertices, faces).distance_and_normal(points, check=False)[0])
    wanted = [min(to_sixty_digits(p, vertices[f]) for f in faces) for p in points]
    assert np.abs(found - wanted).max() <= 4e-16


@pytest.mark.parametrize("shape", ["box", "torus"])
def test_labels_next_to_the_surface_have_all_digits_of_single_precision(shape):
    """Where differences of doubles have lost them: on faces, edges and corners, and on needles."""
    vertices, faces = box_mesh() if shape == "box" else SHAPES[shape].tessellation()
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    vertices = vertices @ turn.T * [1, 1, 1 if shape == "box" else 1e-3]
    rng = np.random.default_rng(6)
    points, _, face, _ = Surface(vertices, faces).draw(60, rng)
    side = vertices[faces[face]]
    along = side[:, 0] + rng.random((60, 1)) * (side[:, 1] - side[:, 0])
    points = np.concatenate([points, along, side[:10, 0]])
    away = 10.0 ** rng.uniform(-14, -7, (130, 1)) * rng.normal(size=(130, 3))
    points = points + away
    labels = MeshDistance(vertices, faces).label(points, ties=False, check=False)
    lowest, highest = vertices[faces].min(axis=1) - 1e-6, vertices[faces].max(axis=1) + 1e-6
    for point, label in zip(points, np.abs(labels.distance), strict=True):
        beside = ((lowest <= point) & (point <= highest)).all(axis=1)
        wanted = min(to_sixty_digits(point, corners) for corners in vertices[faces[beside]])
        assert abs(label - wanted) <= np.spacing(np.float32(wanted)) / 2


@pytest.mark.parametrize("height", [1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-13])
@pytest.mark.parametrize("top", [0, 0.4, 1])
def test_thin_triangles_are_exact_next_to_themselves(top, height):
    """On the triangle, within its height, and as far away: turned, and from each of its corners."""
    rng = np.random.default_rng(4)
    for first in range(3):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        corners = (np.array([[0, 0, 0], [1, 0, 0], [top, height, 0]]) - rng.random(3)) @ turn.T
        corners = np.roll(corners, first, axis=0)
        inside = rng.dirichlet([1, 1, 1], 20) @ corners
        far = rng.normal(size=(20, 3)) * 10 ** rng.uniform(-12, 0, (20, 1))
        points = [inside, inside + height * rng.normal(size=(20, 3)), inside + far]
        points = np.concatenate(points)
        exact = [to_sixty_digits(point, corners) for point in points]
        engine = MeshDistance(corners, np.array([[0, 1, 2]]))
        found = np.abs(engine.distance_and_normal(points, check=False)[0])
        assert np.abs(found - exact).max() <= 1e-15


def test_among_thin_triangles_the_nearest_is_chosen():
    """Of twenty beside each other, 1e-7 apart, at points on them and within 1e-13 to 1e-2."""
    rng = np.random.default_rng(11)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    corners = []
    for height in 10 ** rng.uniform(-8, -4, 20):
        thin = np.array([[0, 0, 0], [1, 0, 0], [rng.choice([0, 1, rng.random()]), height, 0]])
        thin = (thin + 1e-7 * rng.normal(size=3) - 0.3) @ turn.T
        corners.append(np.roll(thin, rng.integers(3), axis=0))
    weights, chosen = rng.dirichlet([1, 1, 1], 30), rng.integers(20, size=30)
    on = np.einsum("ij,ijk->ik", weights, np.array(corners)[chosen])
    near = on + rng.normal(size=on.shape) * 10 ** rng.uniform(-13, -2, (30, 1))
    points = np.concatenate([on, near])
    engine = MeshDistance(np.concatenate(corners), np.arange(60).reshape(-1, 3))
    found = np.abs(engine.distance_and_normal(points, check=False)[0])
    exact = [min(to_sixty_digits(point, one) for one in corners) for point in points]
    assert np.abs(found - exact).max() <= 4e-16


def soup(kind, count, rng):
    """Return triangles without any order, of a kind that single precision finds hard."""

    def step(scale=1.0):
        return scale * rng.normal(size=(count, 3))

    def sizes(low, high):
        return 10.0 ** rng.uniform(low, high, (count, 1))

    a = rng.uniform(-1, 1, (count, 3))
    if kind == "needles":
        b = a + step(0.3)
        c = b + step(sizes(-16, -3))
    elif kind == "caps":
        b = a + step(0.3)
        c = a + (b - a) * rng.uniform(0, 1, (count, 1)) + step(sizes(-17, -2))
    elif kind == "piles":  # of flat triangles whose widest angle single precision can hardly tell
        b = a[:1] + [[0.9, 0.5, 0.1]] + 0 * a
        c = a[:1] + (b - a[:1]) * rng.uniform(0.3, 0.7, (count, 1)) + step(sizes(-3.7, -2.7))
        up = sizes(-7, -4.3) * np.cross(b - a[:1], c - a[:1])
        a, b, c = (
            at + up / np.linalg.norm(up, axis=1).max() * 1e-4 for at in (a[:1] + 0 * a, b, c)
        )
    elif kind == "sizes":
        b, c = a + step(sizes(-12, 0)), a + step(sizes(-12, 0))
    elif kind == "tiny":
        a = 1e-7 * a
        b, c = a + step(1e-9), a + step(1e-9)
    elif kind == "flat":
        b = a + step(0.1)
        c = np.where(rng.random((count, 1)) < 0.5, b, a + (b - a) * rng.uniform(0, 1, (count, 1)))
    elif kind == "lattice":
        a = np.round(8 * a) / 8
        b, c = (a + rng.integers(-1, 2, (count, 3)) / 8 for _ in range(2))
    else:
        a = 1e20 * a
        b, c = a + step(1e19), a + step(1e19)
    return np.stack([a, b, c], axis=1).reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)


def moved(points, low, high, rng):
    """Return points moved by ten to a power between these."""
    step = rng.normal(size=points.shape)
    return points + step * 10.0 ** rng.uniform(low, high, (len(points), 1))


@pytest.mark.parametrize(
    "kind", ["needles", "caps", "piles", "sizes", "tiny", "flat", "lattice", "huge"]
)
@pytest.mark.parametrize("count", [1, 7, 50, 600])
def test_what_single_precision_puts_aside_is_never_the_nearest(kind, count):
    """Leaves hold rounded triangles: no bit differs from a walk over all of the exact ones."""
    rng = np.random.default_rng(count)
    vertices, faces = soup(kind, count, rng)
    size = np.abs(vertices).max()
    weights = rng.dirichlet((0.5, 0.5, 0.5), 4000)
    on = (vertices[faces[rng.integers(0, count, 4000)]] * weights[:, :, None]).sum(axis=1) / size
    box = 1.2 * rng.uniform(-1, 1, (3000, 3))
    points = [box, on[:2000], moved(on, -16, -1, rng), moved(on[:500], 0, 40, rng)]
    points = np.concatenate([size * np.concatenate(points), vertices[:500]])
    tree = Bvh(vertices, faces)
    labels, (distance, _) = tree.label(points, 0.0, check=False), tree.scan(points)
    assert np.array_equal(labels.distance, distance)


def test_faces_must_name_vertices():
    vertices, faces = box_mesh()
    for bad in (faces + 1, faces[:0], -faces):
        with pytest.raises(ValueError, match="index vertices"):
            Bvh(vertices, bad)
    with pytest.raises(ValueError, match="finite"):
        Bvh(np.where(vertices > 0.9, np.nan, vertices), faces)


# --- compiling --------------------------------------------------------------------------------


def test_without_a_compiler_the_message_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    compiler.load.cache_clear()
    with pytest.raises(PandisError, match="install one"):
        compiler.load(tmp_path / "any.c")


def test_a_library_is_compiled_once_and_kept(monkeypatch, tmp_path):
    monkeypatch.setenv("PANDIS_CACHE", str(tmp_path / "cache"))
    source = tmp_path / "seven.c"
    source.write_text("int seven(void) { return 7; }\n")
    for _ in range(2):
        compiler.load.cache_clear()
        assert compiler.load(source).seven() == 7
    kept = list((tmp_path / "cache").iterdir())
    assert [p.suffix for p in kept] == [".so"]
    source.write_text("int seven(void) { return 7 }\n")
    compiler.load.cache_clear()
    with pytest.raises(PandisError, match="expected"):
        compiler.load(source)
    assert len(list((tmp_path / "cache").iterdir())) == 1


def test_the_source_has_no_warnings():
    source = compiler.__file__.replace("compiler.py", "bvh/bvh.c")
    command = ["cc", "-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-fsyntax-only"]
    done = subprocess.run([*command, source], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_brute_force_gives_the_same_bits_as_the_tree():
    """Looking at every face is the naive reference of the tree, with the same arithmetic."""
    vertices, faces = SHAPES["torus"].tessellation(60, 30)
    tree = Bvh(vertices, faces)
    points = np.random.default_rng(5).uniform(-1, 1, (500, 3)) * vertices.max(axis=0) * 1.2
    labels, (distance, normal) = tree.label(points, 0.0, check=False), tree.scan(points)
    assert np.array_equal(labels.distance, distance)
    assert np.array_equal(labels.normal, normal)
    assert np.isnan(tree.scan(np.full((1, 3), np.nan))[0]).all()


def opposites(faces):
    """Return the face across each edge (3 F,): of unmatched ones, the first in order of edges."""
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    across = np.full(len(start), -1)
    for h in range(len(start)):
        lower = min(start[h], end[h])
        for g in range(h + 1, len(start)):
            same = start[g] == end[h] and end[g] == start[h] and lower == min(start[g], end[g])
            if same and across[h] < 0 and across[g] < 0:
                across[h], across[g] = g // 3, h // 3
    return across


def test_faces_across_edges_are_those_of_all_pairs():
    """On soups, where an edge can have many faces and a face can repeat a vertex."""
    rng = np.random.default_rng(5)
    for _ in range(60):
        vertices = rng.normal(size=(rng.integers(3, 12), 3))
        faces = rng.integers(0, len(vertices), (rng.integers(1, 30), 3))
        stored = np.frombuffer(Bvh(vertices, faces).parts()["NEIG"], np.int32)
        np.testing.assert_array_equal(stored, opposites(faces))
