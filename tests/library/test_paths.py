"""Errors over several trajectories: means, intervals, and what is said of them."""

import numpy as np
import pytest
from scipy import stats

from pandis.evaluation.paths import interval, over_paths, verdict
from pandis.fields.base import Field
from pandis.frame import Frame

NORMAL = np.array([0.0, 0.0, 1.0])


class Plane(Field):
    """Space below z = 0, its surface moved."""

    def __init__(self, name, moved):
        super().__init__(name, Frame((0.0, 0.0, 0.0), 1.0), 0)
        self.moved = moved

    def answer(self, points):
        return points[:, 2] - self.moved, np.tile(NORMAL, (len(points), 1))


def path(depth, count=50):
    points = np.zeros((count, 3))
    points[:, 2] = -depth
    return points, points[:, 2], np.tile(NORMAL, (count, 1))


def test_means_and_intervals_are_those_of_the_paths():
    fields = [Plane("exact", 0.0), Plane("trilinear-64", 0.01), Plane("pandis", 0.2)]
    # the second loses the contact on shallow paths: its error is their depth then
    paths = [path(depth) for depth in (0.02, 0.03, 0.05, 0.008)]
    table = over_paths(fields, paths)
    assert table["exact"] == {"mean": 0, "interval": 0, "ratio": 0, "ratio_interval": 0}
    assert table["trilinear-64"]["mean"] == pytest.approx(0.01)
    assert table["trilinear-64"]["ratio"] == 1
    assert table["pandis"]["ratio"] == pytest.approx(20)
    values = np.array([1.0, 2.0, 4.0, 9.0])
    low, high = stats.t.interval(0.95, 3, values.mean(), stats.sem(values))
    assert interval(values) == pytest.approx((high - low) / 2)


def test_without_the_baseline_there_are_no_ratios():
    table = over_paths([Plane("pandis", 0.1)], [path(0.1), path(0.2)])
    assert set(table["pandis"]) == {"mean", "interval"}
    assert verdict(table, ["pandis"]) == ""


@pytest.mark.parametrize(
    ("ratio", "said"), [(0.7, "less than"), (0.97, "about as much as"), (1.3, "more than")]
)
def test_the_verdict_is_about_the_interval(ratio, said):
    table = {"pandis": {"ratio": ratio, "ratio_interval": 0.05}}
    assert verdict(table, ["pandis", "other"]) == (
        f"pandis errs {said} trilinear-64: {ratio:.2f} ± 0.05 times."
    )
