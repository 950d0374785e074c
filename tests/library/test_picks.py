"""What the report says to use: the exact field and the best other one that may be used."""

import pytest

from pandis.pipeline.judge.errors.front import may_be_used
from pandis.pipeline.report.picks import picks
from pandis.pipeline.report.tables import COLUMNS
from verdicts import PRESSED, SOUND, WHOLE, changed, validated


def row(field, error, **changes):
    known = {"field": field, "bytes": 800_000, "stress": 0, "missing_percent": 0.0}
    known |= {"left_out_percent": 0.0}
    known |= {"contact_mean": error, "contact_millinewtons": 22e3 * error, "contact_percent": 3.4}
    return dict.fromkeys(COLUMNS, "") | known | {"native_p50_us": 0.5} | changes


def tried(*fields, light=300.0, **changes):
    device = changed(PRESSED, hands={"0.3": light, "1": 700.0, "3.0": 200.0})
    sound = changed(SOUND, **({"devices": {"touch": device}} | changes))
    return validated(dict.fromkeys(fields, sound))


def test_the_exact_field_comes_first_and_then_the_best_that_may_be_used():
    rows = [row("exact", 0.0), row("spline-auto", 5e-4), row("best", 1e-4, stress=2)]
    rows += [row("hollow", 2e-4, missing_percent=0.7), row("no-file", 1e-5), row("worse", 9e-4)]
    assert [may_be_used(one) for one in rows] == [True, True, False, False, True, True]
    hardware = tried("exact", "spline-auto", "best", "hollow", "worse")
    found = picks(rows, hardware, "results/part")
    assert [one["field"] for one in found] == ["exact", "spline-auto"]
    assert found[1]["file"] == "results/part/export/spline-auto.pandis"
    assert found[1]["error"] == "11 mN (3.4 % of the force)"
    assert found[1]["size"] == "800 KB"


@pytest.mark.parametrize(
    ("exact", "other", "why"),
    [
        ({"bytes": 9_000_000}, {}, "Or, if that is too large,"),
        ({"native_p50_us": 0.8}, {}, "Or, if that is too slow,"),
        ({"bytes": 0}, {"native_p50_us": 0.7}, "Of the others the best is"),
    ],
)
def test_the_second_field_is_not_said_to_be_what_it_is_not(exact, other, why):
    rows = [row("exact", 0.0, **exact), row("spline-auto", 5e-4, **other)]
    found = picks(rows, tried("exact", "spline-auto"), "x")
    assert [one["why"] for one in found] == ["Use", why]
    assert (found[0]["size"] == "under 1 KB") == (rows[0]["bytes"] == 0)


def test_what_is_safe_is_what_an_armed_device_goes_by():
    """The lightest hand that was tried, not the worst: attached runs take 0.7 of that."""
    (found,) = picks([row("exact", 0.0)], tried("exact"), "x")
    assert found["stiffness"] == 300
    assert "at most 0.7" in found["safe"]
    (found,) = picks([row("exact", 0.0)], tried("exact", devices={}), "x")
    assert found["safe"] == "No device was simulated."


def test_nothing_is_recommended_where_nothing_may_be_used():
    """Nor a field without force, were nothing of the surface thick enough to be judged."""
    assert picks([row("best", 1e-4, stress=1)], tried("best"), "x") == []
    rows = [row("nearest-32", 0.0, missing_percent=100.0), row("exact", 0.0)]
    (found,) = picks(rows, tried("nearest-32", "exact"), "x")
    assert found["field"] == "exact"


def test_an_auto_that_has_come_to_the_mesh_is_no_approximate_field():
    rows = [row("exact", 0.0), row("auto", 0.0, native_p50_us=0.4), row("spline-auto", 5e-4)]
    found = picks(rows, tried("exact", "auto", "spline-auto"), "x")
    assert [one["field"] for one in found] == ["exact", "spline-auto"]
    found = picks(rows[1:], tried("auto", "spline-auto"), "x")
    assert [one["field"] for one in found] == ["auto", "spline-auto"]


@pytest.mark.parametrize(
    "fault",
    [
        {"agrees": False},
        {"in_time": False},
        {"walls": changed(WHOLE, holds=False)},
        {"light": 0.0},
        {"devices": {"touch": PRESSED, "other": changed(PRESSED, holds=False)}},
        {"devices": {"touch": PRESSED, "other": changed(PRESSED, pressed_missing=1)}},
        {"devices": {"touch": PRESSED, "other": changed(PRESSED, hands={"0.3": 0.0})}},
    ],
)
def test_a_file_is_judged_by_itself_whatever_its_field_passes(fault):
    """What was evaluated passes, and in the loop the file lacks force, or is safe nowhere."""
    assert picks([row("spline-auto", 5e-4)], tried("spline-auto"), "x")
    assert picks([row("spline-auto", 5e-4)], tried("spline-auto", **fault), "x") == []
