"""Faces that lie on their neighbours are faults, whatever rounding makes of them, and unfold."""

import igl
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pandis.engine.faces import crossings
from pandis.pipeline.geometry.distance import MeshDistance
from pandis.pipeline.mesh.cleanup import clean
from pandis.pipeline.mesh.diagnosis import diagnose
from pandis.pipeline.mesh.flips import unfold
from pandis.pipeline.mesh.topology import crossing_faces, edges_of, folded_halves
from support import box_mesh, octahedron


def turned(vertices, seed):
    """Turn vertices, so that each coordinate is rounded."""
    return Rotation.random(random_state=seed).apply(vertices) + [0.1 * seed, 0, 0]


def with_fold():
    """Return a box with a vertex of a flat side moved, in its plane, across the opposite edge."""
    vertices, faces = box_mesh()
    high = vertices.max(axis=0)
    inner = np.flatnonzero((vertices[:, 2] == high[2]) & (abs(vertices) < high)[:, :2].all(axis=1))
    fan = faces[(faces == inner[0]).any(axis=1)]
    reach = np.ptp(vertices[np.unique(fan)], axis=0)
    vertices = vertices.copy()
    vertices[inner[0]] += [0.55 * reach[0], 0.2 * reach[1], 0.0]
    return vertices, faces


def flat_tetrahedron():
    """Return four faces on a square, both ways, beside an octahedron."""
    vertices, faces = octahedron()
    square = np.array([[2, 0, 0], [2.3, 0, 0], [2.3, 0.3, 0], [2, 0.3, 0]])
    flat = np.array([[0, 1, 2], [0, 2, 3], [1, 0, 3], [1, 3, 2]])
    return np.concatenate([vertices, square]), np.concatenate([faces, flat + len(vertices)])


MESHES = {"fold": with_fold, "tetrahedron": flat_tetrahedron}


def right_signs(vertices, faces, seed=0):
    """Return whether signs without a check are those of winding numbers, everywhere in the box."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    points = np.random.default_rng(seed).uniform(low - 0.3, high + 0.3, (20_000, 3))
    distance = MeshDistance(vertices, faces).label(points, ties=False, check=False).distance
    inside = igl.winding_number(vertices, faces.astype(np.int64), points) > 0.5
    return bool(((distance < 0) == inside).all())


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("name", MESHES)
def test_a_fold_is_a_fault_however_it_is_turned(name, seed):
    vertices, faces = MESHES[name]()
    vertices = turned(vertices, seed)
    assert diagnose(vertices, faces).self_intersections
    fixed, fixed_faces = clean(vertices, faces)
    assert diagnose(fixed, fixed_faces).valid
    assert right_signs(fixed, fixed_faces)
    # no vertex is new, and none has moved
    assert {row.tobytes() for row in fixed} <= {row.tobytes() for row in vertices}


def test_rounding_decides_whether_folded_faces_cross():
    """So the exact test alone lets some of them pass: the signs beside those are noise."""
    passed = []
    for seed in range(40):
        vertices, faces = with_fold()
        vertices = turned(vertices, seed)
        assert len(folded_halves(vertices, faces))
        assert len(crossing_faces(vertices, faces))
        if not len(crossings(vertices, faces)):
            passed.append(right_signs(vertices, faces))
    assert passed
    assert not all(passed)


@pytest.mark.parametrize("seed", range(4))
def test_a_knife_edge_is_refused_or_has_right_signs(seed):
    """For angles from 0.1 to 1e-16: where the mesh is accepted, no point has the wrong sign."""
    accepted = []
    for exponent in np.arange(1, 17, 0.5):
        thick = 10**-exponent
        section = np.array([[0, 0], [1, 0], [1, thick]])
        vertices = np.concatenate([np.c_[section, [0] * 3], np.c_[section, [1] * 3]])
        faces = np.array([[0, 2, 1], [3, 4, 5], [0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4],
                          [2, 0, 3], [2, 3, 5]])  # fmt: skip
        vertices = turned(vertices, seed)
        if diagnose(vertices, faces).valid:
            accepted.append(exponent)
            assert right_signs(vertices, faces), exponent
    assert accepted == list(np.arange(1, 1 + len(accepted) / 2, 0.5))
    assert 6 <= accepted[-1] <= 13


@pytest.mark.parametrize("width", [1e-2, 1e-3, 1e-4, 1e-5])
def test_a_thin_flat_needle_has_no_folds(width):
    """The angles of a sliver have large rounding errors, but are larger still."""
    base = width * np.array([[-0.5, 0, 0], [0.5, 0, 0], [0, 1e-3, 0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    for seed in range(4):
        vertices = turned(np.concatenate([base, [[0, 0, 1.0]]]), seed)
        diagnosis = diagnose(vertices, faces)
        assert not len(folded_halves(vertices, faces))
        assert diagnosis.valid, diagnosis.faults()
        assert right_signs(vertices, faces)


def test_sound_faces_stay_as_they_are():
    for vertices, faces in (box_mesh(), octahedron()):
        assert len(folded_halves(vertices, faces)) == len(crossing_faces(vertices, faces)) == 0
        assert unfold(vertices, faces) is faces


@pytest.mark.parametrize("share", [0.05, 0.4, 0.55, 0.7])
@pytest.mark.parametrize("lift", [0, 1e-12])
def test_what_unfolding_leaves_is_closed(share, lift):
    """A flat tetrahedron beside a box, most of it covered twice, is dropped or stays whole."""
    vertices, faces = box_mesh()
    side = np.sqrt(2 * share)
    flat = np.array([[0, 0, 0], [side, 0, 0], [0, side, 0], [0.02 * side, 0.02 * side, lift]])
    four = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]) + len(vertices)
    vertices, faces = np.concatenate([vertices, flat + [2, 0, 0.5]]), np.concatenate([faces, four])
    _, fixed = clean(vertices, faces)
    assert edges_of(fixed).closed
    assert len(faces) - len(fixed) in (0, 4)


@pytest.mark.parametrize(("short", "height"), [(1e-9, 0.02), (1e-11, 1e-3), (1e-9, 1e-5)])
def test_needles_that_share_their_short_edge_are_no_fold(short, height):
    """The angle at an edge depends on the height over it, however thin the faces are."""
    vertices = np.array([[1, short / 2, 0], [1, -short / 2, 0], [0, 0, height],
                         [0.5, 0, -height / 2], [0, 0.25, 0], [0, -0.25, 0]])  # fmt: skip
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 4, 2], [0, 3, 4], [1, 2, 5], [1, 5, 3],
                      [2, 4, 5], [3, 5, 4]])  # fmt: skip
    faces = faces if size_of(vertices, faces)[1] > 0 else faces[:, ::-1]
    cleaned, same = clean(vertices, faces)
    assert diagnose(vertices, faces).valid
    np.testing.assert_array_equal(cleaned[same], vertices[faces])


def test_unfolding_ends_with_less_area_and_the_same_volume():
    """Many vertices are moved within a side; some of what results cannot be unfolded."""
    changed = 0
    for seed in range(30):
        vertices, faces = box_mesh()
        rng = np.random.default_rng(seed)
        top = np.flatnonzero(vertices[:, 2] == vertices[:, 2].max())
        inner = top[(abs(vertices[top]) < vertices.max(axis=0))[:, :2].all(axis=1)]
        vertices[inner, :2] += rng.normal(0, 0.2, (len(inner), 2))
        vertices = turned(vertices, seed)
        result = unfold(vertices, faces)
        changed += result is not faces
        assert edges_of(result).closed
        areas, volumes = zip(*(size_of(vertices, some) for some in (result, faces)), strict=True)
        assert areas[0] <= areas[1] * (1 + 1e-14)
        assert volumes[0] == pytest.approx(volumes[1], rel=1e-13)
        assert unfold(vertices, result) is result
    assert changed > 10


def size_of(vertices, faces):
    """Return area and volume."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    return area, np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def test_no_faces_at_all():
    vertices, none = box_mesh()[0], np.empty((0, 3), np.int64)
    assert not len(crossing_faces(vertices, none))
    assert unfold(vertices, none) is none
    assert not diagnose(vertices, np.array([[0, 0, 1], [2, 2, 3]])).valid


def test_a_sheet_of_two_sides_does_not_dissolve():
    """Unfolding one whole would leave nothing; it stays, and is refused as before."""
    grid = np.stack(np.meshgrid(np.arange(4.0), np.arange(4.0), [0.0]), axis=-1).reshape(-1, 3)
    corner = (np.arange(3)[:, None] * 4 + np.arange(3)).reshape(-1)
    over = np.concatenate([corner[:, None] + [0, 1, 5], corner[:, None] + [0, 5, 4]])
    under = np.concatenate([corner[:, None] + [0, 4, 1], corner[:, None] + [1, 4, 5]])
    faces = np.concatenate([over, under])
    fixed, fixed_faces = clean(grid, faces)
    assert len(fixed_faces) == len(faces)
    assert not diagnose(fixed, fixed_faces).valid
