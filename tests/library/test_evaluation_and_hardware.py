import json
import os

import numpy as np
import pytest

from pandis.base.errors import PandisError
from pandis.base.frame import UNIT, Frame
from pandis.base.physical import Scale
from pandis.pipeline.geometry.measure import SETS, ContactSet
from pandis.pipeline.geometry.shares import Probes
from pandis.pipeline.judge.errors.errors import UNNORMALISED, evaluate, statistics
from pandis.pipeline.judge.servo.load import busy_cores
from pandis.pipeline.judge.servo.ticks import _longest_run, validate
from pandis.pipeline.judge.servo.validation import NO_ATTACHED
from pandis.pipeline.judge.timing.timing import summarise, time_queries
from pandis.pipeline.kinds.field import Field
from pandis.pipeline.report.tables import COLUMNS, summary_rows, to_csv
from pandis.pipeline.run.ask.options import HardwareOptions, TimingOptions
from pandis.pipeline.run.job.machine import describe
from pandis.pipeline.run.job.stage import TimedReport, silent_progress
from pandis.pipeline.run.records.evaluation import EvaluationRecord, Figures
from pandis.pipeline.run.records.stress import StressRecord
from pandis.pipeline.run.records.timing import TimingRecord
from pandis.runtime.field import NativeField
from pandis.runtime.field.constants import SHAPE
from pandis.runtime.field.files import Parts, pack
from pandis.runtime.servo import run_ticks
from verdicts import SOUND, WHOLE, changed, validated

FRAME = Frame((0.0, 0.0, 0.0), 0.5)


def test_statistics_by_hand():
    exact = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 0], [0, 0, 2.0]])
    force = np.array([[0.0, 1, 0], [0, 1.0, 0], [0, 0, 0], [0, 0, 1.0]])
    found = statistics(force, exact)
    root = np.sqrt(2)
    assert found["mean"] == pytest.approx((root + 1) / 4)
    assert found["rms"] == pytest.approx(np.sqrt(3 / 4))
    assert found["max"] == pytest.approx(root)
    assert found["eq7"] == pytest.approx(root / 1 + 1 / 4)
    assert found["angle"] == pytest.approx(90 / 3)
    assert statistics(exact, exact)["mean"] == statistics(exact, exact)["angle"] == 0


class Plane(Field):
    """A half-space z < 0, off by ``shift``; Ψ has length ``stretch``."""

    def __init__(self, name, shift=0.0, stretch=None):
        super().__init__(name, FRAME, 12)
        self.shift, self.stretch = shift, stretch
        if stretch:
            self.keeps_length = True

    def answer(self, points):
        return points[:, 2] + self.shift, np.tile([0.0, 0, 1], (len(points), 1))

    def direction(self, points):
        distance, normal = self.answer(points)
        return distance, self.stretch * normal


def truth(count=50):
    points = np.random.default_rng(0).uniform(-1, 1, (count, 3))
    return points, *Plane("exact").answer(points)


def contacts(count=50):
    """A contact set of the half-space, at 20 N per unit of force."""
    points = np.random.default_rng(1).uniform(-0.04, 0, (count, 3))
    answers, nowhere = Plane("exact").answer(points), np.zeros(count, bool)
    probes = Probes(points, *answers, nowhere, Scale(0.09, 400.0), Unchecked())
    return ContactSet(dict.fromkeys(SETS, probes), probes, 0.0)


class Unchecked:
    """The half-space as an exact distance."""

    def distance_and_normal(self, points, check):
        return Plane("exact").answer(points)


def test_evaluation_rows_and_forces():
    fields = [Plane("exact"), Plane("off", -0.01), Plane("net", stretch=2.0)]
    arrays, attributes = evaluate(
        fields,
        [],
        truth(),
        probe_sets={"shallow": truth(20)},
        contacts=contacts(),
        progress=silent_progress,
    )
    errors = attributes["errors"]["trajectory"]
    assert errors["exact"]["max"] == errors["net"]["max"] == 0
    inside = truth()[1] < 0
    assert errors["off"]["mean"] == pytest.approx(0.01 * inside.mean(), abs=1e-3)
    kept = errors["net" + UNNORMALISED]["mean"]
    assert kept == pytest.approx(attributes["mean_force"]["trajectory"])
    assert np.array_equal(arrays["force_exact"], arrays["exact_force"])
    assert set(attributes["bytes"]) == {"exact", "off", "net"}
    # on the contact set: with the shares of surface, in newtons, and of Ψ as it is too
    table = attributes["errors"]["contact-deep"]
    assert table["exact"]["mean"] == table["exact"]["missing"] == 0
    assert table["off"]["newtons"] == pytest.approx(20 * 0.01, rel=0.5)
    assert table["net" + UNNORMALISED]["relative"] == pytest.approx(1)
    assert attributes["errors"]["trajectory"]["off"]["felt"] > 0


def test_a_measure_that_passes_a_control_ends_the_stage():
    with pytest.raises(PandisError, match="missing surface is blind"):
        evaluate(
            [],
            [Plane("control-blind")],
            truth(),
            probe_sets={},
            contacts=contacts(),
            progress=silent_progress,
        )


def test_timing_counts_every_query():
    calls = []

    def answer(points):
        calls.append(len(points))

    options = TimingOptions(queries=150, batch=500, repeats=3)
    points = np.zeros((40, 3))
    single, batched = time_queries(
        answer, points, options.queries, batch=options.batch, repeats=options.repeats
    )
    assert (len(single), len(batched)) == (150, 3)
    assert calls.count(1) == 100 + 150
    assert calls.count(500) == 1 + 3
    found = summarise(single, batched)
    assert 0 < found["one_p50_us"] <= found["one_p99_us"] <= found["one_p999_us"]


@pytest.fixture(scope="module")
def sphere():
    """A sphere of radius 1 as `pandis.h` answers it."""
    return NativeField(pack(UNIT, Parts(SHAPE, [0], [1.0], {}), {}))


PATH = np.linspace([0.0, 0.0, 0.95], [0.3, 0.4, 0.8], 5)


def test_clock_ticks_once_per_point_in_order_and_never_early(sphere):
    run = run_ticks(sphere, PATH, 23, rate=2000)
    assert np.array_equal(run.force, sphere.force(PATH)[np.arange(23) % 5])
    assert (run.compute >= 0).all()
    assert (run.lateness >= 0).all()
    alone = run_ticks(None, PATH, 23, rate=2000)
    assert not alone.force.any()
    assert (alone.lateness >= 0).all()


def test_other_work_ends_with_the_body():
    with busy_cores() as cores:
        assert cores >= 1
        children = children_now()
        assert len(children) >= cores
    assert not set(children) & set(children_now())


def children_now():
    """Return the process numbers of this process's children."""
    path = f"/proc/self/task/{os.getpid()}/children"
    if not os.path.exists(path):
        pytest.skip("this system does not list children")
    with open(path) as stream:
        return stream.read().split()


def run(sphere, bias=0.0, missing=0.0, **options):
    options = HardwareOptions(seconds=0.05, loaded_seconds=0.02, **options)
    frame = Frame((0.0, 0.0, 0.0), 0.5)
    reference = sphere.force(PATH) * frame.scale + [0, 0, bias]
    walls = changed(WHOLE, missing=missing, holds=missing < 0.005)
    return validate(sphere, frame, PATH, reference=reference, walls=walls, options=options)


def test_validation_passes_what_agrees_and_fails_what_does_not(sphere):
    arrays, verdict = run(sphere, misses=0.9)
    assert verdict.agrees
    assert verdict.agreement < 1e-12
    assert len(arrays["compute"]) == verdict.ticks == 50
    assert verdict.loaded.ticks == 20
    _, verdict = run(sphere, bias=-0.01, misses=0.9)
    assert not verdict.agrees
    assert verdict.verdict == "fail"
    assert "differ from the evaluated ones by" in verdict.sentence
    _, verdict = run(sphere, missing=0.02, misses=0.9)
    assert verdict.verdict == "fail"
    assert "on 2.00% of the surface the force is missing" in verdict.sentence


def test_validation_counts_misses(sphere):
    _, verdict = run(sphere, deadline=1e-12)
    assert verdict.misses == verdict.longest_run_of_misses == 50
    assert not verdict.in_time
    assert not verdict.punctual  # no tick begins within a picosecond
    assert verdict.verdict == "fail"
    missed = np.array([1, 0, 1, 1, 1, 0, 1, 1], bool)
    assert _longest_run(missed) == 3
    assert _longest_run(missed[1:2]) == 0


def test_machine_is_described_without_its_name():
    import socket

    text = json.dumps(describe())
    assert socket.gethostname() == "" or f'"{socket.gethostname()}"' not in text
    assert "No haptic device was attached" in NO_ATTACHED


def test_summary_has_every_column_and_the_configs_order():
    errors = Figures(**dict.fromkeys(("mean", "rms", "p95", "p99", "max", "eq7", "angle"), 0.5))
    table = {"b": errors, "a": errors, "a" + UNNORMALISED: errors}
    keys = ("mean", "p99", "max", "relative", "newtons", "judged", "felt", "strongly_felt")
    contact = Figures(**dict.fromkeys(keys, 0.25), missing=0.001)
    evaluation = EvaluationRecord.model_construct(
        fields=["b", "a"],
        errors=dict.fromkeys(("trajectory", "shallow", "deep"), table),
        bytes={"a": 1, "b": 2},
        newtons=2.0,
        contact={"left_out": 0.0},
        mean_force={"trajectory": 2.0},
        controls={"control-zero": dict.fromkeys(SETS, changed(contact, missing=1.0))},
    )
    for name in SETS:
        evaluation.errors[name] = {"a": contact, "b": contact}
    times = {
        "native_p50_us": 0.5,
        "native_p999_us": 0.6,
        "one_p50_us": 1.0,
        "one_p99_us": 2.0,
        "one_p999_us": 2.5,
        "batch_us": 3.0,
    }
    timing = TimingRecord(fields={"a": times}, machine={})
    jumps = {"mm01_max": 0.5, "mm01_rms": 0.1}
    ghosts = {"ghosts": 0.01, "largest_n": 0.2}
    stress = StressRecord.model_construct(
        fields={"a": {"jumps": jumps, "contacts": ghosts}},
        failed={"a": []},
        controls={"control-zero": ["missing"]},
    )
    records = evaluation, timing, stress, validated({"a": SOUND})
    rows = summary_rows("m", records, {"b": 1.5})
    assert [row["field"] for row in rows] == ["b", "a", "a" + UNNORMALISED]
    lines = to_csv(rows).splitlines()
    assert lines[0] == ",".join(COLUMNS)
    assert lines[2].endswith("0.5,0.1,1,0.2,0,yes,4,0,pass")
    assert rows[0]["trajectory_millinewtons"] == pytest.approx(1000)
    assert rows[0]["trajectory_percent"] == pytest.approx(25)
    assert rows[0]["contact_millinewtons"] == rows[0]["contact_mean"] * 1000 == 250
    assert rows[0]["contact_percent"] == 25
    assert rows[0]["missing_percent"] == pytest.approx(0.1)
    # what is off by rounding is exact
    for name in SETS:
        evaluation.errors[name]["b"] = changed(contact, mean=3e-17, newtons=6e-16)
    (exact, *_) = summary_rows("m", records, {})
    assert exact["contact_millinewtons"] == exact["contact_mean"] == 0
    assert exact["missing_percent"] == pytest.approx(0.1)
    stress.controls["control-zero"] = []
    evaluation.controls["control-zero"] = dict.fromkeys(SETS, contact)
    with pytest.raises(PandisError, match="front of unbeaten fields is blind.*control-zero"):
        summary_rows("m", records, {})


def test_a_field_that_needs_a_path_is_judged_on_the_path_alone():
    class Path(Plane):
        ordered = True

    sets = {"shallow": truth(20), "deep": truth(20)}
    fields = [Plane("exact"), Path("path", -0.01)]
    _, attributes = evaluate(
        fields, [], truth(), probe_sets=sets, contacts=contacts(), progress=silent_progress
    )
    assert "path" in attributes["errors"]["trajectory"]
    assert "path" not in attributes["errors"]["shallow"]
    more = {
        "coverage": {},
        "paths": {},
        "size": 0.1,
        "stiffness": 400.0,
        "newtons": 1.0,
        "count": 1,
    }
    nothing = StressRecord.model_construct(fields={}, controls={}), validated({})
    timing = TimingRecord(fields={}, machine={})
    rows = summary_rows("m", [EvaluationRecord(**attributes, **more), timing, *nothing], {})
    assert [row["shallow_mean"] for row in rows] == [0, ""]


def test_progress_reports_rate_and_what_is_left(monkeypatch):
    now = [0.0]
    monkeypatch.setattr("pandis.pipeline.run.job.stage.time.monotonic", lambda: now[0])
    lines = []
    progress = TimedReport(lines.append, "labels", 1000, unit="points")
    for second, done in ((1, 100), (6, 600), (7, 700), (10, 1000)):
        now[0] = second
        progress.update(done, "error 1")
    assert lines[0] == "labels: 600 of 1,000 points (60 %), 100/s, 4 s left, error 1"
    assert len(lines) == 2
    assert "(100 %)" in lines[1]
    progress = TimedReport(lines.append, "meshes", 70, unit="meshes")
    now[0] += 40
    progress.update(30)
    assert lines[2] == "meshes: 30 of 70 meshes (43 %), 0.75/s, 53 s left"
