"""Meshes that move: a refit answers as a tree that is built anew, to the last bit."""

import ctypes

import numpy as np
import pytest
from test_queries import same

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.field import CUT, ExactField
from pandis.pipeline.kinds.native import native_bytes
from pandis.runtime.field import NativeField
from pandis.runtime.field.binding import library


def bent(vertices, angle, squeeze=1.0):
    """Return vertices bent along z by an angle (radians), and squeezed along x."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    length = high[2] - low[2]
    at = (vertices - (low + high) / 2) * [squeeze, 1, 1]
    turn = angle * at[:, 2] / length
    radius = length / angle - at[:, 1] if angle else None
    if angle == 0:
        return at + (low + high) / 2
    moved = np.stack([at[:, 0], length / angle - radius * np.cos(turn), radius * np.sin(turn)], 1)
    return moved + (low + high) / 2


@pytest.fixture(scope="module")
def mesh(fields, files):
    """Return the field of an exact mesh, its body, and its vertices and faces."""
    field = fields["exact"]
    vertices = field.frame.to_mesh(field.engine.vertices)
    return NativeField(files["exact"]), field.frame, vertices, field.engine.faces


def fresh(frame, vertices, faces):
    """Return the field of a tree that is built anew."""
    body = Body(vertices, faces, frame)
    return NativeField(native_bytes(ExactField("exact", body), {}))


def points_around(frame, vertices, count=4000):
    """Return points in the box, next to the surface, and beside vertices."""
    rng = np.random.default_rng(3)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    box = rng.uniform(low - 0.3 * (high - low), high + 0.3 * (high - low), (count, 3))
    beside = vertices[rng.integers(len(vertices), size=count)]
    near = beside + rng.normal(0, 0.002 / frame.scale, (count, 3))
    return np.concatenate([box, near, beside[:200] * (1 + 1e-12), frame.to_mesh(1.5 * box[:100])])


@pytest.mark.parametrize("angle", [0.0, 0.3, 0.8, 1.5])
@pytest.mark.parametrize("squeeze", [1.0, 0.4])
def test_it_is_a_tree_that_is_built_anew_to_the_last_bit(mesh, angle, squeeze):
    field, frame, vertices, faces = mesh
    moving = field.moving()
    shape = bent(vertices, angle, squeeze)
    moving.refit(shape)
    built = fresh(frame, shape, faces)
    points = points_around(frame, shape)
    assert same(moving.query(points), built.query(points))
    found, clear = moving.query_within(points, 0.1 / frame.scale)
    wanted = built.query_within(points, 0.1 / frame.scale)
    assert same([*found, clear], [*wanted[0], wanted[1]])


def test_it_comes_back_and_the_field_that_lends_its_faces_stays(mesh):
    """A thousand shapes leave nothing behind; without a refit it answers as the field."""
    field, frame, vertices, _ = mesh
    points = points_around(frame, vertices)
    wanted = field.query(points)
    moving = field.moving()
    assert same(moving.query(points), wanted)
    for angle in np.linspace(0, 1.5, 200):
        moving.refit(bent(vertices, angle))
    assert not same(moving.query(points), wanted)
    assert same(field.query(points), wanted)
    moving.refit(vertices)
    assert same(moving.query(points), wanted)


def test_of_random_vertices_far_apart_nothing_is_cut(mesh, monkeypatch):
    """The worst a refit can get: boxes that all overlap, for which the limit was not made."""
    _, frame, vertices, faces = mesh
    monkeypatch.setattr("pandis.pipeline.kinds.exact.file.least_limit", lambda *given, **_: 300)
    field = fresh(frame, vertices, faces)
    shape = np.random.default_rng(1).uniform(vertices.min(), vertices.max(), vertices.shape)
    moving = field.moving()
    moving.refit(shape)
    points = points_around(frame, vertices, 300)
    found, clear = moving.query(points), moving.clear(points)
    exact, _ = Body(shape, faces, frame).scan(points)
    assert not (found.flag == CUT).any()
    assert np.array_equal(clear, np.abs(found.distance))
    assert np.allclose(np.abs(found.distance), np.abs(exact), rtol=1e-14, atol=0)


def test_what_is_no_shape_is_refused_and_the_old_one_stays(mesh):
    field, frame, vertices, _ = mesh
    moving, points = field.moving(), points_around(frame, vertices, 200)
    moving.refit(bent(vertices, 0.5))
    wanted = moving.query(points)
    for bad in (np.nan, np.inf, 1e300):
        shape = vertices.copy()
        shape[7, 1] = bad
        with pytest.raises(ValueError, match="the old shape stays"):
            moving.refit(shape)
    with pytest.raises(ValueError, match=r"the mesh has .* vertices, not 3"):
        moving.refit(vertices[:3])
    assert same(moving.query(points), wanted)


def test_only_an_exact_mesh_can_move(files):
    for name in ("spline", "compact", "network", "sphere"):
        with pytest.raises(ValueError, match="only an exact mesh has movable vertices"):
            NativeField(files[name]).moving()
    lib, field = library(), NativeField(files["spline"])
    exact, other = NativeField(files["exact"]), ctypes.create_string_buffer(4096)
    content, alignment, count = -7, -9, -16
    room = lib.pandis_refit_room(exact.address)
    assert lib.pandis_refit_open(other, field.address, other, 4096) == content
    assert lib.pandis_refit_open(other, exact.address, 4, room) == alignment
    assert lib.pandis_refit_open(other, exact.address, 8, room - 8) == count
    assert lib.pandis_refit(exact.address, None, 0) == content  # it was not opened to move
