"""Faces that cross or are connected, and rays: against rational arithmetic, or all pairs."""

from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest

from pandis.engine.faces import close, connected, crossings
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.mesh.topology import edges_of, one_sided, oriented, patches, same_place
from pandis.pipeline.mesh.tree import MeshTree

SHEAR = np.array([[1, 0.3, 0], [0, 1, 0.1], [0.7, 0, 1]])


def minus(a, b):
    return [x - y for x, y in zip(a, b, strict=True)]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def clipped(points, normal, least):
    """Corners of the part with normal.p >= least of a convex set, given by its corners in order."""
    heights, kept = [dot(normal, p) - least for p in points], []
    for i, p in enumerate(points):
        j = (i + 1) % len(points)
        if heights[i] >= 0:
            kept.append(p)
        if heights[i] * heights[j] < 0:
            share = heights[i] / (heights[i] - heights[j])
            kept.append([x + share * (y - x) for x, y in zip(p, points[j], strict=True)])
    return [p for i, p in enumerate(kept) if p not in kept[:i]]


def between(points, direction, one, other):
    """Corners of the part between two planes, which may be one."""
    low, high = sorted((dot(direction, one), dot(direction, other)))
    points = clipped(points, direction, low) if points else points
    return clipped(points, [-x for x in direction], -high) if points else points


def common_part(a, b):
    """Corners of what two closed triangles have in common, in rational arithmetic."""
    if not any(cross(minus(b[1], b[0]), minus(b[2], b[0]))):
        a, b = b, a
    normal = cross(minus(b[1], b[0]), minus(b[2], b[0]))
    if any(normal):
        points = between(a, normal, b[0], b[0])
        for k in range(3):
            inward = cross(normal, minus(b[(k + 1) % 3], b[k]))
            points = clipped(points, inward, dot(inward, b[k])) if points else points
        return points
    # two segments: within the line of the other, then between its ends
    ends = max(combinations(b, 2), key=lambda ends: dot(minus(*ends), minus(*ends)))
    points, way = list(a), minus(*ends)
    for axis in ([1, 0, 0], [0, 1, 0], [0, 0, 1]):
        normal = cross(way, axis)
        points = between(points, normal, ends[0], ends[0])
    return between(points, way, *ends)


def meet(vertices, f, g):
    """Whether two faces have more in common than their common vertices and the edge between."""
    a, b = ([[Fraction(float(x)) for x in vertices[i]] for i in face] for face in (f, g))
    shared = [[Fraction(float(x)) for x in vertices[i]] for i in {*f.tolist()} & {*g.tolist()}]
    points = common_part(a, b)
    if len(shared) == 3:
        return True
    if len(shared) < 2:
        return any(p not in shared for p in points)
    edge = minus(shared[1], shared[0])

    def on_edge(p):
        way = minus(p, shared[0])
        return not any(cross(way, edge)) and 0 <= dot(way, edge) <= dot(edge, edge)

    return not all(on_edge(p) for p in points)


def soup(rng, count, cells):
    """Triangles with corners on a small lattice, often in one plane, sheared and rounded."""
    vertices = rng.integers(0, cells, (3 * count, 3)).astype(float)
    if rng.random() < 0.5:
        vertices[:, rng.integers(3)] = 0
    if rng.random() < 0.5:
        vertices = vertices @ SHEAR * rng.choice([1, 0.1, 1e-5])
    faces = same_place(vertices)[rng.permutation(3 * count).reshape(-1, 3)]
    return vertices, faces[[len({*face}) == 3 for face in faces.tolist()]]


def test_crossings_are_those_of_rational_arithmetic():
    """Touching, coplanar, folded and flat faces too, and faces that share a vertex or an edge."""
    rng, seen = np.random.default_rng(0), {}
    for _ in range(2500):
        vertices, faces = soup(rng, 2, rng.integers(2, 5))
        if len(faces) < 2:
            continue
        expected = meet(vertices, *faces)
        case = len({*faces[0].tolist()} & {*faces[1].tolist()}), expected
        seen[case] = seen.get(case, 0) + 1
        assert len(crossings(vertices, faces)) == expected, (vertices.tolist(), faces.tolist())
    assert min(seen.values()) > 10
    assert len(seen) == 7  # 0, 1 or 2 common vertices, crossing or not; or all three


def test_crossings_of_many_faces_are_those_of_all_pairs():
    rng = np.random.default_rng(1)
    for cells in (3, 5):
        vertices, faces = soup(rng, 40, cells)
        pairs = [p for p in combinations(range(len(faces)), 2) if meet(vertices, *faces[list(p)])]
        assert len(pairs) > 10
        np.testing.assert_array_equal(crossings(vertices, faces), pairs)
        question = rng.random(len(faces)) < 0.2
        some = [pair for pair in pairs if question[list(pair)].any()]
        np.testing.assert_array_equal(crossings(vertices, faces, question), some)


@pytest.mark.parametrize("size", [1e-140, 1e-9, 1.0, 1e9, 1e140])
def test_size_changes_no_crossing(size):
    size = 2.0 ** np.round(np.log2(size))  # rounds no coordinate
    vertices, faces = soup(np.random.default_rng(2), 60, 4)
    vertices = vertices @ SHEAR
    np.testing.assert_array_equal(crossings(vertices * size, faces), crossings(vertices, faces))


def test_points_close_together_are_those_of_all_pairs():
    points = np.round(np.random.default_rng(3).random((300, 3)), 1)
    distance = np.linalg.norm(points[:, None] - points, axis=2)
    pairs = np.argwhere(np.triu(distance <= 0.15, 1))
    assert len(pairs) > 100
    np.testing.assert_array_equal(close(points, 0.15), pairs)
    assert not len(close(points[:0], 0.15))


def test_connected_nodes_have_their_least_as_label():
    rng = np.random.default_rng(4)
    pairs, label = rng.integers(0, 200, (150, 2)), np.arange(200)
    for _ in range(200):
        for a, b in pairs:
            label[[a, b]] = min(label[a], label[b])
    np.testing.assert_array_equal(connected(pairs, 200), label)


def test_oriented_faces_agree_with_the_first_of_their_patch():
    vertices, faces = SHAPES["torus"].tessellation()
    faces = np.concatenate([faces, faces + len(vertices)])
    turned = np.random.default_rng(5).random(len(faces)) < 0.5
    turned[[0, len(faces) // 2]] = False, True
    mixed = np.where(turned[:, None], faces[:, ::-1], faces)
    result = oriented(mixed)
    assert not edges_of(result).conflicts.any()
    np.testing.assert_array_equal(result[0], faces[0])
    np.testing.assert_array_equal(result[len(faces) // 2], faces[len(faces) // 2, ::-1])
    label, count = patches(faces)
    assert count == 2
    np.testing.assert_array_equal(label, np.arange(len(faces)) >= len(faces) // 2)


def test_a_band_of_one_side_is_turned_as_far_as_it_can_be():
    """All but the edges at one seam agree; a band of two sides agrees wholly."""
    count = 300
    for twisted in (True, False):
        left, right = 2 * np.arange(count), 2 * np.arange(count) + 1
        next_left, next_right = np.roll(left, -1), np.roll(right, -1)
        if twisted:
            next_left[-1], next_right[-1] = next_right[-1], next_left[-1]
        one = np.stack([left, right, next_left], axis=1)
        faces = np.concatenate([one, np.stack([right, next_right, next_left], axis=1)])
        mixed = np.random.default_rng(7).random(len(faces)) < 0.5
        faces[mixed] = faces[mixed, ::-1]
        assert edges_of(faces).conflicts.sum() > 200
        assert edges_of(oriented(faces)).conflicts.sum() == twisted
        assert not one_sided(faces).any()  # it is open


def test_an_edge_without_length_hides_no_overlap():
    """Two corners at one place, as before welding."""
    vertices = np.array([[0, 0, 0], [0, 0, 0], [1, 0, 0], [2, 0, 0], [-1, 0, 0], [0, 1, 0.0]])
    for tip, expected in ((3, 1), (4, 0), (5, 0)):
        assert len(crossings(vertices, [[0, 1, 2], [1, 0, tip]])) == expected


def test_what_is_not_finite_is_refused_where_faces_use_it():
    vertices = np.random.default_rng(8).random((6, 3))
    vertices[5] = np.nan
    assert len(crossings(vertices, [[0, 1, 2], [0, 1, 3]])) == 0
    for value in (np.nan, np.inf):
        vertices[3, 1] = value
        with pytest.raises(ValueError, match="finite"):
            crossings(vertices, [[0, 1, 2], [0, 1, 3]])


def test_single_precision_means_the_same_numbers():
    points = np.random.default_rng(9).random((300, 3)).astype(np.float32)
    faces = np.arange(300).reshape(-1, 3)
    double = points.astype(np.float64)
    np.testing.assert_array_equal(crossings(points, faces), crossings(double, faces))
    np.testing.assert_array_equal(close(points, 0.1), close(double, 0.1))


def first_hits(vertices, faces, points, ways, skipped, least):
    """Lengths of rays by all faces (Moeller and Trumbore 1997)."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    lengths = []
    for p, way, own in zip(points, ways, skipped, strict=True):
        h = np.cross(way, c - a)
        det, s = ((b - a) * h).sum(axis=1), p - a
        with np.errstate(all="ignore"):
            x, g = (s * h).sum(axis=1) / det, np.cross(s, b - a)
            y, length = g @ way / det, ((c - a) * g).sum(axis=1) / det
        hit = (x >= 0) & (y >= 0) & (x + y <= 1) & (length >= least) & (np.arange(len(a)) != own)
        lengths.append(length[hit].min(initial=np.inf))
    return np.array(lengths)


@pytest.mark.parametrize("size", [1e-3, 1.0])
def test_rays_hit_small_faces_too(size):
    """A fixed threshold for parallel rays loses those whose faces are small beside the mesh."""
    vertices, faces = SHAPES["torus"].tessellation(96, 48)
    far = np.array([[10.0, 0, 0], [10, 1, 0], [10, 0, 1]])
    vertices = np.concatenate([size * vertices, far])
    count, rng = len(vertices), np.random.default_rng(6)
    faces = np.concatenate([faces, [[count - 3, count - 2, count - 1]]])
    start = rng.integers(0, len(faces) - 1, 60)
    points = vertices[faces[start]].mean(axis=1)
    ways = rng.normal(size=(60, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    tree = MeshTree(vertices, faces)
    for least in (0.0, 0.3 * size):
        expected = first_hits(vertices, faces, points, ways, start, least)
        assert 10 < np.isinf(expected).sum() < 50
        found = tree.first_hits(points, ways, start, least=least)
        np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_a_ray_hits_a_needle_where_it_is_or_not_at_all():
    rng, hits = np.random.default_rng(10), 0
    for height in 10.0 ** np.arange(-15, -6):
        vertices = np.array([[0, 0, 0], [1, 0, 0], [0.4, height, 0]]) @ np.linalg.qr(SHEAR)[0]
        tree = MeshTree(vertices, np.array([[0, 1, 2]]))
        targets = rng.random((2000, 1)) * vertices[1]
        points = targets + rng.normal(0, 0.3, (2000, 3))
        ways = (targets - points) / np.linalg.norm(targets - points, axis=1, keepdims=True)
        lengths = tree.first_hits(points, ways, np.full(2000, -1))
        met = np.isfinite(lengths)
        places = points[met] + lengths[met, None] * ways[met]
        assert (places >= vertices.min(axis=0) - 1e-5).all()
        assert (places <= vertices.max(axis=0) + 1e-5).all()
        hits += met.sum()
    assert hits > 100
