"""Which jobs run after which change: the exact sets, through Snakemake's own dry run."""

import os
import shutil
from pathlib import Path

import pytest
import yaml

from pandis.base.errors import ConfigError, PandisError
from pandis.base.files import file_digest
from pandis.pipeline.run.plan.plan import Plan
from plans import (
    BOTH,
    DEPENDENT,
    EVERYTHING,
    FAST,
    FIELDS,
    LAST,
    all_of,
    change,
    graphs,
    native,
)
from support import ROOT, plan, snakemake


def test_fresh_plan_has_every_job_once(workspace):
    assert plan(workspace) == EVERYTHING
    assert len(EVERYTHING) + 1 <= 34  # with `all`


def test_finished_run_has_nothing_to_do(rerun):
    assert plan(rerun) == set()


def test_training_option_of_one_mesh(rerun):
    change(
        rerun,
        meshes={"torus": {"source": "analytic:torus", "train": {"pandis-exact": {"steps": 301}}}},
    )
    network = {("train", "torus", "pandis-exact")} | graphs("pandis-exact", meshes=["torus"])
    network |= native("pandis-exact", meshes=["torus"])
    assert plan(rerun) == network | all_of(*DEPENDENT, meshes=["torus"]) | LAST


def test_new_mesh(rerun):
    change(rerun, meshes={"box": {"source": "analytic:box"}})
    own = all_of("mesh", "sample", "trajectory", *DEPENDENT, meshes=["box"])
    own |= {("train", "box", "pandis-exact"), ("bake", "box", "grid-force-24")}
    own |= graphs("trilinear-24", "pandis-exact", meshes=["box"])
    own |= native(*FIELDS, meshes=["box"])
    assert plan(rerun) == own | LAST


def test_auto_builds_one_field_and_trains_nothing_beside_it(rerun):
    change(rerun, fields="auto", budget={"force_error": 1e-3})
    assert plan(rerun) == all_of("choose", *DEPENDENT) | native("auto") | LAST


@pytest.mark.full
def test_query_times_are_an_input_of_the_choice(rerun):
    change(rerun, fields="auto", budget={"force_error": 1e-3})
    snakemake(rerun, "-j2", "all", "--configfile", FAST)
    assert plan(rerun) == set()
    table = rerun / "config/query-times.csv"
    table.write_text(table.read_text().replace("network,512,", "network,512,1"))
    assert plan(rerun) == all_of("choose", *DEPENDENT) | native("auto") | LAST


def test_another_folder_has_its_own_results(rerun):
    change(rerun, results="results/other")
    assert plan(rerun) == EVERYTHING
    meshes = {"meshes": {"x": {"source": "analytic:box"}}}
    files = Plan({"results": "a/b"} | meshes, ROOT / "workflow")
    assert all(path.startswith("a/b/") for path in files.target("all"))
    files = Plan({"results": "/scratch/b"} | meshes, ROOT / "workflow")
    assert all(path.startswith("/scratch/b/") for path in files.target("all"))
    for folder in ("../up", "/", "a b", "", 3, "a/../b"):
        with pytest.raises(PandisError, match="results: a folder, such as"):
            Plan({"results": folder} | meshes, ROOT / "workflow")


def test_another_repository_goes_by_the_query_times_that_come_along(tmp_path, monkeypatch):
    """As a module: until the working directory has a table of its own, which calibrate makes."""
    monkeypatch.chdir(tmp_path)
    budget = {"force_error": 1e-3}
    meshes = {"x": {"source": "analytic:box", "fields": "auto", "budget": budget}}
    made = Plan({"meshes": meshes}, ROOT / "workflow")
    assert Path(made.query_times).samefile(ROOT / "config/query-times.csv")
    assert made.stage_options("calibrate").table == "config/query-times.csv"
    (tmp_path / "config").mkdir()
    (tmp_path / "config/query-times.csv").touch()
    assert made.query_times == "config/query-times.csv"


def test_a_mesh_with_a_fault_of_its_own_keeps_no_other_from_running(rerun):
    bad = {"source": "analytic:box", "x": 1}
    change(rerun, meshes={"torus": {"source": "torus.obj"}, "bad": bad})
    jobs = plan(rerun)
    assert jobs - LAST == {("refuse", "torus"), ("refuse", "bad")}
    with pytest.raises(PandisError, match=r"no mesh can be built:\n  meshes.x.source: .*part.step"):
        Plan({"meshes": {"x": {"source": "part.step"}}}, ROOT / "workflow")


def test_a_mesh_that_may_not_be_read_keeps_no_other_from_running(tmp_path, monkeypatch):
    secret = tmp_path / "secret.stl"
    secret.write_bytes(b"solid")
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != secret)
    meshes = {"secret": {"source": str(secret)}, "torus": {"source": "analytic:torus"}}
    made = Plan({"meshes": meshes}, ROOT / "workflow")
    assert list(made.entries) == ["torus"]
    assert "secret.stl: the file cannot be read" in made.refused["secret"]
    with pytest.raises(PandisError, match="cannot be read: Is a directory"):
        file_digest(tmp_path)


def test_evaluation_option_trains_nothing(rerun):
    change(rerun, evaluation={"probes": 4000})
    assert plan(rerun) == all_of("evaluate", "validate") | LAST


def test_everything_touched(rerun):
    for path in rerun.rglob("*"):
        if path.is_file() and ".snakemake" not in path.parts:
            os.utime(path)
    assert plan(rerun) == set()


def test_tree_copied(rerun, tmp_path):
    shutil.copytree(rerun, tmp_path / "copied", copy_function=shutil.copyfile)
    assert plan(tmp_path / "copied") == set()


def test_keys_reordered(rerun):
    config = yaml.safe_load((rerun / FAST).read_text())

    def backwards(value):
        if isinstance(value, dict):
            return {k: backwards(value[k]) for k in reversed(value)}
        return value

    (rerun / FAST).write_text(yaml.safe_dump(backwards(config), sort_keys=False))
    # the order of the meshes is the order of the report, and nothing else
    assert plan(rerun) <= LAST
    config = backwards(config) | {"meshes": config["meshes"]}
    (rerun / FAST).write_text(yaml.safe_dump(config, sort_keys=False))
    assert plan(rerun) == set()


def test_swapped_values_are_noticed(rerun):
    config = yaml.safe_load((rerun / FAST).read_text())
    samples = config["samples"]
    samples["offsets"], samples["box"] = samples["box"], samples["offsets"]
    (rerun / FAST).write_text(yaml.safe_dump(config))
    network = {("train", m, "pandis-exact") for m in BOTH} | graphs("pandis-exact")
    network |= native("pandis-exact")
    assert plan(rerun) == all_of("sample", *DEPENDENT) | network | LAST


def test_field_added(rerun):
    change(
        rerun, fields=["exact", "trilinear-24", "pandis-exact", "nearest-24", "trilinear-normal-8"]
    )
    own = {("bake", m, "grid-normal-8") for m in BOTH}
    own |= graphs("nearest-24", "trilinear-normal-8")
    own |= native("nearest-24", "trilinear-normal-8")
    assert plan(rerun) == own | all_of(*DEPENDENT) | LAST


@pytest.mark.parametrize("field", ["trilinear-24", "pandis-exact"])
def test_field_taken_off(rerun, field):
    kept = [f for f in ("exact", "trilinear-24", "pandis-exact") if f != field]
    change(rerun, fields=kept)
    assert plan(rerun) == all_of(*DEPENDENT) | LAST


def test_no_network_means_no_samples(workspace):
    change(workspace, fields=["exact", "trilinear-24"])
    assert not {job[0] for job in plan(workspace)} & {"sample", "train"}


def test_upstream_missing_reruns_what_follows(rerun):
    (rerun / "results/torus/samples.zarr.zip").unlink()
    own = all_of("sample", *DEPENDENT, meshes=["torus"])
    own |= {("train", "torus", "pandis-exact")} | graphs("pandis-exact", meshes=["torus"])
    own |= native("pandis-exact", meshes=["torus"])
    assert plan(rerun) == own | LAST


@pytest.mark.parametrize(
    ("target", "stages"),
    [
        ("meshes", {"mesh"}),
        ("samples", {"mesh", "sample"}),
        ("models", {"mesh", "sample", "train"}),
        ("grids", {"mesh", "bake"}),
        (
            "exports",
            {"mesh", "sample", "train", "bake", "export_graph", "export_native"},
        ),
    ],
)
def test_named_targets(workspace, target, stages):
    jobs = plan(workspace, targets=[target])
    assert {job[0] for job in jobs} - {target} == stages


def test_faults_of_every_part_of_a_configuration_are_reported_at_once():
    config = {
        "results": "re sults",
        "until": "report",
        "seed": -1,
        "meshes": {"torus": {"source": "missing.stl"}, "cup": {"source": "analytic:torus", "x": 1},
                   "ball": {"source": "analytic:spere"}, "far": {"source": "https://a.org/a.stl"}},
        "scenes": {"table": {"objects": {
            "a": {"mesh": "vase", "field": "exact"}, "b": {"mesh": "cup", "field": "exakt"},
            "c": {"mesh": "cup", "field": "mine"},
        }}},
        "train": {"mine": {}},
        "datasets": {"parts": {"source": "none"}},
    }  # fmt: skip
    with pytest.raises(ConfigError) as error:
        Plan(config, ROOT / "workflow")
    for key in ("results", "until", "seed", "meshes.torus.source", "meshes.cup.x",
                "meshes.ball.source", "meshes.far.sha256",
                "scenes.table.objects.a.mesh", "scenes.table.objects.b.field",
                "datasets.parts.source"):  # fmt: skip
        assert f"\n  {key}: " in str(error.value)
    assert "10 faults" in str(error.value)
