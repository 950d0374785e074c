"""A proxy comes along: pressed, led aside and lifted off, it is where it belongs.

The judges are closed forms. In front of three walls at right angles, the place nearest to a probe
is known, and how far friction may keep the proxy from it; around a torus, whether a way is free.
"""

from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
import trimesh
from igl.copyleft.cgal import mesh_boolean
from scipy.spatial.transform import Rotation

from pandis.base.errors import PandisError
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.compact.packing import build_compact
from pandis.pipeline.kinds.compact.reference import CompactField
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.kinds.native import export_native
from pandis.pipeline.run.ask.options import NativeOptions
from pandis.runtime.contact import Material, NativeContact
from pandis.runtime.field import NativeField
from pandis.runtime.scene import Placed
from shapes import box, opened, union
from support import artifact

#: Half of the block (mm), ticks per second, and a probe's speed (mm a tick).
HALF, TICK, PACE = 50.0, 1e-3, 0.2
#: Seconds at the end, in which the proxy arrives; how near it has to come (mm).
WAIT, NEAR = 0.5, 0.02


class Corner(NamedTuple):
    """A block without one octant, turned anyhow: the field, and its rotation (3, 3)."""

    field: NativeField
    turn: np.ndarray


@cache
def corner(kind, turned):
    parts = []
    for axis in range(3):
        low, high = np.full(3, -HALF), np.full(3, HALF)
        high[axis] = 0
        parts.append(box(tuple(high - low), 100.0).apply_translation((low + high) / 2))
    mesh = union(parts)
    turn = Rotation.random(random_state=3).as_matrix() if turned else np.eye(3)
    mesh.vertices = mesh.vertices @ turn.T
    body = Body.open(opened(mesh).mesh)
    if kind == "exact":
        field = ExactField("exact", body)
    else:
        arrays, record = build_compact(body, 16, 0, log=lambda text: None)
        attributes = record.attributes() | body.frame.attributes()
        field = CompactField("compact-16", artifact("compact", arrays, attributes))
    return Corner(
        NativeField(
            export_native(field, body, NativeOptions(), provenance={}, log=lambda text: None)
        ),
        turn,
    )


def way(*places):
    """Return a path (n, 3) through places."""
    parts = [np.linspace(a, b, max(2, int(np.linalg.norm(b - a) / PACE) + 1))
             for a, b in pairwise(places)]  # fmt: skip
    return np.concatenate([*parts, np.repeat(places[-1][None], int(WAIT / TICK), 0)])


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("kind", ["exact", "compact"])
@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("radius", [0.0, 0.5, 2.0])
def test_out_of_a_corner_of_three_walls(kind, turned, friction, radius):
    """It was glued there for good, and pulled with 2 N, in 47 to 60 of 60 presses."""
    field, turn = corner(kind, turned)
    placed = Placed(field, np.eye(3), np.zeros(3), 1e-3, 400.0)
    rng = np.random.default_rng(0)
    for deep in (0.5, 3.0):
        for out in (1.0, 5.0, 8.0):
            for _ in range(5):
                begin = radius + rng.uniform(3, 10, 3)
                pressed = radius - deep * rng.uniform(0.3, 1, 3)
                end = pressed.copy()
                axes = rng.permutation(3)[: 1 + rng.integers(3)]
                end[axes] = radius + out  # along an edge, along a wall, or free of all of them
                contact = NativeContact(
                    placed, 1e-3 * radius, material=Material(friction, friction, 0, 0)
                )
                path = way(begin, pressed, end) @ turn.T * 1e-3
                steps = contact.follow(path, TICK)
                nearest = np.maximum(end, radius)
                against = np.linalg.norm(nearest - end)
                off = np.linalg.norm(1e3 * steps.proxy[-1] @ turn - nearest)
                assert off <= NEAR + friction * against * (1 + 1e-6), (deep, out, end)
                assert (steps.queries <= 26).all()


def torus_distance(points):
    """Return the signed distance (n,) to the torus of the tests, mesh units."""
    return np.hypot(np.hypot(points[:, 0], points[:, 1]) - 1.0, points[:, 2]) - 0.4


def torus_place(rng):
    """Return a point of it and its normal."""
    round_, along = rng.uniform(0, 2 * np.pi, 2)
    out = np.array([np.cos(along), np.sin(along), 0])
    normal = np.cos(round_) * out + np.array([0, 0, np.sin(round_)])
    return out + 0.4 * normal, normal


@pytest.mark.parametrize("kind", ["exact", "compact", "spline", "tricubic", "trilinear-normal"])
@pytest.mark.parametrize("radius", [0.0, 0.01, 0.05, 0.09])
def test_a_ball_that_is_lifted_off_is_not_left_behind(kind, radius, files):
    """One of 1.5 mm stayed behind in free air, and pulled at an armed device with 3.3 N.

    The largest is 0.92 of the height (of the unit frame) up to which grids and splines are made.
    """
    field, rng = NativeField(files[kind]), np.random.default_rng(1)
    mm, ball = 1.4 / 50, radius / field.frame.scale  # of an object of 100 mm
    placed = Placed(field, np.eye(3), np.zeros(3), 1e-3 / mm, 400.0)
    tried = 0
    while tried < 30:
        foot, normal = torus_place(rng)
        side = np.linalg.svd(normal[None])[2][1]
        above = foot + (ball + 3 * mm) * normal
        pressed = foot + (ball - 2 * mm) * normal
        aside = pressed + 3 * mm * side
        end = aside + 30 * mm * normal
        up = np.linspace(aside + 6 * mm * normal, end, 60)
        if (torus_distance(up) < ball + mm).any():
            continue  # on its way it meets the torus again
        tried += 1
        path = way(*(place / mm for place in (above, pressed, aside, end))) * 1e-3
        steps = NativeContact(placed, ball / mm * 1e-3).follow(path, TICK)
        assert np.linalg.norm(steps.proxy[-1] - path[-1]) < 1e-9, tried
        assert not steps.force[-1].any()


@pytest.mark.parametrize("kind", ["spline", "tricubic", "trilinear-normal", "trilinear-gradient"])
def test_a_ball_larger_than_what_is_known_around_a_field_is_refused(kind, files):
    field = NativeField(files[kind])
    placed = Placed(field, np.eye(3), np.zeros(3), 1.0, 400.0)
    NativeContact(placed, 0.09 / field.frame.scale)
    with pytest.raises(PandisError, match="smaller radius"):
        NativeContact(placed, 0.11 / field.frame.scale)


@pytest.mark.parametrize(("setting", "value"), [("budget", 7), ("slide", -1.0), ("slide", np.nan)])
def test_options_beyond_their_ranges_are_refused(setting, value, files):
    """With a budget of 1 to 3 every step began anew: a proxy stuck for ever in free space."""
    contact = NativeContact(Placed(NativeField(files["exact"]), np.eye(3), np.zeros(3), 1.0, 400.0))
    before = bytes(contact.options)
    with pytest.raises(PandisError, match="an option of a contact is beyond its range"):
        contact.set(**{setting: value})
    assert bytes(contact.options) == before


@pytest.mark.parametrize("tilt", [0.4, 0.6, 0.8, 1.0])
def test_a_step_in_a_sharp_corner_ends(tilt):
    """Where no way led nearer to a wall that was to be looked at again, one never did."""
    around = np.array([0.2, 2.4, 4.2])
    edges = np.column_stack(
        [np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around), np.full(3, np.cos(tilt))]
    )
    points = np.concatenate([np.zeros((1, 3)), 120 * edges])
    cone = trimesh.Trimesh(points, [[0, 2, 1], [0, 3, 2], [0, 1, 3], [1, 2, 3]], process=False)
    block = trimesh.creation.box((100, 100, 100)).apply_translation((0, 0, 10))
    arrays = [(np.asarray(m.vertices, float), np.asarray(m.faces, np.int64)) for m in (block, cone)]
    vertices, faces, _ = mesh_boolean(*arrays[0], *arrays[1], "minus")
    body = Body.open(opened(trimesh.Trimesh(vertices, faces, process=False)).mesh)
    data = export_native(
        ExactField("exact", body), body, NativeOptions(), provenance={}, log=lambda text: None
    )
    placed = Placed(NativeField(data), np.eye(3), np.zeros(3), 1e-3, 400.0)
    rng = np.random.default_rng(0)
    for _ in range(20):
        pressed = rng.normal(0, 1, 3) - [0, 0, 1]
        path = way(np.array([0, 0, 25.0]), pressed, pressed + rng.normal(0, 4, 3)) * 1e-3
        steps = NativeContact(placed).follow(path, TICK)
        assert (steps.queries <= 26).all()
