"""Errors over several trajectories: means, intervals, and what is said of them."""

import numpy as np
import pytest
from scipy import stats

from pandis.base.frame import UNIT
from pandis.pipeline.judge.errors.paths import interval, over_paths, repeats, verdict
from pandis.pipeline.kinds.field import Field
from pandis.pipeline.kinds.network.record import ModelRecord
from pandis.pipeline.run.records.evaluation import PathsRecord

NORMAL = np.array([0.0, 0.0, 1.0])


class Plane(Field):
    """Space below z = 0, its surface moved."""

    def __init__(self, name, moved):
        super().__init__(name, UNIT, 0)
        self.moved = moved

    def answer(self, points):
        return points[:, 2] - self.moved, np.tile(NORMAL, (len(points), 1))


def path(depth, count=50):
    points = np.zeros((count, 3))
    points[:, 2] = -depth
    return points, points[:, 2], np.tile(NORMAL, (count, 1))


def model(steps=600, **options):
    options = {"loss": "paper"} | options
    return ModelRecord.model_construct(options=options, steps=steps, device="cpu")


def known(**ratios):
    return PathsRecord(mean=0.01, interval=0.001, ratios=ratios)


def test_means_and_intervals_are_those_of_the_paths():
    fields = [Plane("exact", 0.0), Plane("trilinear-64", 0.01), Plane("pandis", 0.2)]
    fields.append(Plane("trilinear-box-64", 0.005))
    # the second loses the contact on shallow paths: its error is their depth then
    paths = [path(depth) for depth in (0.02, 0.03, 0.05, 0.008)]
    table = over_paths(fields, paths)
    none = dict.fromkeys(("trilinear-64", "trilinear-box-64"), 0)
    assert table["exact"] == PathsRecord(mean=0, interval=0, ratios=none)
    assert table["trilinear-64"].mean == pytest.approx(0.01)
    assert table["trilinear-64"].ratios["trilinear-64"] == 1
    assert table["pandis"].ratios == pytest.approx({"trilinear-64": 20, "trilinear-box-64": 40})
    values = np.array([1.0, 2.0, 4.0, 9.0])
    low, high = stats.t.interval(0.95, 3, values.mean(), stats.sem(values))
    assert interval(values) == pytest.approx((high - low) / 2)
    assert interval([6.184e-5] * 3) == 0


def test_without_the_baseline_there_are_no_ratios():
    table = over_paths([Plane("pandis", 0.1)], [path(0.1), path(0.2)])
    assert table["pandis"].ratios == {}
    assert verdict(table, {"pandis": model()}) == ""


def test_networks_that_differ_in_their_seed_alone_are_repeats():
    models = {"a": model(), "b": model(weighting="batch"), "c": model(), "d": model(steps=601)}
    assert repeats(models) == [["a", "c"], ["b"], ["d"]]


@pytest.mark.parametrize(
    ("ratios", "said"),
    [((0.7, 0.71, 0.72), "a smaller error than"), ((0.6, 0.9, 1.2), "about the same error as"),
     ((1.3, 1.31, 1.32), "a larger error than")],
)  # fmt: skip
def test_the_verdict_is_about_the_interval_over_seeds(ratios, said):
    names = ["pandis", "pandis-b", "pandis-c"]
    table = {n: known(**{"trilinear-64": r}) for n, r in zip(names, ratios, strict=True)}
    mean, half = np.mean(ratios), interval(ratios)
    assert verdict(table, dict.fromkeys([*names, "other"], model())) == (
        f"pandis, pandis-b, pandis-c have {said} trilinear-64: {mean:.2f} ± {half:.2f} times "
        "(3 trainings)."
    )


def test_of_one_training_nothing_is_said_of_others():
    table = {"pandis": known(**{"trilinear-box-64": 0.97, "trilinear-64": 0.77})}
    assert verdict(table, {"pandis": model()}) == (
        "pandis has 0.97 times the error of trilinear-box-64 (one training); "
        "pandis has 0.77 times the error of trilinear-64 (one training)."
    )
