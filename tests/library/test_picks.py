"""What the report says to use: the exact field and the best other one that may be used."""

from pandis.evaluation.front import may_be_used
from pandis.geometry.frame import Frame
from pandis.report.page import build, newtons_per_unit
from pandis.report.picks import picks
from pandis.report.tables import COLUMNS


def row(field, error, **changes):
    known = {"field": field, "bytes": 800_000, "stress": 0, "missing_percent": 0.0}
    known |= {"contact_mean": error, "contact_millinewtons": 22e3 * error, "contact_percent": 3.4}
    return dict.fromkeys(COLUMNS, "") | known | {"native_p50_us": 0.5} | changes


def tried(*fields, light=300.0):
    hands = {"0.3": light, "1": 700.0, "3.0": 200.0}
    return {"fields": {field: {"devices": {"touch": {"hands": hands}}} for field in fields}}


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


def test_what_is_safe_is_what_an_armed_device_goes_by():
    """The lightest hand that was tried, not the worst: attached runs take 0.7 of that."""
    (found,) = picks([row("exact", 0.0)], tried("exact"), "x")
    assert found["most"] == "300 N/m"
    (found,) = picks([row("exact", 0.0)], tried("exact", light=0.0), "x")
    assert "At no stiffness" in found["safe"]


def test_nothing_is_recommended_where_nothing_may_be_used():
    assert picks([row("best", 1e-4, stress=1)], tried("best"), "x") == []


def test_the_stiffness_in_mesh_units_is_a_number_in_c():
    device = {"size": 0.1, "stiffness": 400.0}
    small = newtons_per_unit(device, Frame((0.0, 0.0, 0.0), 1.8 / 0.03))  # 3 cm in metres
    assert f"{small:.6g}" == "1333.33"
    large = newtons_per_unit(device, Frame((0.0, 0.0, 0.0), 1.8 / 100))  # 100 mm
    assert f"{large:.6g}" == "0.4"
    assert "<h1>" in build([])
