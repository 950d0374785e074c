"""The mesh on a lattice: the same mesh read back, exact distances to it, sides, bounds."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from pandis.base.errors import PandisError
from pandis.base.frame import UNIT, Frame
from pandis.engine.bvh import Bvh
from pandis.engine.packing import (
    BY_FACE,
    BY_RAY,
    INSIDE,
    OUTSIDE,
    Sides,
    distance_and_clear,
    find_rays,
    pack_mesh,
)
from pandis.engine.packing.unpacking import unpack
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.distance import MeshDistance
from pandis.pipeline.geometry.hausdorff import distance_to_triangles
from pandis.pipeline.kinds.compact.file import file_parts
from pandis.pipeline.kinds.compact.lattice import snap, step_of, to_unit
from pandis.pipeline.kinds.compact.packing import (
    bound_deviation,
    build_compact,
    limit_queries,
    pack_body,
)
from pandis.pipeline.kinds.compact.reference import CompactField
from pandis.pipeline.kinds.compact.sides import find_sides
from pandis.pipeline.kinds.exported import ExportedField
from pandis.pipeline.kinds.field import CUT, ExactField
from pandis.pipeline.kinds.limits import near_surface
from pandis.pipeline.kinds.native import export_native, native_bytes
from pandis.pipeline.mesh.tools import call
from pandis.pipeline.run.ask.catalogue import parse_field
from pandis.pipeline.run.ask.faults import near_field
from pandis.pipeline.run.ask.options import NativeOptions
from pandis.runtime.field import NativeField
from pandis.runtime.field.files import pack
from shapes import cone, open_shape, plate
from support import artifact, box_mesh

BEYOND = 4


def fitted(vertices):
    """Return vertices in the unit frame."""
    return Frame.of_bounds(vertices.min(axis=0), vertices.max(axis=0)).to_unit(vertices)


def hull(count, seed=0, stretch=(1.0, 1.0, 1.0)):
    """Return a ball of random points: with needles, and corners of many faces."""
    points = np.random.default_rng(seed).normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    shell = ConvexHull(points)
    faces = shell.simplices.astype(np.int32)
    a, b, c = (points[faces[:, k]] for k in range(3))
    inward = np.einsum("fk,fk->f", np.cross(b - a, c - a), a) < 0
    faces[inward] = faces[inward][:, [0, 2, 1]]
    return fitted(points * stretch), faces


def fan(count):
    """Return two cones base to base: corners of so many faces, and faces as long as the body."""
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    rim = np.stack([np.cos(turn), np.sin(turn), np.zeros(count)], axis=1)
    vertices = np.concatenate([rim, [[0, 0, 1.0], [0, 0, -1.0]]])
    one = np.arange(count)
    other = np.roll(one, -1)
    up = np.stack([one, other, np.full(count, count)], axis=1)
    down = np.stack([other, one, np.full(count, count + 1)], axis=1)
    return fitted(vertices), np.concatenate([up, down]).astype(np.int32)


def crown(count, seed=0):
    """Return a ball whose corners go in and out: sharp everywhere, saddles among them."""
    vertices, faces = hull(count, seed)
    return fitted(
        vertices * np.random.default_rng(seed).uniform(0.5, 1.0, (len(vertices), 1))
    ), faces


def native(vertices, faces, bits, sides=None):
    """Return the field of a mesh on the lattice."""
    packed = pack_mesh(vertices, faces, sides or find_sides(vertices, faces))
    arrays = packed._asdict()
    record = type(
        "Record", (), {"bits": bits, "most": 704, "reach": 0.91, "deviation": 0, "rounding": 0}
    )
    return NativeField(pack(UNIT, file_parts(arrays, record), {}, version=3)), arrays


MESHES = {
    "box": (lambda: (fitted(box_mesh()[0]), box_mesh()[1]), 12),
    "hull": (lambda: hull(3000), 16),
    "flat": (lambda: hull(2000, 1, (1.0, 1.0, 0.02)), 14),
    "fan": (lambda: fan(3000), 16),
    "crown": (lambda: crown(1500), 14),
    "fine": (lambda: hull(2000, 2), 20),
    "coarse": (lambda: hull(20_000, 3), 10),
}

#: The meshes whose tests take longest.
LARGE = "fan", "coarse"


@pytest.fixture(params=[pytest.param(name, marks=[pytest.mark.slow] * (name in LARGE))
                        for name in MESHES])  # fmt: skip
def case(request):
    """Return a mesh on the lattice, its bits, and the exact distance to it."""
    (vertices, faces), bits = MESHES[request.param][0](), MESHES[request.param][1]
    snapped = snap(vertices, faces, bits)
    return snapped, bits, MeshDistance(to_unit(snapped.vertices, bits), snapped.faces)


def points_around(engine, count, seed=0):
    """Return points in the box, as many next to the surface, and some beside its corners."""
    rng = np.random.default_rng(seed)
    box = rng.uniform(-1.2, 1.2, (count, 3))
    distance, normal = engine.distance_and_normal(box, check=False)
    near = box - (distance - rng.normal(0, 0.01, count))[:, None] * normal
    corners = engine.vertices[rng.integers(len(engine.vertices), size=count)]
    return np.concatenate([box, near, corners + rng.normal(0, 0.02, (count, 3))])


def test_the_mesh_can_be_read_back(case):
    snapped, bits, _ = case
    _, arrays = native(snapped.vertices, snapped.faces, bits)
    vertices, faces = unpack(arrays)

    def triangles(vertices, faces):
        turned = [np.roll(faces, k, axis=1) for k in range(3)]
        rows = np.stack([vertices[one].reshape(len(one), 9) for one in turned], axis=1)
        return np.unique(np.array([min(map(tuple, three)) for three in rows.tolist()]), axis=0)

    assert np.array_equal(triangles(vertices, faces), triangles(snapped.vertices, snapped.faces))
    assert len(faces) == len(snapped.faces)


def test_distances_are_those_of_all_faces_and_sides_those_of_the_winding_number(case):
    snapped, bits, engine = case
    field, _ = native(snapped.vertices, snapped.faces, bits)
    points = points_around(engine, 4000)
    distance, normal, flag = field.query(points)
    exact, _ = engine.scan(points)
    seen = flag != CUT
    assert seen.mean() > 0.9
    points, distance, normal, exact = (x[seen] for x in (points, distance, normal, exact))
    # as long as no needle is in the way, that is far below a step
    assert np.abs(np.abs(distance) - np.abs(exact)).max() < max(0.5 * step_of(bits), 2e-6)
    assert (np.abs(distance) >= np.abs(exact) - 1e-13).all()
    foot, _ = engine.scan(points - distance[:, None] * normal)
    assert np.abs(foot).max() < 1e-9
    wrong = engine.inside(points) != (distance < 0)
    assert not (wrong & (np.abs(exact) > 2 * step_of(bits))).any()
    assert wrong.mean() < 1e-3


def without_sides(vertices, faces):
    """Return what tells the sides if every face does."""
    count = len(faces)
    return Sides(*(np.zeros(shape, np.uint8) for shape in ((len(vertices),), (count, 3), (count,))))


def test_sides_that_faces_alone_tell_are_wrong():
    """What `find_sides` adds is needed: without it a sharp body has points on the wrong side."""
    snapped = snap(*crown(1500), 14)
    engine = MeshDistance(to_unit(snapped.vertices, 14), snapped.faces)
    points = points_around(engine, 4000)
    for tells, right in ((find_sides, True), (without_sides, False)):
        sides = tells(snapped.vertices, snapped.faces)
        distance, _, _ = native(snapped.vertices, snapped.faces, 14, sides)[0].query(points)
        wrong = (engine.inside(points) != (distance < 0)) & (np.abs(distance) > 2 * step_of(14))
        assert wrong.any() != right


@pytest.mark.parametrize("bits", [12, 16, 20])
def test_far_from_a_sharp_ridge_that_bends_in_no_side_is_wrong(bits):
    """Single precision takes a ridge's corner there, that no point is nearest to."""
    body = Body.open(open_shape("blade").mesh)
    snapped = snap(body.corners, body.faces, bits)
    field, _ = native(snapped.vertices, snapped.faces, bits)
    engine = MeshDistance(to_unit(snapped.vertices, bits), snapped.faces)
    points = np.random.default_rng(1).uniform(-1, 1, (400_000, 3))
    distance, _, _ = field.query(points)
    exact, _ = engine.distance_and_normal(points)
    assert np.array_equal(distance < 0, exact < 0)


def test_random_tetrahedra_have_no_wrong_side():
    rng = np.random.default_rng(5)
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], np.int32)
    for _ in range(300):
        corners = rng.uniform(-0.9, 0.9, (4, 3))
        u, v, w = corners[1:] - corners[0]
        if abs(np.dot(np.cross(u, v), w)) < 0.05:
            continue
        turned = faces if np.dot(np.cross(u, v), w) > 0 else faces[:, [0, 2, 1]]
        snapped = snap(corners, turned, 16)
        field, _ = native(snapped.vertices, snapped.faces, 16)
        engine = MeshDistance(to_unit(snapped.vertices, 16), snapped.faces)
        points = rng.uniform(-1, 1, (300, 3))
        distance, _, _ = field.query(points)
        assert np.array_equal(distance < 0, engine.inside(points))


@pytest.mark.slow
def test_a_surface_that_the_lattice_folds_keeps_its_sides():
    """Needles lower than a step turn over and cross others; far away nothing may come of it."""
    vertices, faces = hull(60_000, 7)
    snapped = snap(vertices, faces, 10)
    sides = find_sides(snapped.vertices, snapped.faces)
    assert snapped.turned > 0
    assert (sides.faces == BY_RAY).any()
    field, _ = native(snapped.vertices, snapped.faces, 10, sides)
    points = np.random.default_rng(1).uniform(-1, 1, (200_000, 3))
    distance, _, _ = field.query(points)
    wrong = (np.linalg.norm(points, axis=1) < 0.9) != (distance < 0)
    assert np.abs(distance[wrong]).max(initial=0) < 3 * step_of(10)


@pytest.mark.slow
@pytest.mark.parametrize("body", ["hull", "fan"])
def test_faces_that_look_the_wrong_way_are_those_with_points_on_the_wrong_side(body, monkeypatch):
    """Eight points of a short face share one walk; one by one they tell the same."""
    vertices, faces = hull(60_000, 7) if body == "hull" else fan(3000)
    snapped = snap(vertices, faces, 10)
    tree = Bvh(snapped.vertices.astype(np.float64), snapped.faces)
    corners = snapped.vertices[snapped.faces].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    wrong = ~normal.any(axis=1)
    for weights in ([1 / 3] * 3, [0.9, 0.05, 0.05], [0.05, 0.9, 0.05], [0.05, 0.05, 0.9]):
        at = np.tensordot(corners, weights, axes=(1, 0))
        wrong |= tree.inside(at + 1e-3 * normal) | ~tree.inside(at - 1e-3 * normal)
    assert wrong.any() == (body == "hull")
    assert not wrong.all()
    assert np.array_equal(tree.look_wrong(1e-3), wrong)
    monkeypatch.setenv("IGL_NUM_THREADS", "1")
    assert np.array_equal(tree.look_wrong(1e-3), wrong)


def test_every_directed_edge_occurs_as_often_as_its_reverse(case):
    snapped, _, _ = case
    edges = np.concatenate([snapped.faces[:, [k, (k + 1) % 3]] for k in range(3)])
    count = len(snapped.vertices)
    one, other = edges @ (count, 1), edges @ (1, count)
    assert np.array_equal(np.sort(one), np.sort(other))
    places = snapped.vertices[snapped.faces].astype(np.int64)
    assert (places != np.roll(places, 1, axis=1)).any(axis=2).all()


def test_flat_faces_go_by_turning_an_edge():
    """Three corners in a row: the face beyond is cut in two, and the surface stays closed."""
    vertices, faces = box_mesh()
    vertices = fitted(vertices)
    edge = faces[0][:2]
    third, other = (
        faces[0][2],
        next(
            int(v)
            for face in faces.tolist()
            if (edge[1], edge[0]) in zip(face, face[1:] + face[:1], strict=True)
            for v in face
            if v not in edge
        ),
    )
    place = len(vertices)
    middle = vertices[edge].mean(axis=0) + [1e-5, 1e-5, 1e-5]
    split = [f for f in faces.tolist() if not {*edge.tolist()} <= {*f}]
    a, b = edge.tolist()
    split += [[a, b, place], [place, b, int(third)], [a, place, int(third)], [b, a, other]]
    mesh = np.concatenate([vertices, [middle]]), np.array(split, np.int32)
    snapped = snap(*mesh, 10)
    edges = np.concatenate([snapped.faces[:, [k, (k + 1) % 3]] for k in range(3)])
    assert len({*map(tuple, edges.tolist())} ^ {(v, u) for u, v in edges.tolist()}) == 0
    places = snapped.vertices[snapped.faces].astype(np.int64)
    areas = np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0])
    assert (areas != 0).any(axis=1).all()
    assert len(snapped.faces) == len(faces) + 2


@pytest.mark.parametrize("bits", [10, 13, 16])
def test_the_bound_holds_and_falls_with_bits(bits):
    vertices, faces = hull(5000, 4)
    body = Body(vertices, faces, UNIT)
    arrays, record = build_compact(body, bits, 0, log=lambda text: None)
    field = NativeField(pack(UNIT, file_parts(arrays, record), {}, version=3))
    points = points_around(body.distance, 20_000)
    exact, _ = body.distance.distance_and_normal(points)
    off = np.abs(np.abs(field.query(points).distance) - np.abs(exact)).max()
    assert off <= record.deviation + record.rounding
    assert 0.5 * step_of(bits) < record.deviation < step_of(bits)


def test_a_sheet_that_closes_up_is_in_the_bound():
    """Thinner than a step it vanishes: the bound says how far it stood out."""
    vertices, faces = box_mesh()
    box = fitted(vertices) * [0.5, 0.5, 0.5]
    sheet = fitted(vertices) * [0.3, 0.3, 1e-4] + [0.0, 0.0, 0.7]
    both = np.concatenate([box, sheet]), np.concatenate([faces, faces + len(vertices)])
    snapped = snap(*both, 10)
    assert len(snapped.faces) == len(faces)
    apart = 0.7 - 0.45
    assert apart < snapped.deviation < 3 * apart
    assert snap(*both, 16).deviation < step_of(16)
    with pytest.raises(PandisError, match=r"nothing is left of the mesh.*take more bits"):
        snap(sheet, faces, 10)


def test_a_needle_that_shrinks_to_a_line_is_in_the_bound():
    """All of its faces get two equal corners: they go, and how far it stood out is said."""
    vertices, faces = box_mesh()
    box, thin = fitted(vertices) * 0.5, fitted(vertices) * [1e-5, 1e-5, 0.3]
    needle = thin + [1e-4, 1e-4, 0.58]
    both = np.concatenate([box, needle]), np.concatenate([faces, faces + len(vertices)])
    snapped = snap(*both, 10)
    assert len(snapped.faces) == len(faces)
    engines = [MeshDistance(*both), MeshDistance(to_unit(snapped.vertices, 10), snapped.faces)]
    tip = [[1e-4, 1e-4, needle[:, 2].max() + 1e-3]]
    near, far = (abs(engine.distance_and_normal(np.array(tip), check=False)[0][0])
                 for engine in engines)  # fmt: skip
    assert near < 2e-3
    assert 0.1 < far - near <= snapped.deviation


def test_wrong_sides_are_refused_with_their_number(monkeypatch):
    """Break what tells the sides, and the bake must see it."""
    vertices, faces = crown(1500)
    monkeypatch.setattr("pandis.pipeline.kinds.compact.packing.find_sides", without_sides)
    with pytest.raises(PandisError, match=r"of 1,000,000 points are on the wrong side.*more bits"):
        build_compact(Body(vertices, faces, UNIT), 16, 0, log=lambda text: None)


@pytest.mark.slow
def test_blocks_are_full_and_bytes_few():
    vertices, faces = hull(20_000, 6)
    arrays, record = build_compact(Body(vertices, faces, UNIT), 16, 0, log=lambda text: None)
    assert sum(part.nbytes for part in arrays.values()) < 8 * record.faces
    assert record.faces == len(faces)
    again, _ = build_compact(Body(vertices, faces, UNIT), 16, 0, log=lambda text: None)
    assert all(arrays[name].tobytes() == again[name].tobytes() for name in arrays)


@pytest.mark.slow
def test_a_query_that_has_too_much_to_look_at_is_cut_and_says_so():
    """Around the middle of a ball all faces are about equally near: flagged, and bounded."""
    vertices, faces = hull(60_000, 8)
    snapped = snap(vertices, faces, 16)
    field, arrays = native(snapped.vertices, snapped.faces, 16)
    engine = MeshDistance(to_unit(snapped.vertices, 16), snapped.faces)
    for spread, most in ((2e-3, 2e-3), (3e-2, 1e-2)):
        points = np.random.default_rng(2).normal(0, spread, (500, 3))
        distance, _, flag = field.query(points)
        cut, exact = flag == CUT, np.abs(engine.distance_and_normal(points, check=False)[0])
        assert cut.mean() > 0.9
        assert (distance < 0).all()
        assert (-distance >= exact - 1e-12).all()
        assert (-distance - exact).max() < most
        clear = field.clear(points)
        assert (clear <= exact + 1e-6).all()
        assert (clear[cut] > 0.9 * exact[cut]).all()
        assert distance_and_clear(arrays, 16, points)[0] == pytest.approx(-exact, abs=1e-6)
    # next to the surface nothing is cut, and what is clear is the distance
    near = 0.99 * engine.vertices[:2000]
    distance, _, flag = field.query(near)
    assert not flag.any()
    assert np.array_equal(field.clear(near), np.abs(distance))


@pytest.mark.slow
def test_around_a_corner_of_very_many_faces_the_limit_is_larger():
    """The boxes of all faces hold it: what is cut there is wrong by the size of the object."""
    body = Body(*cone(2000), UNIT)
    arrays, record = pack_body(body, 16)
    larger = limit_queries(arrays, record)
    vertices, faces = unpack(arrays)
    engine = MeshDistance(to_unit(vertices, 16), faces)
    rng = np.random.default_rng(1)
    base = rng.normal(0, (0.01, 0.01, 0.001), (1000, 3)) - (0, 0, 0.9)
    points = np.concatenate([base, near_surface(engine.vertices, faces, 20_000, rng=rng)])
    exact = np.abs(engine.distance_and_normal(points, check=False)[0])
    wrong, few = [
        (np.abs(distance_and_clear(arrays, 16, points, most=limit)[0]) - exact).max()
        for limit in (larger.most, record.most)
    ]
    assert record.most < larger.most <= 4 * record.most
    assert wrong < 1e-5
    assert few > 1e-4


def test_within_a_reach_a_cut_query_answers_the_same():
    """A search that begins with a reach takes another way, and is cut elsewhere."""
    snapped = snap(*hull(40_000, 4), 16)
    field, _ = native(snapped.vertices, snapped.faces, 16)
    points = np.random.default_rng(2).normal(0, 0.02, (2000, 3))
    wanted = field.query(points)
    assert (wanted.flag == CUT).mean() > 0.5
    for reach in (0.5, 0.88, 0.89, 0.9, 1.5):
        found, clear = field.query_within(points, reach)
        beyond = found.flag == BEYOND
        for one, other in zip(found, wanted, strict=True):
            assert np.array_equal(one[~beyond], other[~beyond])
        assert (clear[beyond] == reach).all()
        assert (np.abs(wanted.distance[beyond]) >= reach).all()


def test_of_a_cut_answer_the_first_face_on_the_way_tells_the_side():
    """A thin shell around the middle of a ball, next to faces that are all as far: both sides."""
    vertices, faces = hull(30_000, 9)
    count = len(vertices)
    inner = vertices * 0.98
    both = np.concatenate([vertices, inner]), np.concatenate([faces, faces[:, ::-1] + count])
    snapped = snap(*both, 16)
    field, _ = native(snapped.vertices, snapped.faces, 16)
    points = np.random.default_rng(3).normal(0, 1e-3, (300, 3))
    distance, _, flag = field.query(points)
    assert (flag == CUT).mean() > 0.9
    assert (distance > 0).all()  # the middle is a cavity


@pytest.mark.slow
def test_the_export_is_checked_where_it_is_cut_too():
    """A ball so fine that its middle is cut is exported; one of another lattice is refused."""
    vertices, faces = hull(40_000, 10)
    body = Body(vertices, faces, UNIT)
    arrays, record = build_compact(body, 14, 0, log=lambda text: None)
    held = artifact("compact", arrays, record.attributes() | UNIT.attributes())
    field, said = CompactField("compact-14", held), []
    data = export_native(field, body, NativeOptions(), provenance={}, log=said.append)
    assert "answers as the library does" in said[0]
    safe = ExportedField("compact-14", data)
    assert (safe.query(np.zeros((1, 3))).flag == CUT).all()
    other = snap(vertices, faces, 11)
    field.engine = MeshDistance(to_unit(other.vertices, 11), other.faces)
    with pytest.raises(PandisError, match="the exported model differs from its field: distance"):
        export_native(field, body, NativeOptions(), provenance={}, log=said.append)


def test_a_lens_that_the_lattice_folds_is_answered_and_exported_with_its_sides():
    """Its faces alone, with whose normals the field was once answered, do not tell them."""
    body = Body(*hull(3000, 3, (1, 1, 0.02)), UNIT)
    arrays, record = build_compact(body, 8, 0, log=lambda text: None)
    held = artifact("compact", arrays, record.attributes() | UNIT.attributes())
    field, said = CompactField("compact-8", held), []
    points = np.random.default_rng(0).uniform(-1, 1, (20_000, 3))
    distance, normal = field.answer(points)
    far = np.abs(distance) > record.deviation + record.rounding
    inside = body.distance.inside(points)
    assert ((distance < 0) == inside)[far].all()
    by_faces = field.engine.distance_and_normal(points, check=False)[0]
    assert ((by_faces < 0) != inside)[far].sum() > 100
    rising = field.answer(points + 1e-4 * normal)[0] > distance
    assert rising[far].mean() > 0.999  # a step along the normal may cross to another wall
    export_native(field, body, NativeOptions(), provenance={}, log=said.append)
    assert "side 0" in said[0]


@pytest.mark.parametrize("fewer", [False, True])
def test_a_file_says_on_which_face_of_the_mesh_a_closest_point_lies(fewer):
    """No face of a thin plate from the other side; of a simplified mesh one of the mesh itself."""
    thin = plate(0.1)
    vertices, faces = fitted(thin.vertices), thin.faces
    body, surface = Body(vertices, faces, UNIT), None
    if fewer:
        surface = call("simplify", vertices, faces, count=len(faces) // 4, seconds=60, memory_gb=4)
    arrays, record = pack_body(body, 16, surface)
    record = bound_deviation(body, arrays, record)
    held = artifact("compact", arrays, record.attributes() | UNIT.attributes())
    field = CompactField("compact-16", held)
    plain, data = (
        export_native(
            field, body, NativeOptions(original_faces=said), provenance={}, log=lambda text: None
        )
        for said in (False, True)
    )
    native = NativeField(data)
    assert native.bytes == NativeField(plain).bytes < len(plain) < len(data)
    points = near_surface(vertices, faces, 5000, rng=np.random.default_rng(1))
    answers, original = native.query(points), native.faces(points)
    assert np.array_equal(answers.distance, NativeField(plain).query(points).distance)
    assert (NativeField(plain).faces(points) == -1).all()
    apart = distance_to_triangles(points, vertices[faces[original]])
    longest = np.linalg.norm(np.diff(vertices[faces], axis=1), axis=2).max()
    room = 2 * (longest if fewer else record.deviation + record.rounding)
    assert (apart <= np.abs(answers.distance) + room).all()
    top = points[:, 2] > vertices[:, 2].max()
    assert top.sum() > 1000
    assert (vertices[faces[original[top]]][:, :, 2] > 0).any(axis=1).all()


def test_an_exact_mesh_says_on_which_face_a_closest_point_lies():
    vertices, faces = hull(3000)
    body = Body(vertices, faces, UNIT)
    native = NativeField(native_bytes(ExactField("exact", body), {}))
    points = np.random.default_rng(1).uniform(-1, 1, (5000, 3))
    whole = native.query(points).flag != CUT  # in the middle
    assert whole.mean() > 0.99
    original = body.distance.label(points, ties=False).face
    assert np.array_equal(native.faces(points)[whole], original[whole])
    assert native.faces([[np.nan, 0, 0]]) == [-1]


def test_rays_are_beside_what_they_are_of():
    snapped = snap(*crown(500), 14)
    points, owners = find_rays(snapped.vertices, snapped.faces)
    engine = MeshDistance(snapped.vertices.astype(float), snapped.faces)
    count = len(snapped.vertices)
    ends = snapped.faces.ravel(), np.roll(snapped.faces, -1, axis=1).ravel()
    middles = (snapped.vertices[ends[0]] + snapped.vertices[ends[1]]) / 2
    at = np.concatenate([snapped.vertices, middles])[owners]
    exact, _ = engine.distance_and_normal(points, check=False)
    assert np.abs(exact) == pytest.approx(np.linalg.norm(points - at, axis=1), rel=1e-3)
    assert owners.max() < count + 3 * len(snapped.faces)
    sides = find_sides(snapped.vertices, snapped.faces)
    assert {BY_FACE, INSIDE, OUTSIDE} <= {*sides.corners.tolist()}


def test_what_cannot_be_packed_is_told_in_words():
    sides = find_sides(np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9]]), box_faces())
    vertices, faces = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9]]), box_faces()
    for bad, what in (
        ((vertices - 1, faces), "whole numbers from 0"),
        ((vertices + (1 << 20), faces), "whole numbers from 0"),
        ((vertices, faces + 1), "faces must not be empty"),
        ((vertices, np.array([[0, 1, 1]])), "two equal corners"),
    ):
        with pytest.raises(ValueError, match=what):
            pack_mesh(*bad, sides)


def box_faces():
    """Return the faces of a tetrahedron, outward for three corners along the axes."""
    return np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], np.int32)


def test_names_say_how_many_bits():
    spec = parse_field("compact-16", ())
    assert (spec.kind, spec.artifact, spec.size, spec.native) == ("compact", "compact-16", 16, True)
    for name in ("compact-9", "compact-21"):
        with pytest.raises(ValueError, match="it must have 10 to 20 bits"):
            parse_field(name, ())
    assert near_field("compct-16", ()) == "compact-16"
    assert near_field("compact-autto", ()) == "compact-auto"
    with pytest.raises(ValueError, match="compact-auto, .*auto, pandis"):
        parse_field("x", ("pandis",))
