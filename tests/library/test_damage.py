"""Fields that are wrong in one way only: suite and hardware must fail each."""

import numpy as np
import pytest

from damage import damages
from pandis.base.physical import Scale
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.judge.servo.walls import compare, faults, open_walls
from pandis.pipeline.judge.stress.suite import Suite, failures
from pandis.pipeline.kinds.exact.file import File
from pandis.pipeline.kinds.exported import ExportedField
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.run.ask.options import StressOptions
from pandis.pipeline.run.job.stage import silent_progress
from shapes import open_shape

SCALE = Scale(0.1, 400.0)
#: A ball with two fins of 0.4 mm: a third of the surface is a wall that holds 0.07 N.
SHAPE = "finned-ball"


@pytest.fixture(scope="module")
def body():
    return Body.open(open_shape(SHAPE).mesh)


@pytest.fixture(scope="module")
def damaged(body):
    return damages(body, body.surface, SCALE)


def edges_alone(name):
    """Tell which damage lies within the strips along convex edges, in which nothing is judged.

    Their share stands beside every verdict.
    """
    return name == "zero-thinnest-2%"


@pytest.mark.full
def test_hardware_fails_every_damage(body, damaged):
    walls = open_walls(ExactField("exact", body), SCALE, 0)
    exact = ExactField("exact", body)
    sound = compare(ExportedField("exact", File(exact, 32, 1 << 20).data({})), walls)
    assert sound.holds
    assert faults(sound) == []
    passed = {name for name, field in damaged.items() if compare(field, walls).holds}
    assert {name for name in passed if not edges_alone(name)} == set()
    assert len(damaged) >= 30


@pytest.mark.full
def test_the_suite_fails_every_damage(body, damaged):
    suite = Suite(body, SCALE, StressOptions(ticks=2000, loops=4), seed=0)
    exact = ExactField("exact", body)
    # the short questions: whatever they leave to the long ones is not found in time
    asked = ("missing", "other", "hold", "contacts", "work", "stiffness", "jumps")
    assert failures(suite.ask(exact, silent_progress, only=asked)) == []
    passed = {
        name
        for name, field in damaged.items()
        if not failures(suite.ask(field, silent_progress, first=True, only=asked))
    }
    assert {name for name in passed if not edges_alone(name)} == set()


@pytest.mark.slow
def test_a_proxy_feels_walls_without_force(body, damaged):
    """What lacks the force on thin walls lets a proxy through them."""
    suite = Suite(body, SCALE, StressOptions(ticks=2000, loops=4), seed=0)
    thin = suite.pushed.wall & (suite.pushed.radius < 0.01)
    assert thin.sum() > 50
    depth = 1e-3 * SCALE.stiffness
    assert (suite.exact_hold.push[thin] > 0.9 * depth).mean() > 0.95
    held = suite.feel(lambda path, material=None: _through(suite, path, material), 0.0)["holds"]
    assert not held["passed"]
    assert held["soft"] == pytest.approx(suite.pushed.weight[thin].sum(), abs=0.05)


def _through(suite, path, material):
    """Follow a path through a proxy that thin walls do not hold."""
    from pandis.pipeline.judge.stress.proxy import Felt, nothing

    exact = ExactField("exact", suite.body)
    follow = Felt.of(ExportedField("exact", File(exact, 32, 1 << 20).data({})), SCALE)
    low = np.linalg.norm(suite.pushed.feet - path[:60].mean(axis=0), axis=1).argmin()
    thin = suite.pushed.wall[low] and suite.pushed.radius[low] < 0.01
    return nothing(path, material) if thin else follow(path, material)
