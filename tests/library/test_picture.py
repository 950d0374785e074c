"""Figures of the page: labels in plain characters, the same bytes each time."""

from urllib.parse import unquote

import pytest
from matplotlib.figure import Figure

from pandis.pipeline.report.picture import save


def drawn(low, high):
    figure = Figure(figsize=(4, 3), layout="constrained")
    axes = figure.add_subplot()
    axes.loglog([low, high], [low, high])
    axes.set_xlabel("time")
    return save(figure, {"time": [low, high]})


@pytest.mark.parametrize(
    ("low", "high", "labels"),
    [
        (1e-3, 1e4, ("10⁻²", "10⁰", "10³")),
        (0.0217, 0.0241, ("2.2×10⁻²", "2.4×10⁻²")),  # less than a decade
    ],
)
def test_powers_of_ten_are_text(low, high, labels):
    svg = unquote(drawn(low, high).svg)
    for label in labels:
        assert f">{label}</text>" in svg
    assert "mathdefault" not in svg


def test_a_figure_has_the_same_bytes_each_time():
    assert drawn(1e-3, 1e4) == drawn(1e-3, 1e4)
    assert drawn(1e-3, 1e4).csv.splitlines() == ['"time"', "0.001", "10000"]
