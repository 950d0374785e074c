"""A proxy comes to rest, stays there, and lies on the surface; a steep field does not let it in."""

import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

from bodies import UNIT, field_of, file_of_grid

from oracle import Solid
from pandis.pipeline.geometry.body import Body
from pandis.runtime.contact import TOUCHING, Material, NativeContact
from pandis.runtime.field import NativeField
from pandis.runtime.scene import Placed

#: Ways that are tried; seconds of the last ticks, in which a proxy has come to rest.
COUNT, RESTS = 40, 0.5
#: By how much farther a proxy may be after a tick, unit frame: 0.15 um of 100 mm.
STILL = 3e-6
#: Below a field's own surface, unit frame: 0.05 mm of 100.
DEEP = 1e-3


@cache
def bumpy():
    """Return a ball with 2,562 vertices at random distances from its middle."""
    ball = trimesh.creation.icosphere(4)
    far = 0.85 + 0.06 * np.random.default_rng(0).uniform(-1, 1, (len(ball.vertices), 1))
    return Body(ball.vertices * far, np.asarray(ball.faces, np.int32), UNIT)


@cache
def placed(kind):
    return Placed(field_of(bumpy(), kind), np.eye(3), np.zeros(3), 1.0, 400.0)


def pressed(kind, radius, friction):
    """Yield the `Touches` of a probe that rests below the surface, and where it does."""
    rng = np.random.default_rng(0)
    for _ in range(COUNT):
        outward = rng.normal(size=3)
        outward /= np.linalg.norm(outward)
        begin, end = outward * (1.05 + radius), outward * rng.uniform(0.5, 0.7)
        contact = NativeContact(placed(kind), radius, material=Material(friction, friction, 0, 0))
        contact.follow(begin + np.linspace(0, 1, 200)[:, None] * (end - begin))
        contact.follow(np.repeat(end[None], 100, 0))
        yield contact.follow(np.repeat(end[None], int(1e3 * RESTS), 0)), end


@pytest.mark.parametrize("kind", ["exact", "compact-16", "tricubic-96"])
@pytest.mark.parametrize(
    ("radius", "friction"), [(0.0, 0.0), (0.02, 0.0), (0.08, 0.0), (0.08, 0.3)]
)
def test_a_probe_at_rest_is_not_left_again(kind, radius, friction):
    """Planes that contradict each other led the proxy round in circles, and the force buzzed."""
    for touches, end in pressed(kind, radius, friction):
        left = np.linalg.norm(touches.proxy - end, axis=1)
        assert np.diff(left).max() < STILL


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("kind", ["exact", "compact-16"])
def test_a_large_ball_at_rest_lies_on_the_surface(kind, friction):
    """Friction held it above, on planes seen from where the rounded surface had bent away."""
    field, solid = placed(kind).field, Solid(bumpy().distance.vertices, bumpy().distance.faces)
    own = solid.distance if kind == "exact" else lambda points: field.query(points)[:2]
    places = np.array([touches.proxy[-1] for touches, _ in pressed(kind, 0.08, friction)])
    assert np.abs(own(places)[0] - 0.08).max() < 3e-5


@pytest.mark.parametrize("kind", ["tricubic", "trilinear-normal"])
@pytest.mark.parametrize("steep", [1.3, 1.5, 1.8])
def test_a_field_that_is_steeper_than_a_distance_keeps_a_proxy_out(kind, steep):
    """A network may be so, and told of more free space than there is: 2.6 mm of 100 lay within."""
    block = trimesh.creation.box((1.2, 1.0, 0.8))
    body = Body(np.array(block.vertices), np.asarray(block.faces, np.int32), UNIT)
    field = NativeField(file_of_grid(body, f"{kind}-64", steep))
    where, rng = Placed(field, np.eye(3), np.zeros(3), 1.0, 400.0), np.random.default_rng(0)
    for _ in range(300):
        outward = rng.normal(size=3)
        outward /= np.linalg.norm(outward)
        begin, end = outward * rng.uniform(0.9, 1.0), 0.2 * outward
        ticks = rng.integers(2, 60)
        path = begin + np.linspace(0, 1, ticks)[:, None] * (end - begin)
        touches = NativeContact(where).follow(path, 5e-3)
        assert field.query(touches.proxy).distance.min() > -DEEP


def test_a_slow_slide_over_bumps_needs_few_queries():
    """13 in the median when a walk's steps were short on smooth surfaces, too; 8 since."""
    bumps, turn = placed("trilinear-normal-64"), np.linspace(0, 2.5, 1500)[:, None]
    path = np.hstack([np.cos(turn), 0.8 * np.sin(turn), 0.6 * np.sin(turn)])
    for _ in range(8):
        distance, normal = bumps.field.query(path)[:2]
        path -= (distance + 0.02)[:, None] * normal
    fall = path[0] * np.linspace(1.3, 1, 60)[:, None]
    touches = NativeContact(bumps).follow(np.concatenate([fall, path]))
    assert (touches.state[100:] & TOUCHING).astype(bool).mean() > 0.9
    assert np.median(touches.queries[100:]) <= 10
