"""Which field to use: against what one would find by looking at every pair."""

import numpy as np
import pytest

from pandis.pipeline.judge.errors.front import ERRORS, PRICES, pareto, recommend
from pandis.pipeline.kinds.paper.spec import PLANES
from pandis.pipeline.report.figures import colour
from pandis.pipeline.run.ask.catalogue import SIZED, parse_field

KEYS = ("contact_percent", *PRICES)
#: What may be used: nothing failed, nothing missing.
GOOD = {"stress": 0, "missing_percent": 0.0, "left_out_percent": 0.0}


def table(seed, count=40):
    rng = np.random.default_rng(seed)
    values = rng.integers(0, 12, (count, len(KEYS))).astype(float)
    rows = [
        dict(zip(KEYS, row, strict=True)) | GOOD | {"field": f"f{k}"}
        for k, row in enumerate(values)
    ]
    for row in rows[::7]:
        row["native_p50_us"] = ""  # not timed
    return rows


@pytest.mark.parametrize("seed", range(5))
def test_no_row_beats_one_of_the_front_and_one_of_it_beats_every_other(seed):
    rows = table(seed)
    known = [row for row in rows if "" not in row.values()]
    front = [row for row, unbeaten in zip(rows, pareto(rows, KEYS), strict=True) if unbeaten]
    assert front

    def beats(one, other):
        pairs = [(one[key], other[key]) for key in KEYS]
        return all(a <= b for a, b in pairs) and any(a < b for a, b in pairs)

    assert not any(beats(one, other) for other in front for one in known)
    for row in known:
        assert row in front or any(beats(one, row) for one in front)
    assert all("" not in row.values() for row in front)


@pytest.mark.parametrize("seed", range(5))
def test_what_is_recommended_meets_the_error_and_nothing_that_does_costs_less(seed):
    rows = table(seed)
    advice = recommend(rows)
    assert [pick["percent"] for pick in advice] == sorted(pick["percent"] for pick in advice)
    assert {pick["percent"] for pick in advice} <= set(ERRORS)
    for pick in advice:
        good = [row for row in rows if row["contact_percent"] <= pick["percent"]]
        for key, name in PRICES.items():
            prices = [row[key] for row in good if row[key] != ""]
            assert (pick[name] is None) == (not prices)
            if prices:
                assert pick[name][key] == min(prices)
                assert pick[name] in good


def test_equal_rows_are_both_unbeaten_and_the_unmeasured_are_not_compared():
    rows = [{"a": 1, "b": 2}, {"a": 1, "b": 2}, {"a": 2, "b": 2}, {"a": 0, "b": ""}]
    rows = [row | GOOD for row in rows]
    assert pareto(rows, ("a", "b")) == [True, True, False, False]


def test_nothing_is_recommended_where_nothing_is_good_enough():
    row = dict.fromkeys(KEYS, 1.0) | GOOD | {"contact_percent": 50.0, "field": "x"}
    assert recommend([row | {"stress": 1}]) == []
    # a large error is no fault: where any is allowed, it is there
    (pick,) = recommend([row])
    assert pick["percent"] == float("inf")


@pytest.mark.parametrize(
    "fault",
    [
        {"stress": 1},
        {"stress": ""},
        {"missing_percent": 0.51},
        {"missing_percent": ""},
        {"left_out_percent": 0.51},
    ],
)
def test_what_failed_a_question_or_lacks_surface_is_neither_unbeaten_nor_recommended(fault):
    good = dict.fromkeys(KEYS, 2.0) | GOOD | {"field": "good"}
    bad = dict.fromkeys(KEYS, 1.0) | GOOD | {"field": "bad"} | fault
    assert pareto([good, bad], KEYS) == [True, False]
    assert {pick["fastest"]["field"] for pick in recommend([good, bad])} == {"good"}


def test_every_kind_of_field_has_a_colour():
    recipes = {"pandis"}
    names = ["exact", "auto", "salisbury", "kim-algebraic-64", "pandis", *PLANES]
    names += [f"{form}-{16 if form == 'compact' else 64}" for form in SIZED]
    colours = [colour(parse_field(name, recipes), ["pandis"]) for name in names]
    assert all(c.startswith("#") for c in colours)
    assert len(set(colours)) == len(colours)
