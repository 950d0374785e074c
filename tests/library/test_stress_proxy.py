"""The stress suite through a proxy: every question fails what is wrong in one place only."""

import numpy as np
import pytest

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.judge.stress import suite as suites
from pandis.pipeline.judge.stress.proxy import Felt, nothing
from pandis.pipeline.judge.stress.suite import PROXY_QUESTIONS, Suite, failures, stress
from pandis.pipeline.kinds.exported import ExportedField
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.kinds.native import export_native
from pandis.pipeline.run.ask.options import NativeOptions
from pandis.pipeline.run.job.stage import silent_progress
from test_stress import FRAME, OPTIONS, SCALE, Exact


@pytest.fixture(scope="module")
def ball():
    vertices, faces = SHAPES["sphere"].tessellation()
    return Body(vertices, faces, FRAME, shape="sphere")


@pytest.fixture(scope="module")
def sphere(ball):
    return Suite(ball, SCALE, OPTIONS, seed=0)


@pytest.fixture(scope="module")
def field(ball):
    exact = ExactField("exact", ball)
    return ExportedField(
        "exact", export_native(exact, ball, NativeOptions(), provenance={}, log=lambda text: None)
    )


def cap(points):
    """Tell which points lie over a hundredth of the sphere."""
    return points[:, 2] > 0.98 * np.linalg.norm(points, axis=1)


def soft(path, steps):
    """It holds two fifths, on a cap."""
    force = np.where(cap(path)[:, None], 0.4 * steps.force, steps.force)
    return steps._replace(force=force)


def creeping(path, steps):
    """Friction lets a proxy on a cap go by two micrometres a tick."""
    step = np.where(cap(path), 2e-6 * SCALE.metre, 0.0)
    return steps._replace(proxy=steps.proxy + np.cumsum(step)[:, None] * [1.0, 0.0, 0.0])


def late(path, steps):
    """The force comes ten ticks late: what it pushes on the way out is more than on the way in."""
    return steps._replace(force=np.roll(steps.force, 10, axis=0))


def through(path, steps):
    """The surface lets the proxy through on the cap."""
    there = cap(path) & (np.linalg.norm(path, axis=1) < 0.9)
    return steps._replace(proxy=np.where(there[:, None], path, steps.proxy))


def kick(path, steps):
    """One force in a long way is a newton more than those before and after."""
    force = steps.force.copy()
    force[len(force) // 2] += [1.0, 0, 0]
    return steps._replace(force=force)


def no_number(path, steps):
    """One force in a long way is no number."""
    force = steps.force.copy()
    force[len(force) // 2] = np.nan
    return steps._replace(force=force)


WRONG = {
    "soft": (soft, {"holds"}), "creeping": (creeping, {"holds"}), "late": (late, {"keeps"}),
    "through": (through, {"stays"}), "kick": (kick, {"stays"}), "no_number": (no_number, {"stays"}),
}  # fmt: skip


@pytest.mark.slow
def test_the_exact_sphere_passes_everything(sphere, field):
    _, attributes = stress([field], [], sphere, count=1, progress=silent_progress)
    assert attributes["proxies_failed"] == {"exact": []}
    rows = attributes["proxies"]["exact"]
    assert list(rows) == list(PROXY_QUESTIONS)
    assert rows["holds"]["soft"] == rows["holds"]["creeps"] == 0
    assert abs(rows["keeps"]["push_n"]) < 1e-3
    assert rows["stays"]["deepest_mm"] < 1e-6
    for name, question in PROXY_QUESTIONS.items():
        assert question.says(rows[name])
        assert question.figure in rows[name]


@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_wrong_in_one_place_fails(sphere, field, wrong):
    spoil, missed = WRONG[wrong]
    follow = Felt.of(field, SCALE)
    answers = sphere.feel(lambda path, *given: spoil(path, follow(path, *given)), 0.0)
    assert set(failures(answers)) >= missed


def test_what_holds_nothing_fails_and_a_suite_that_lets_it_pass_ends_its_stage(
    sphere, field, monkeypatch
):
    assert {"holds", "stays"} <= set(failures(sphere.feel(nothing, 0.0)))
    monkeypatch.setattr(suites, "nothing", Felt.of(field, SCALE))
    with pytest.raises(Exception, match="the stress suite of proxies is blind"):
        stress([], [], sphere, count=1, progress=silent_progress)


def test_fields_without_a_proxy_are_not_asked_for_it(sphere):
    assert sphere.touch(Exact()) == {}
    _, attributes = stress([], [], sphere, count=1, progress=silent_progress, proxies=False)
    assert attributes["proxies"] == {}
