"""The paper's tables: our figures beside the printed ones, and nothing where there are none."""

import json
from types import SimpleNamespace

import pytest

from pandis.pipeline.kinds.network.record import ModelRecord
from pandis.pipeline.report.builds import build_seconds
from pandis.pipeline.report.paper import METHODS, tables
from pandis.pipeline.run.records.evaluation import EvaluationRecord, Figures
from pandis.pipeline.run.records.mesh import MeshRecord
from pandis.pipeline.run.records.timing import TimingRecord


def section(name, fields):
    errors = {
        f: Figures.model_construct(mean=0.002 * (k + 1), eq7=0.01) for k, f in enumerate(fields)
    }
    times = {"native_p50_us": 0.54, "one_p50_us": 12.0, "cold_p50_us": 34.0}
    rows = [
        {"field": f, "bytes": 2048 * k, "trajectory_mean": errors[f].mean}
        for k, f in enumerate(fields)
    ]
    contact = {
        f: Figures.model_construct(mean=15 * e.mean, missing=0.01) for f, e in errors.items()
    }
    options = {"loss": "paper", "weighting": "subset"}
    network = ModelRecord.model_construct(steps=3000, device="cpu", options=options)
    return SimpleNamespace(
        name=name,
        mesh=MeshRecord.model_construct(after={"vertices": 1234, "faces": 5678}),
        rows=rows,
        evaluation=EvaluationRecord.model_construct(
            errors={"trajectory": errors, "contact-deep": contact},
            mean_force={"trajectory": 0.02},
            newtons=2.0,
        ),
        timing=TimingRecord(fields=dict.fromkeys([*fields, "exact-all-faces"], times), machine={}),
        models={f: network for f in fields if f.startswith("pandis")},
        builds=dict.fromkeys(fields, 3725.0),
    )


def test_every_table_has_the_papers_figure_beside_ours():
    fields = ["exact", "trilinear-box-64", "nearest-box-32", "pandis", "trilinear-64"]
    found = tables([section("bunny", fields)])
    titles = ["Table 1", "Table 2, above", "Table 2, below", "Table 3", "Table 4"]
    assert [table.title.split(":")[0] for table in found] == titles
    training, setup, space, times = ({r[0]: r for r in t.rows} for t in found[:4])
    assert training["bunny"][1:5] == ("35,947", "1,234", "69,451", "5,678")
    assert setup["NN-i 32³, own box"] == ("NN-i 32³, own box", "0:07:38", "1:02:05")
    assert setup["Tri-i 64³, cube"] == ("Tri-i 64³, cube", "", "1:02:05")  # not the paper's
    assert space["PANDIS"] == ("PANDIS", "800 KB", "6 KB")
    assert times["GT"] == ("GT", "13.851 ms", "0.54 µs", "12 µs", "34 µs")
    assert times["exact"] == ("exact", "", "0.54 µs", "12 µs", "34 µs")
    assert times["Tri-i 64³, cube"][1] == ""
    errors = {row[1]: row for row in found[-1].rows}
    assert list(errors) == [*METHODS.values(), "Tri-i 64³, cube"]
    trained = "weighting subset, 3,000 steps, 1 seed"
    row = ("bunny", "PANDIS", trained, 0.006, "0.00800", "0.23", "2.00", "0.80", "240", "1")
    assert errors["PANDIS"] == (*row, "0.0100")
    assert errors["NN-i 64³, own box"][4] == ""  # not among the fields
    assert errors["Tri-i 64³, cube"][3] == errors["Tri-i 64³, cube"][5] == ""
    for table in found:
        assert {len(row) for row in table.rows} == {len(table.heads)}


def test_networks_trained_alike_share_a_row_with_an_interval():
    fields = ["exact", "trilinear-box-64", "pandis", "pandis-b", "pandis-c"]
    one = section("bunny", fields)
    rows = {row[1]: row for row in tables([one])[-1].rows}
    assert "pandis-b" not in rows
    trained, mean = rows["PANDIS"][2], rows["PANDIS"][4]
    assert trained == "weighting subset, 3,000 steps, 3 seeds"
    assert mean == "0.00800 ± 0.00497"  # 6, 8 and 10e-3: 4.303 times 2e-3 / √3
    other = one.models["pandis-c"]
    options = other.options | {"weighting": "batch"}
    one.models["pandis-c"] = other.model_copy(update={"options": options})
    rows = {row[1]: row for row in tables([one])[-1].rows}
    assert rows["PANDIS"][2] == "weighting subset, 3,000 steps, 2 seeds"
    assert rows["pandis-c"][2] == "weighting batch, 3,000 steps, 1 seed"
    assert rows["pandis-c"][3] == ""


def test_rows_are_whole_where_meshes_have_different_fields():
    both = [section("bunny", ["exact", "pandis"]), section("dragon", ["exact", "spline-64"])]
    for table in tables(both):
        assert {len(row) for row in table.rows} == {len(table.heads)}


def test_other_meshes_have_no_such_tables():
    assert tables([section("gear", ["exact", "pandis"]), section("sphere", ["exact"])]) == []
    (sphere,) = tables([section("sphere", ["exact", "kim-100"])])
    assert sphere.rows[1] == ("kim-100", 0.367, "0.010000", "0.004000", "20.00")


def test_build_times_are_those_of_the_jobs(tmp_path):
    (tmp_path / "m").mkdir()
    jobs = {
        "bake-grid-force-32": 2.5,
        "bake-grid-spline-auto": 20,
        "train-pandis": 100,
        "choose": 7,
    }
    for name, seconds in {**jobs, "bake-method-support-planes": 3}.items():
        lines = [json.dumps({"s": s, "rule_name": "x"}) for s in (999.0, seconds)]
        (tmp_path / "m" / f"{name}.jsonl").write_text("\n".join(lines) + "\n")
    (tmp_path / "m" / "bake-grid-distance-64.jsonl").write_text("{")
    fields = ["exact", "nearest-32", "trilinear-32", "spline-auto", "pandis", "auto"]
    fields += ["support-planes", "tricubic-64", "trilinear-64", "salisbury-pandis"]
    assert build_seconds("m", fields, tmp_path) == pytest.approx(
        {"exact": 0, "nearest-32": 2.5, "trilinear-32": 2.5, "spline-auto": 20, "pandis": 100}
        | {"auto": 7, "support-planes": 3, "salisbury-pandis": 100}
    )  # what is damaged or missing is not told
