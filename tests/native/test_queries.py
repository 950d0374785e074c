"""Queries with a reach, and from one point to the next: the same bits as without, and no lies."""

import ctypes
import zlib

import numpy as np
import pytest
import trimesh
from test_header import NAMES, points_for

from pandis.base.errors import ArtifactError
from pandis.base.frame import UNIT
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.kinds import native as export
from pandis.pipeline.kinds.exact.file import MOST
from pandis.pipeline.kinds.field import CUT, ExactField
from pandis.pipeline.kinds.limits import least_limit, near_surface
from pandis.runtime.field import NativeField
from pandis.runtime.field.binding import library
from shapes import cone

BEYOND = 4


def same(one, other):
    """Tell whether answers are equal to the last bit; NaN is equal to NaN."""
    return all(np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
               for a, b in zip(one, other, strict=True))  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("reach", [0.0, 0.02, 0.3, 1e9])
def test_within_its_reach_a_query_is_the_same(name, reach, files):
    """Beyond it nothing is answered, and no surface is nearer than it says."""
    field = NativeField(files[name])
    points, reach = points_for(field), reach / field.frame.scale
    wanted = field.query(points)
    found, clear = field.query_within(points, reach)
    beyond = found.flag == BEYOND
    assert same([c[~beyond] for c in found], [c[~beyond] for c in wanted])
    assert (np.abs(wanted.distance[beyond]) >= reach).all()
    assert np.isnan(found.distance[beyond]).all()
    assert np.isnan(found.normal[beyond]).all()
    assert (clear[beyond & (np.abs(wanted.distance) > 0)] > 0).all() or not reach
    assert (clear[beyond] <= np.abs(wanted.distance[beyond])).all()
    assert beyond[np.abs(wanted.distance) > reach].all()


@pytest.mark.parametrize("name", NAMES)
def test_a_distance_alone_has_the_same_bits(name, files):
    field, lib = NativeField(files[name]), library()
    points = np.concatenate([points_for(field)[:500], [[np.nan, 0, 0], [1e300, 0, 0]]])
    wanted = field.query(points)
    distance, flags = np.empty(len(points)), []
    for index, point in enumerate(points):
        at = (ctypes.c_double * 3)(*point)
        flags.append(lib.pandis_distance(field.address, at, distance[index:].ctypes.data))
    assert np.array_equal(distance, wanted.distance, equal_nan=True)
    assert flags == wanted.flag.tolist()


def test_a_reach_that_is_none_is_refused_or_asks_for_all(files):
    field = NativeField(files["exact"])
    for reach in (-1.0, float("nan")):
        with pytest.raises(ValueError, match="a reach must be 0 or more"):
            field.query_within([[0.0, 0, 0]], reach)
    lib = library()
    lib.pandis_query_within.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_double,
                                        ctypes.c_void_p]  # fmt: skip
    answer, point = (ctypes.c_double * 8)(), (ctypes.c_double * 3)(*field.frame.centre)
    for reach in (-1.0, float("nan"), float("inf")):
        lib.pandis_query_within(field.address, point, reach, answer)
        assert answer[0] == field.query([field.frame.centre]).distance[0]


def ball(most, monkeypatch, shell=False):
    """Return a finely tessellated ball, or a thin shell, that looks at so much; and its body."""
    vertices, faces = SHAPES["sphere"].tessellation()
    if shell:
        faces = np.concatenate([faces, faces[:, ::-1] + len(vertices)])
        vertices = np.concatenate([vertices, 0.98 * vertices])
    body = Body(0.9 * vertices, faces, UNIT)
    monkeypatch.setattr("pandis.pipeline.kinds.exact.file.least_limit", lambda *given, **_: most)
    return NativeField(export.native_bytes(ExactField("exact", body), {})), body


def middle(count, spread):
    """Return points around the middle of a ball, where all faces are about equally near."""
    return np.random.default_rng(5).normal(0, spread, (count, 3))


@pytest.mark.parametrize("most", [9, 100, 1000])
@pytest.mark.parametrize("spread", [1e-12, 1e-3, 0.3])
def test_an_exact_mesh_that_has_too_much_to_look_at_is_cut_and_says_so(most, spread, monkeypatch):
    """Of the right side, never nearer than is true, and what is clear is clear."""
    field, body = ball(most, monkeypatch)
    points = middle(500, spread)
    found, clear = field.query(points), field.clear(points)
    exact, _ = body.distance.distance_and_normal(points, check=False)
    cut = found.flag == CUT
    assert cut.mean() > 0.9 or spread == 0.3
    assert np.array_equal(found.distance[~cut], exact[~cut])
    inside = (np.abs(points) <= body.distance.reach).all(axis=1)
    assert np.array_equal(np.sign(found.distance[cut & inside]), np.sign(exact[cut & inside]))
    assert (np.abs(found.distance) >= np.abs(exact)).all()
    assert (clear <= np.abs(exact)).all()
    if most == 1000:
        assert (np.abs(found.distance) - np.abs(exact)).max() < 5e-3
        assert (clear[cut] > 0.9 * np.abs(exact[cut])).all()


def bicone(count):
    """Return a double cone of so many sectors; all of its faces are equally near to its middle."""
    turn = 2 * np.pi * np.arange(count) / count
    rim = 0.9 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    here, there = np.arange(count), np.arange(1, count + 1) % count
    up, down = np.full(count, count), np.full(count, count + 1)
    faces = np.concatenate([np.stack([here, there, up], 1), np.stack([there, here, down], 1)])
    return np.concatenate([rim, [[0, 0, 0.9], [0, 0, -0.9]]]), faces


def renamed(data, name, other):
    """Return a file with a section of another name, which readers ignore."""
    data = data.replace(name, other, 1)
    return data[:24] + zlib.crc32(data[32:]).to_bytes(4, "little") + data[28:]


BODIES = {
    "ball": lambda: (0.9 * SHAPES["sphere"].tessellation()[0], SHAPES["sphere"].tessellation()[1]),
    "torus": lambda: SHAPES["torus"].tessellation(400, 200),
    "cone": lambda: cone(4000),
    "bicone": lambda: bicone(30_000),
}


@pytest.mark.parametrize("name", BODIES)
def test_a_cut_distance_is_certain_to_a_thousandth(name, monkeypatch):
    """At the middle, on the axis and on the ring: all faces seem equally near, slabs tell more."""
    monkeypatch.setattr("pandis.pipeline.kinds.exact.file.least_limit", lambda *_, **__: 1000)
    vertices, faces = BODIES[name]()
    body = Body(vertices * (0.9 / np.abs(vertices).max()), faces, UNIT)
    data = export.native_bytes(ExactField("exact", body), {})
    turn, height = np.linspace(0, 6, 50), np.linspace(-0.95, 0.95, 200)
    ring = 0.9 / 1.4 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    axis = np.stack([0 * height, 0 * height, height], axis=1)
    points = np.concatenate([middle(100, 1e-3), axis, ring])
    exact = np.abs(body.distance.distance_and_normal(points, check=False)[0])
    doubt = {}
    for key, source in (("slabs", data), ("boxes", renamed(data, b"SLAB", b"none"))):
        field = NativeField(source)
        distance, clear = np.abs(field.query(points).distance), field.clear(points)
        assert (clear <= exact).all()
        assert (distance >= exact * (1 - 1e-12)).all()
        doubt[key] = (distance - clear).max()
    assert 0 < doubt["slabs"] < 1e-3
    assert doubt["boxes"] > 1e-3 or name != "bicone"  # fewer boxes overlap in the others


def brush(count):
    """Return thin rods around a thin rod, along (1, 1, 1): boxes and slabs tell nothing apart."""
    along = np.ones(3) / np.sqrt(3)
    across = np.cross(along, [1, 0, 0.3])
    across /= np.linalg.norm(across)
    axes = np.stack([across, np.cross(along, across)])
    turn, corner = (2 * np.pi * np.arange(n) / n for n in (count, 3))
    middles = 0.3 * np.stack([np.cos(turn), np.sin(turn)], 1) @ axes
    prism = 1e-3 * np.stack([np.cos(corner), np.sin(corner)], 1) @ axes
    prism = np.concatenate([prism - 0.7 * along, prism + 0.7 * along])
    faces = np.array([[0, 2, 1], [3, 4, 5], [0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [2, 0, 3],
                      [2, 3, 5]])  # fmt: skip
    middles = np.concatenate([middles, np.zeros((1, 3))])
    vertices = (middles[:, None] + prism).reshape(-1, 3)
    return vertices, (faces + 6 * np.arange(count + 1)[:, None, None]).reshape(-1, 3), axes


def test_next_to_a_surface_the_limit_holds_though_others_seem_nearer(monkeypatch):
    """A search that has met only far faces must not take itself to be far away."""
    monkeypatch.setattr("pandis.pipeline.kinds.exact.file.least_limit", lambda *_, **__: 1 << 20)
    vertices, faces, axes = brush(5000)
    body, rng = Body(vertices, faces, UNIT), np.random.default_rng(1)
    field = NativeField(export.native_bytes(ExactField("exact", body), {}))
    turn, away = rng.uniform(0, 6, 100), 1e-3 + 10 ** rng.uniform(-4, -1, 100)
    points = (away * [np.cos(turn), np.sin(turn)]).T @ axes + rng.uniform(-0.1, 0.1, (100, 1))
    answer, exact = field.query(points), body.distance.distance_and_normal(points, check=False)[0]
    assert np.abs(exact).max() < 0.15
    assert not (answer.flag == CUT).any()
    assert np.array_equal(answer.distance, exact)


def test_of_a_rough_ball_the_bound_is_not_given_up(monkeypatch):
    """Where the doubt cannot be had within the budget, a larger one can."""
    monkeypatch.setattr("pandis.pipeline.kinds.exact.file.least_limit", lambda *_, **__: 1000)
    vertices, faces = BODIES["ball"]()
    rough = np.random.default_rng(3).uniform(-0.01, 0.01, (len(vertices), 1))
    body = Body(vertices / 1.02 * (1 + rough), faces, UNIT)
    field = NativeField(export.native_bytes(ExactField("exact", body), {}))
    points = middle(200, 1e-3)
    exact = np.abs(body.distance.distance_and_normal(points, check=False)[0])
    clear = field.clear(points)
    assert (field.query(points).flag == CUT).mean() > 0.5
    assert (clear <= exact).all()
    assert (clear > 0.9 * exact).all()


def test_slabs_that_could_lie_are_refused():
    """A normal longer than 1 would tell of distances that are not there."""
    body = Body(*bicone(40), UNIT)
    data = export.native_bytes(ExactField("exact", body), {})
    table = data.index(b"SLAB")
    start = int.from_bytes(data[table + 8 : table + 16], "little")
    low = start + 96
    for at, bad in ((start, 1.01), (start, np.nan), (low, np.nan), (low, 1e9), (low + 32, -1e9)):
        changed = data[:at] + np.float32(bad).tobytes() + data[at + 4 :]
        with pytest.raises(ArtifactError, match="inconsistent"):
            NativeField(renamed(changed, b"SLAB", b"SLAB"))


def test_of_a_cut_answer_the_first_face_on_the_way_tells_the_side(monkeypatch):
    """The middle of a thin shell is a cavity, though faces of both walls are about as near."""
    field, _ = ball(400, monkeypatch, shell=True)
    found = field.query(middle(300, 1e-3))
    assert (found.flag == CUT).mean() > 0.9
    assert (found.distance > 0).all()


def test_a_reach_cuts_no_earlier(monkeypatch):
    """A search that knows more takes another way: where that is cut, it is not the answer."""
    field, _ = ball(600, monkeypatch)
    points = np.concatenate([middle(500, 1e-3), middle(500, 0.3)])
    wanted = field.query(points)
    assert 0.2 < (wanted.flag == CUT).mean() < 1
    for reach in (0.5, 0.88, 0.9, 1.5):
        found, clear = field.query_within(points, reach)
        beyond = found.flag == BEYOND
        assert same([c[~beyond] for c in found], [c[~beyond] for c in wanted])
        assert (clear[beyond] <= np.abs(wanted.distance[beyond])).all()
        assert (np.abs(wanted.distance[beyond]) >= reach).all()


def limit_of(data):
    """Return how much a query of an exact mesh looks at, as its file has it."""
    return int(np.frombuffer(data, np.int32, 5, 72)[4])


def test_around_a_corner_of_very_many_faces_the_limit_is_larger():
    """What is cut there could be wrong by the size of the object."""
    body = Body(*cone(1000), UNIT)
    data = export.native_bytes(ExactField("exact", body), {})
    assert MOST < limit_of(data) <= 8 * MOST
    field, rng = NativeField(data), np.random.default_rng(2)
    base = rng.normal(0, (0.01, 0.01, 0.001), (2000, 3)) - (0, 0, 0.9)
    points = np.concatenate([base, near_surface(body.corners, body.faces, 20_000, rng=rng)])
    found = field.query(points)
    assert not (found.flag == CUT).any()
    assert np.array_equal(found.distance, body.distance.distance_and_normal(points)[0])


@pytest.mark.parametrize("needed", [400, 500, 501, 1000, 1001, 3000])
def test_a_limit_has_a_margin_of_two(needed):
    """Points that were not tried can need more: with just enough a fan of 500 sectors was cut."""

    def query(points, most):
        return np.full(len(points), 0.05), np.full(
            len(points), np.inf if most >= needed or not most else 0
        )

    limit = least_limit(1000, *cone(8), query=query)
    assert 2 * needed <= limit <= max(1000, 4 * needed)


@pytest.mark.slow
def test_one_small_corner_of_a_large_mesh_makes_the_limit_larger():
    """Of 160,000 vertices one is the middle of such a fan; no point drawn by area comes near it."""
    ball, small = trimesh.creation.icosphere(subdivisions=7, radius=0.7), cone(1500)
    vertices = np.concatenate([ball.vertices, 0.002 * small[0] + (0.8, 0, 0)])
    faces = np.concatenate([ball.faces, small[1] + len(ball.vertices)])
    body = Body(vertices, faces, UNIT)
    field = NativeField(export.native_bytes(ExactField("exact", body), {}))
    base = np.random.default_rng(4).normal(0, (2e-6, 2e-6, 2e-7), (500, 3)) + (0.8, 0, -0.0018)
    found = field.query(base)
    assert not (found.flag == CUT).any()
    assert np.array_equal(found.distance, body.distance.distance_and_normal(base, check=False)[0])


def test_the_middle_of_a_ball_does_not_make_the_limit_larger():
    vertices, faces = SHAPES["sphere"].tessellation()
    body = Body(0.9 * vertices, faces, UNIT)
    data = export.native_bytes(ExactField("exact", body), {})
    assert limit_of(data) == MOST
    assert (NativeField(data).query(middle(100, 1e-9)).flag == CUT).all()


def test_without_a_limit_nothing_is_cut(monkeypatch):
    field, body = ball(0, monkeypatch)
    points = middle(200, 1e-3)
    exact, _ = body.distance.distance_and_normal(points, check=False)
    found = field.query(points)
    assert not found.flag.any()
    assert np.array_equal(found.distance, exact)


def test_an_exact_mesh_takes_few_bytes(fields, files):
    """Vertices, their normals, faces and neighbours take 48 a face; the rest is the tree."""
    field = fields["exact"]
    assert files["exact"].stat().st_size <= 120 * len(field.engine.faces)
