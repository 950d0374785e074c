"""Data sets in a configuration: jobs, options, faults, and what a change makes stale."""

import pytest
import trimesh

from pandis.base.errors import ConfigError
from pandis.pipeline.run.ask import tasks
from pandis.pipeline.run.ask.sharding import shard_of
from pandis.pipeline.run.plan.plan import Plan
from support import ROOT


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "meshes").mkdir()
    for k in range(6):
        trimesh.creation.box((1, 2, 3 + k)).export(tmp_path / f"meshes/part{k}.ply")
    return tmp_path / "meshes"


def planned(**options):
    config = {"datasets": {"parts": {"source": "meshes", "shards": 2} | options}}
    return Plan(config, ROOT / "workflow")


def options(plan):
    """Return the options of every job by its first output."""
    return {o.path: plan.options(o.stage)(o.wildcards) for o in plan.everything()}


def changed(before, after):
    return {path.rpartition("/")[2] for path in after if after[path] != before.get(path)}


def test_a_configuration_may_have_data_sets_alone(folder):
    plan = planned()
    paths = [output.path.removeprefix("results/datasets/parts/") for output in plan.everything()]
    assert paths == ["shards/00000.zarr.zip", "shards/00001.zarr.zip", "index.zarr.zip",
                     "card.html", "card.json"]  # fmt: skip
    assert plan.target("datasets") == [output.path for output in plan.everything()]
    for output in plan.everything():
        task = plan.stage_options(output.stage, **output.wildcards)
        model = {"shard": tasks.ShardTask, "dataset": tasks.DatasetTask}[output.stage]
        assert type(task) is model
        assert model(**plan.options(output.stage)(output.wildcards)) == task


def test_data_sets_come_before_the_report_of_meshes(folder):
    config = {
        "fields": "exact", "meshes": {"ball": {"source": "analytic:sphere"}},
        "datasets": {"parts": {"source": "meshes"}}, "seed": 5,
    }  # fmt: skip
    plan = Plan(config, ROOT / "workflow")
    stages = [output.stage for output in plan.everything()]
    assert {"mesh", "shard", "dataset", "report"} <= set(stages)
    shard = next(output for output in plan.everything() if output.stage == "shard")
    assert plan.stage_options("shard", **shard.wildcards).seed == 5
    assert plan.target("meshes") == ["results/ball/mesh.zarr.zip"]


def test_a_change_of_one_mesh_concerns_its_shard_alone(folder):
    before = options(planned())
    own = f"{shard_of('part3', 2):05}.zarr.zip"
    trimesh.creation.box((9, 9, 9)).export(folder / "part3.ply")
    assert changed(before, options(planned())) == {own}
    before = options(planned())
    override = {"part3": {"samples": {"near": 10}}}
    assert changed(before, options(planned(override=override))) == {own}
    (folder / "part3.ply").unlink()
    assert changed(before, options(planned())) == {own}
    assert len(changed(before, options(planned(samples={"near": 3})))) == 2


def test_faults_of_data_sets_are_told_at_once_and_with_others(folder):
    config = {
        "seed": -1,
        "datasets": {
            "parts": {"source": "none", "chunk": 1, "smaples": {}},
            "Parts": {"source": "meshes"},
            "more": {"source": "meshes", "mesh": {"opn": "cap"}},
        },
    }
    with pytest.raises(ConfigError) as error:
        Plan(config, ROOT / "workflow")
    for line in (
        "seed: Input should be greater than or equal to 0",
        "datasets.parts.chunk:",
        "datasets.parts.smaples: unknown option; did you mean 'samples'?",
        "datasets.Parts: a data set's name must start with a-z",
        "datasets.more.mesh.opn: unknown option; did you mean 'open'?",
    ):
        assert line in str(error.value)
    for source, message in (("none", "there is no file or folder 'none'"), (3, "string")):
        with pytest.raises(ConfigError, match=message):
            planned(source=source)
    (folder.parent / "empty").mkdir()
    with pytest.raises(ConfigError, match="there is no mesh in empty"):
        planned(source="empty").everything()


def test_the_name_of_the_folder_of_data_sets_is_no_name_of_a_mesh():
    config = {"meshes": {"datasets": {"source": "analytic:sphere"}}}
    with pytest.raises(ConfigError, match="taken by a folder"):
        Plan(config, ROOT / "workflow")
