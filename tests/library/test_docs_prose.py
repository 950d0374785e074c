"""Figures in prose: each that carries an expression must be what the measured figures give.

In the docs a figure is followed by a comment that says how it comes about, invisible to readers:
``0.81<!-- full.shallow(bunny, pandis-exact) / full.shallow(bunny, spline-auto) -->``. The first
word is a file of docs/figures, the second a column, the rest are cells that the one row meant
must have, in any column; of several rows that differ in their seed alone the mean counts, of
others the last.
"""

import csv
import re

import pytest

from support import ROOT

DOCS = ("docs/using.md", "docs/benchmarks.md", "docs/training.md", "docs/sphere.md")
FIGURE = re.compile(r"([\d,]*\.?\d+(?:e-?\d+)?)(?: ?%)?<!-- (.*?) -->")
TERM = re.compile(r"(\w+)\.(\w+)\(([^)]*)\)")


def cell(name, column, wanted):
    """Return a number of docs/figures."""
    path = ROOT / "docs/figures" / f"{name}.csv"
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    rows = [r for r in csv.DictReader(lines) if set(wanted) <= {*r.values()}]
    assert rows, f"{path} has no row with {wanted}"
    if "seed" not in rows[-1]:
        return float(rows[-1][column])
    kind = [
        key
        for key in ("mesh", "field", "what", "how", "weighting", "points", "steps")
        if key in rows[-1]
    ]
    assert len({tuple(row[key] for key in kind) for row in rows}) == 1, f"{wanted} is ambiguous"
    return sum(float(row[column]) for row in rows) / len(rows)


def value(expression):
    """Evaluate sums, differences, products and quotients of cells and numbers."""

    def number(match):
        name, column, cells = match.groups()
        return repr(cell(name, column, next(csv.reader([cells], skipinitialspace=True))))

    text = TERM.sub(number, expression)
    assert re.fullmatch(r"[\d.e+\-*/() ]+", text), f"cannot read {expression}"
    return eval(text, {"__builtins__": {}})


def agrees(shown, found):
    """Tell whether a figure is what was found, rounded to the digits shown."""
    plain = shown.replace(",", "")
    digits = len(plain.partition("e")[0].partition(".")[2])
    power = int(plain.partition("e")[2] or 0)
    return abs(float(plain) - found) <= 0.5001 * 10.0 ** (power - digits)


FOUND = [
    (doc, shown, expression)
    for doc in DOCS
    for shown, expression in FIGURE.findall((ROOT / doc).read_text(encoding="utf-8"))
]


def test_there_are_figures_with_their_origin():
    assert len(FOUND) >= 30


@pytest.mark.parametrize(("doc", "shown", "expression"), FOUND)
def test_a_figure_in_prose_is_what_was_measured(doc, shown, expression):
    found = value(expression)
    assert agrees(shown, found), f"{doc}: {shown} should be {found:.4g}: {expression}"


def test_a_wrong_figure_is_caught():
    assert agrees("0.81", 0.8149)
    assert not agrees("0.81", 0.816)
    assert agrees("1,200", 1199.6)
    assert not agrees("1,200", 1198)
    assert agrees("6e-5", 6.4e-5)
    assert not agrees("6e-5", 7e-5)
