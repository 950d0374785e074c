"""The evaluation of a mesh, called as a function: no Snakemake, no file."""

import numpy as np
import pytest

from pandis.base.errors import PandisError
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.geometry.trajectories import trace
from pandis.pipeline.judge.controls import ControlGap
from pandis.pipeline.judge.errors.comparison import compare
from pandis.pipeline.kinds.field import ExactField, Field
from pandis.pipeline.kinds.opening import Fields
from pandis.pipeline.run.ask.options import TrajectoryOptions
from pandis.pipeline.run.ask.tasks import EvaluateTask
from pandis.pipeline.run.job.stage import silent_progress

BODY = Body(*SHAPES["torus"].tessellation(60, 30), shape="torus")
EXACT = ExactField("exact", BODY)


class Soft(Field):
    """Pushes with 0.9 of the force."""

    def __init__(self):
        super().__init__("soft", EXACT.frame, 12)

    def answer(self, points):
        distance, normal = EXACT.answer(points)
        return 0.9 * distance, normal


def compared(fields, **options):
    path = TrajectoryOptions(samples=300)
    names = [field.name for field in fields]
    task = EvaluateTask(probes=2000, **options, trajectory=path, fields=names, seed=3)
    drawn, _ = trace(BODY, path, 3, progress=silent_progress)
    return compare(Fields(fields, BODY, EXACT), drawn, task, progress=silent_progress)


def test_a_field_that_is_a_tenth_too_soft_has_a_tenth_of_the_force_as_its_error():
    arrays, attributes = compared([EXACT, Soft()])
    assert attributes["fields"] == ["exact", "soft"]
    for found in attributes["errors"].values():
        assert found["exact"]["mean"] == 0
    for name in ("contact-deep", "contact-shallow"):
        assert attributes["errors"][name]["soft"]["relative"] == pytest.approx(0.1, rel=1e-6)
        assert attributes["errors"][name]["soft"]["missing"] == 0
    assert attributes["newtons"] == pytest.approx(400 * 0.1 / 1.8)
    assert arrays["view_error_soft"].max() > 0 == arrays["view_error_exact"].max()
    assert np.allclose(arrays["force_soft"], 0.9 * arrays["exact_force"])
    assert {"control-zero", "control-gap", "control-thin"} == set(attributes["controls"])


def test_several_paths_have_their_errors_each():
    _, attributes = compared([EXACT, Soft()], paths=3)
    assert attributes["count"] == 3
    assert attributes["paths"]["soft"]["mean"] > attributes["paths"]["exact"]["mean"] == 0


def test_a_blind_measure_ends_it(monkeypatch):
    monkeypatch.setattr(ControlGap, "answer", lambda self, points: self.exact.answer(points))
    with pytest.raises(PandisError, match="missing surface is blind.*control-gap"):
        compared([EXACT])
