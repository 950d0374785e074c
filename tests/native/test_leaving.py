"""A proxy comes along: pressed into a corner and led out again, it is where it belongs.

The judge is a closed form. In front of three walls at right angles, the place nearest to a probe is
known, and how far friction may keep the proxy from it.
"""

from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pandis.export.native import export_native
from pandis.fields.compact import CompactField
from pandis.fields.exact import ExactField
from pandis.geometry.body import Body
from pandis.grids.compact import build_compact
from pandis.native.contact import Material, NativeContact
from pandis.native.runtime import NativeField
from pandis.native.scene import Placed
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
        arrays, record = build_compact(body, 16, 0, lambda text: None)
        attributes = record.attributes() | body.frame.attributes()
        field = CompactField("compact-16", artifact("compact", arrays, attributes))
    return Corner(NativeField(export_native(field, kind, {}, 32, body, lambda text: None)), turn)


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
