"""A field that overflows in parts of space: without an answer a contact gives no force, and where
there are answers again, its wall is the one that it would be without the gaps."""

import numpy as np
import pytest

from conftest import FRAME
from pandis.base.frame import UNIT_SIDE
from pandis.pipeline.kinds.field import INVALID
from pandis.pipeline.kinds.native import native_bytes
from pandis.pipeline.kinds.network.reference import SirenField
from pandis.runtime.contact import TOUCHING, Material, NativeContact
from pandis.runtime.field import NativeField
from pandis.runtime.scene import Placed
from support import artifact

WIDTH, SIZE, STIFFNESS = 16, 0.1, 400.0
LARGEST = float(np.finfo(np.float32).max)
#: Radians per unit of the sines whose sum overflows on islands.
RATE = 150.0
#: A place (x, y), metres, around which there are no islands: two of the sines are -1 and 1.
CALM = (np.pi * np.array([-0.5, 0.5]) - 16 * np.pi) / RATE * SIZE / UNIT_SIDE
#: Sums that overflow: on islands of 3 % of space, or beyond a plane.
GAPS = {"none": (), "islands": (RATE, 2.2), "half": (1.0, 1.15)}


def floor(waves, gaps):
    """Return a network of a wavy floor, z = waves, without an answer in some places."""
    first, between, last = (
        np.zeros((n, m), np.float32) for n, m in ((WIDTH, 3), (WIDTH, WIDTH), (4, WIDTH))
    )
    first[:3] = (0, 0, 0.5), (7, 0, 0), (0, 11, 0)
    between[:3, :3] = np.eye(3)
    last[0, :3] = 2, waves, waves
    if GAPS[gaps]:
        ripple, limit = GAPS[gaps]
        first[3:6] = ripple * np.eye(3)
        between[3, 3:6] = LARGEST / limit
    names = ("weight_0", "weight_1", "weight_2", "bias_0", "bias_1", "bias_2")
    zeros = np.zeros(WIDTH, np.float32)
    arrays = dict(
        zip(names, (first, between, last, zeros, zeros, np.float32([0, 0, 0, 1])), strict=True)
    )
    shape = {"width": WIDTH, "depth": 2, "omega": 1.0, "outputs": 4}
    model = artifact("model", arrays, {"architecture": shape, **FRAME.attributes()})
    return NativeField(native_bytes(SirenField("network", model), {}))


def wander(rng, count=4000):
    """Return a path (count, 3), metres, that presses on the floor in many places."""
    ways = np.cumsum(rng.normal(0, 1, (count, 3)), axis=0) * rng.uniform(2e-5, 4e-4)
    ways[:, :2] = np.abs((ways[:, :2] + rng.uniform(0, 0.2, 2)) % 0.2 - 0.1) - 0.05
    ways[:, 2] = 0.004 * np.sin(np.arange(count) / rng.uniform(5, 200)) - 0.001
    return ways


@pytest.mark.parametrize("gaps", ["islands", "half"])
@pytest.mark.parametrize("budget", [8, 24])
def test_without_an_answer_there_is_no_force_and_no_wall_is_lost(gaps, budget):
    missed = touched = 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        waves = (0.0, 0.02)[seed // 2 % 2]
        radius = (0.0, 0.0, 0.002)[seed % 3]
        material = Material(0.5, 0.4, 0.5, 0.5) if seed % 2 else None
        mine, other = (
            NativeContact(Placed.at(floor(waves, kind), SIZE, STIFFNESS), radius, material)
            for kind in (gaps, "none")
        )
        for contact in (mine, other):
            contact.set(budget=budget)
        path = wander(rng)
        seen = mine.follow(path)
        none = seen.flag == INVALID
        assert not seen.force[none].any()
        assert np.isfinite(seen.force).all()
        assert seen.queries.max() <= budget + 2 + 130
        assert np.isfinite(seen.proxy[~none]).all()
        # after a gap the force grows from zero, by no more than in any other tick
        most = 2 * np.linalg.norm(np.diff(path, axis=0), axis=1) + mine.options.slide * 1e-3
        again = np.flatnonzero(none[:-1] & ~none[1:])
        force = np.linalg.norm(seen.force[again + 1], axis=1)
        damped = 2 if material else 1  # damping at most doubles a spring's force
        assert (force <= damped * STIFFNESS * most[again] * (1 + 1e-9)).all()
        missed += none.sum()
        touched += ((seen.state[~none] & TOUCHING) > 0).sum()

        home = np.array([*CALM, 0.01])
        down = np.linspace(home, home - (0, 0, 0.013), 800)
        mine.follow(np.concatenate([np.linspace(path[-1], home, 2000), np.tile(home, (500, 1))]))
        pressed = mine.follow(down).force[-1]
        other.follow(np.tile(home, (500, 1)))
        assert pressed == pytest.approx(other.follow(down).force[-1], abs=0.02)
        assert pressed[2] > 0.5
    assert missed > 500
    assert touched > 2000
