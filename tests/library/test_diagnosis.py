"""Every fault is counted exactly, and sound figures are those of the shape."""

import igl
import numpy as np
import pytest

from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.mesh.diagnosis import FAULTS, diagnose
from pandis.pipeline.mesh.topology import (
    components,
    crossing_faces,
    edges_of,
    equal_rows,
    nonmanifold_vertices,
    patches,
    repeats_a_vertex,
)
from pandis.pipeline.mesh.tree import MeshTree
from support import box_mesh, octahedron


def found(vertices, faces):
    return diagnose(np.asarray(vertices, float), np.asarray(faces, np.int64))


def faults(vertices, faces):
    d = found(vertices, faces)
    return {name: getattr(d, name) for name in FAULTS if getattr(d, name)}


def copies(*placed):
    """Place copies of a mesh, each (vertices, faces)."""
    offset, vertices, faces = 0, [], []
    for v, f in placed:
        vertices.append(v)
        faces.append(f + offset)
        offset += len(v)
    return np.concatenate(vertices), np.concatenate(faces)


def test_a_sound_mesh_has_its_figures():
    vertices, faces = SHAPES["torus"].tessellation()
    d = found(vertices, faces)
    assert d.valid
    assert d.faults() == "none"
    assert (d.genus, d.cavities, d.components, d.euler) == (1, 0, 1, 0)
    assert d.volume == pytest.approx(2 * np.pi**2 * 0.4**2, rel=1e-2)
    assert d.area == pytest.approx(4 * np.pi**2 * 0.4, rel=1e-2)
    # straight through the tube it is twice its radius, and nowhere less than nearly that
    assert 0.3 < d.wall["min"] <= d.wall["p1"] <= 0.81
    assert d.parts == [{"faces": len(faces), "volume": d.volume, "depth": 0}]


def test_wall_thickness_finds_a_thin_plate():
    vertices, faces = box_mesh()
    d = found(vertices * [1, 1, 0.002], faces)
    assert d.valid
    assert d.wall["min"] == pytest.approx(0.002, rel=1e-6)


def test_holes_are_listed_longest_first():
    vertices, faces = box_mesh()
    d = found(vertices, np.delete(faces, [0, 16, 70], axis=0))
    assert sorted(hole["edges"] for hole in d.holes) == [3, 4]
    assert d.holes[0]["length"] > d.holes[1]["length"]
    assert d.boundary_edges == 7


@pytest.mark.parametrize(
    ("name", "change", "expected"),
    [
        ("a face missing", lambda f: f[1:], {"boundary_edges": 3}),
        ("a face turned", lambda f: np.r_[f[:1, ::-1], f[1:]], {"orientation_conflicts": 3}),
        ("all turned", lambda f: f[:, ::-1], {"inverted_components": 1}),
        ("a face twice", lambda f: np.r_[f, f[:1]], {"duplicate_faces": 1, "nonmanifold_edges": 3}),
        ("no area", lambda f: np.r_[f, [[0, 0, 2]]], {"degenerate_faces": 1}),
    ],
)
def test_each_fault_of_an_octahedron(name, change, expected):
    vertices, faces = octahedron()
    seen = faults(vertices, change(faces))
    assert expected.items() <= seen.items(), name


def test_soup_is_judged_as_the_surface_it_describes():
    vertices, faces = octahedron()
    soup = vertices[faces].reshape(-1, 3)
    assert faults(soup, np.arange(24).reshape(-1, 3)) == {"split_vertices": 18}


def test_crossing_pairs_come_in_one_order():
    # reports quote the first pairs
    random = np.random.default_rng(0)
    corners = random.random((400, 1, 3)) + 0.2 * random.standard_normal((400, 3, 3))
    pairs = crossing_faces(corners.reshape(-1, 3), np.arange(1200).reshape(-1, 3)).tolist()
    assert len(pairs) > 1000
    assert pairs == sorted(sorted(pair) for pair in pairs)


def numbered(count, joined):
    """Return the number of everyone's group, in the order of their first members."""
    group = list(range(count))
    for a, b in joined:
        low, high = sorted((group[a], group[b]))
        group = [low if g == high else g for g in group]
    order = sorted(set(group))
    return [order.index(g) for g in group]


@pytest.mark.parametrize("apart", [1, 1 << 25])
def test_edges_and_parts_are_those_of_a_plain_search(apart):
    """Also where vertex numbers are too large for an edge and its place to fit into a number."""
    rng = np.random.default_rng(0)
    drawn = [rng.integers(12, size=(count, 3)) for count in (0, 1, 7, 60)]
    drawn += [np.stack([rng.permutation(9)[:3] for _ in range(count)]) for count in (2, 9, 30)]
    for faces in drawn:
        count, faces = len(faces), faces * apart  # noqa: PLW2901
        edges, halves = edges_of(faces), []
        for face in faces.tolist():
            halves += [(face[k], face[(k + 1) % 3]) for k in range(3)]
        sides = [tuple(sorted(half)) for half in halves]
        assert edges.edges.tolist() == [list(side) for side in sorted(set(sides))]
        assert edges.order.tolist() == sorted(range(len(sides)), key=sides.__getitem__)
        assert [tuple(edges.edges[k].tolist()) for k in edges.edge_of] == sides
        assert edges.uses.tolist() == [sides.count(side) for side in sorted(set(sides))]
        uses = [sides.count(side) for side in sides]
        same = [(a, b) for a in range(len(sides)) for b in range(a) if sides[a] == sides[b]]
        across = [(a // 3, b // 3) for a, b in same]
        pairs = [(a // 3, b // 3) for a, b in same if uses[a] == 2]
        for (label, number), joined in ((components(faces), across), (patches(faces), pairs)):
            assert label.tolist() == numbered(count, joined)
            assert number == len(set(label.tolist()))
        corners, fans = faces.reshape(-1).tolist(), []
        for a, b in same:
            ends = [(h, 3 * (h // 3) + (h + 1) % 3) for h in (a, b)] if uses[a] == 2 else []
            fans += [(c, d) for c in sum(ends[:1], ()) for d in sum(ends[1:], ())
                     if corners[c] == corners[d]]  # fmt: skip
        fan = numbered(len(corners), fans)
        several = {
            v for v in corners if len({f for f, u in zip(fan, corners, strict=True) if u == v}) > 1
        }
        if count and not repeats_a_vertex(faces).any():
            assert set(nonmanifold_vertices(faces, edges).tolist()) == several
        rows = rng.integers(2, size=(count, 3)).astype(float)
        firsts = [rows.tolist().index(row) for row in rows.tolist()]
        assert equal_rows(rows).tolist() == firsts


def test_crossing_and_touching_solids():
    vertices, faces = octahedron()
    crossing = copies((vertices, faces), (vertices * 0.9 + [0.5, 0.1, 0.05], faces))
    assert faults(*crossing).keys() == {"self_intersections", "odd_windings"}
    touching = copies((vertices, faces), (vertices + [2.0, 0, 0], faces))
    assert faults(*touching).keys() == {"split_vertices", "nonmanifold_vertices"}
    apart = copies((vertices, faces), (vertices + [2.1, 0, 0], faces))
    assert found(*apart).valid
    assert found(*apart).components == 2


def test_exact_predicates_see_the_coordinates_as_they_are():
    """Scaling to a unit box would round, and make faces cross that only are coplanar."""
    rng = np.random.default_rng(0)
    vertices, faces = box_mesh()
    for _ in range(20):
        shifted = vertices * rng.uniform(0.1, 3) + rng.uniform(-1, 1, 3)
        assert found(shifted, faces).self_intersections == 0


def test_cavities_and_depth():
    vertices, faces = box_mesh()
    shells = copies((vertices, faces), (vertices / 2, faces[:, ::-1]), (vertices / 4, faces))
    d = found(*shells)
    assert d.valid
    assert d.cavities == 1
    assert sorted(part["depth"] for part in d.parts) == [0, 1, 2]
    wrong = copies((vertices, faces), (vertices / 2, faces))
    assert found(*wrong).inverted_components == 1
    assert found(*wrong).odd_windings


def test_scale_and_place_change_no_count():
    vertices, faces = box_mesh()
    broken = np.delete(faces, [0, 16], axis=0)
    reference = faults(vertices, broken)
    for scale, shift in ((1e-9, 0.0), (1e9, 0.0), (1.0, 1e6)):
        assert faults(vertices * scale + shift, broken) == reference


def test_winding_numbers_are_those_of_the_exact_sum():
    """Open and closed, near and far from the origin: the fast tree alone is off by more."""
    rng = np.random.default_rng(0)
    vertices, faces = SHAPES["torus"].tessellation(48, 24)
    faces = np.asarray(faces, np.int64)
    for shown, shift in ((faces, 0.0), (faces[200:], 0.0), (faces, 1e6)):
        points = rng.uniform(-1.5, 1.5, (5000, 3))
        exact = igl.winding_number(vertices, shown, points)
        off = np.abs(MeshTree(vertices + shift, shown).windings(points + shift) - exact)
        assert off.max() < 0.05
        unclear = np.abs(exact - np.round(exact)) > 0.15
        assert off[unclear].max(initial=0) < 1e-3


def test_winding_numbers_of_closed_meshes_are_whole():
    """Outside, inside, inside twice, and inside out, close to the surface, too."""
    rng = np.random.default_rng(0)
    vertices, faces = SHAPES["torus"].tessellation(48, 24)
    faces = np.asarray(faces, np.int64)
    turned = faces[:, ::-1]
    for shells in (
        copies((vertices, faces)),
        copies((vertices, faces), (vertices + [0.3, 0.2, 0.1], faces)),
        copies((vertices, turned), (vertices * 0.9, turned)),
    ):
        near = shells[0][rng.integers(len(shells[0]), size=2000)] + rng.normal(0, 0.01, (2000, 3))
        points = np.concatenate([rng.uniform(-1.5, 1.5, (5000, 3)), near])
        exact = np.round(igl.winding_number(*shells, points))
        assert len(np.unique(exact)) == (3 if len(shells[1]) > len(faces) else 2)
        assert (MeshTree(*shells).windings(points) == exact).all()


@pytest.mark.parametrize("nested", [False, True])
def test_rays_through_edges_and_corners_count_right(nested):
    """Points and vertices on one lattice: rays meet edges and corners, and lie in faces."""
    vertices, faces = box_mesh()
    mesh = copies((vertices, faces), (vertices / 2, faces)) if nested else (vertices, faces)
    ticks = np.arange(-9, 10) / 8
    points = np.stack(np.meshgrid(ticks, ticks, ticks), axis=-1).reshape(-1, 3)
    deep = (np.abs(vertices).max(axis=0) - np.abs(points)).min(axis=1)
    half = (np.abs(vertices).max(axis=0) / 2 - np.abs(points)).min(axis=1)
    wanted = (deep > 0).astype(int) + (half > 0) * nested
    off = (deep != 0) & ((half != 0) | (not nested))
    assert (np.unique(wanted) == np.arange(2 + nested)).all()
    assert np.isnan(MeshTree(*mesh).windings(np.array([[np.nan, 0, 0]]))).all()
    turns = MeshTree(*mesh).windings(points[off])
    assert np.abs(turns - wanted[off]).max() < 0.02
    assert (turns == np.round(turns)).mean() > 0.5, "no ray told anything"


def some_faces(vertices):
    """Return random triangles, some without area, over given vertices."""
    rng = np.random.default_rng(3)
    faces = rng.integers(0, len(vertices), (90, 3))
    faces[:20, 2] = faces[:20, 1]  # segments
    faces[20:30] = faces[20:30, :1]  # points
    return faces


def with_slivers(vertices, faces):
    """Return a mesh with thin triangles on some edges, whose tips are 1e-8 away from these."""
    start, end = vertices[faces[40:60, 0]], vertices[faces[40:60, 1]]
    thin = (start + end) / 2 + 1e-8
    added = len(vertices) + np.arange(len(thin))
    more = np.stack([faces[40:60, 0], faces[40:60, 1], added], axis=1)
    return np.concatenate([vertices, thin]), np.concatenate([faces, more])


def naive_closest(vertices, faces, points):
    """Return the distance (n, F) from points to faces by planes and edges, without a tree."""
    rows = []
    for face in faces:
        corners = vertices[face]
        best = np.full(len(points), np.inf)
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            along = end - start
            squared = along @ along
            share = ((points - start) @ along / squared).clip(0, 1) if squared else np.zeros(1)
            foot = start + share[:, None] * along
            best = np.minimum(best, np.linalg.norm(points - foot, axis=1))
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        if size := np.linalg.norm(normal):
            height = (points - corners[0]) @ normal / size
            flat = points - height[:, None] * normal / size
            sides = [
                np.cross(end - start, flat - start) @ normal >= 0
                for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True)
            ]
            best = np.where(np.all(sides, axis=0), np.minimum(best, np.abs(height)), best)
        rows.append(best)
    return np.array(rows).T


@pytest.mark.parametrize("shift", [0.0, 1000.0])
def test_distances_are_those_of_every_face_without_a_tree(shift):
    rng = np.random.default_rng(2)
    vertices = rng.uniform(-1, 1, (60, 3)) + shift
    vertices, faces = with_slivers(vertices, some_faces(vertices))
    points = rng.uniform(-1.5, 1.5, (1500, 3)) + shift
    points[:100] = vertices[rng.integers(0, 60, 100)]
    thin = vertices[faces[rng.integers(90, len(faces), 900)]]
    inside = np.einsum("ij,ijk->ik", rng.dirichlet((1, 1, 1), 900), thin)
    points[100:1000] = inside + rng.normal(0, 1e-8, (900, 3))
    each = naive_closest(vertices, faces, points)
    nearest, allowed = each.min(axis=1), np.full(len(points), 1e-14 * max(1, shift))
    allowed[100:1000] = 3e-8  # rounding decides on which side of a thin triangle's edge they are
    tree = MeshTree(vertices, faces)
    assert (np.abs(tree.distance(points) - nearest) <= allowed).all()
    place, face = tree.closest(points)
    assert (np.abs(np.linalg.norm(points - place, axis=1) - nearest) <= allowed).all()
    own = np.take_along_axis(each, face[:, None].astype(int), axis=1)[:, 0]
    assert (np.abs(own - nearest) <= allowed).all()
