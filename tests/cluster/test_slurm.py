"""Runs on a real Slurm cluster of one node: the results of a local run, and what it survives."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml
from small import CONFIG, copied, differing, results, with_data_set

from pandis.base.errors import PandisError
from pandis.pipeline.run.host import cluster
from support import ROOT, environment, snakemake, snakemake_command

PROFILE = ("--profile", "workflow/profiles/slurm")
TORUS = ["exact", "trilinear-24", "pandis-exact"], {"torus": {"source": "analytic:torus"}}


@pytest.mark.full
@pytest.mark.parametrize("database", [False, True], ids=["no accounts", "accounts"])
def test_artifacts_are_those_of_a_local_run(node, tmp_path, database):
    """With few jobs of Slurm, none of which takes more than it asked for."""
    config = CONFIG if database else ("--configfile", "config/fast.yaml")
    here, there = copied(tmp_path / "here", *TORUS), copied(tmp_path / "there", *TORUS)
    done = snakemake(here, "-j2", "all", *config)
    assert done.returncode == 0, done.stdout
    grid = node(database=database, min_job_age=3600)  # all jobs are counted below
    done = snakemake(there, *PROFILE, *config, "--", "all", **grid.environment)
    assert done.returncode == 0, done.stdout
    assert len(results(here)) >= 12
    assert differing(here, there) == []
    meshes = 1 if database else 2
    assert len(grid.ask("squeue", "--states=all", "--noheader").splitlines()) == 5 * meshes + 1
    for path in (there / "results/benchmarks").rglob("*.jsonl"):
        record = json.loads(path.read_text())
        assert record["max_rss"] < record["resources"]["mem_mb"], path
        assert record["s"] < 60 * record["resources"]["runtime"], path
    done = snakemake(there, *PROFILE, *config, "--", "all", **grid.environment)
    assert "Nothing to be done" in done.stdout


@pytest.mark.full
@pytest.mark.parametrize("database", [False, True], ids=["no accounts", "accounts"])
def test_a_cancelled_job_a_killed_daemon_and_a_new_controller_are_survived(
    node, tmp_path, database
):
    folder = copied(tmp_path / "run", *TORUS)
    grid = node(database=database)
    command = snakemake_command(*PROFILE, *CONFIG, "--", "all")
    with (tmp_path / "log").open("w") as log:
        run = subprocess.Popen(command, cwd=folder, stdout=log, stderr=log,
                               env=environment(**grid.environment))  # fmt: skip
        try:
            first = running(grid, run)
            grid.ask("scancel", first)
            second = running(grid, run, {first})
            grid.restart("slurmd")  # steps go on, as Slurm's do
            third = running(grid, run, {first, second})
            grid.stop("slurmctld")
            time.sleep(20)  # for as long nobody answers: Snakemake's questions fail
            grid.start("slurmctld")
            assert run.wait(900) == 0, (tmp_path / "log").read_text()
        finally:
            run.kill()
    assert third
    said = (tmp_path / "log").read_text()
    assert "CANCELLED" in said
    assert "Trying to restart job" in said
    assert (folder / "results/torus/hardware.json").is_file()
    done = snakemake(folder, "-j2", "verify", *CONFIG)
    assert done.returncode == 0, done.stdout


@pytest.mark.full
def test_a_data_set_is_that_of_a_local_run(node, tmp_path):
    here, there = with_data_set(tmp_path / "here"), with_data_set(tmp_path / "there")
    done = snakemake(here, "-j2", *CONFIG, "--", "datasets")
    assert done.returncode == 0, done.stdout
    grid = node(database=False)
    done = snakemake(there, *PROFILE, *CONFIG, "--", "datasets", **grid.environment)
    assert done.returncode == 0, done.stdout
    assert differing(here, there) == []
    (there / "parts/small.obj").unlink()
    done = snakemake(there, *PROFILE, *CONFIG, "--", "datasets", **grid.environment)
    assert done.returncode == 0, done.stdout
    assert "Nothing to be done" not in done.stdout
    done = snakemake(there, *PROFILE, *CONFIG, "--", "datasets", **grid.environment)
    assert "Nothing to be done" in done.stdout


def running(grid, run, but=()):
    """Return the number of a running job that is none of those."""
    end = time.monotonic() + 300
    while time.monotonic() < end and run.poll() is None:
        there = grid.ask("squeue", "--states=RUNNING", "--noheader", "--format=%i").split()
        if new := sorted({*there} - {*but}):
            return new[0]
        time.sleep(0.2)
    raise AssertionError("no job runs")


@pytest.mark.full
def test_accounts_tell_of_ends_where_the_controller_forgets(node, tmp_path):
    grid = node(database=True, min_job_age=30)
    folder = copied(tmp_path / "run", *TORUS)
    done = snakemake(folder, *PROFILE, *CONFIG, "--", "exports", **grid.environment)
    assert done.returncode == 0, done.stdout


@pytest.mark.full
def test_what_would_never_end_is_refused_at_once(node, tmp_path):
    grid = node(database=False, min_job_age=30)
    folder = copied(tmp_path / "run", *TORUS)
    done = snakemake(folder, *PROFILE, *CONFIG, "--", "all", **grid.environment)
    assert done.returncode != 0
    assert "MinJobAge in slurm.conf" in done.stdout
    assert "Traceback" not in done.stdout
    assert grid.ask("squeue", "--states=all", "--noheader") == ""


# --- without a cluster ------------------------------------------------------------


def answering(folder, monkeypatch, **commands):
    """Let commands of those names print that, or fail where it is nothing."""
    for name, said in commands.items():
        path = folder / name
        path.write_text(f"#!/bin/sh\necho '{said}'\n" if said else "#!/bin/sh\nexit 1\n")
        path.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")


SHOWN = "Configuration data\nMinJobAge               = {} sec\n"


def test_the_controller_is_asked_if_it_remembers_and_accounts_otherwise(tmp_path, monkeypatch):
    answering(tmp_path, monkeypatch, sacct="1|COMPLETED", scontrol=SHOWN.format(300))
    assert cluster.status_command() == ("squeue", 300)
    answering(tmp_path, monkeypatch, sacct="1|COMPLETED", scontrol=SHOWN.format(60))
    assert cluster.status_command() == ("sacct", 60)
    answering(tmp_path, monkeypatch, sacct="", scontrol=SHOWN.format(60))
    with pytest.raises(PandisError, match="60 s after its end"):
        cluster.status_command()


def test_without_a_cluster_that_is_said(tmp_path, monkeypatch):
    answering(tmp_path, monkeypatch, sacct="", scontrol="")
    with pytest.raises(PandisError, match="no Slurm cluster answers"):
        cluster.status_command()


class Plugin:
    """What `listen` reaches of Snakemake's plugin, and of a run that uses it."""

    class Executor:
        def additional_general_args(self):
            return "--executor slurm-jobstep"

        def get_job_args(self, job):
            return f"--cores 16 {job.rule}"

    def __init__(self, array=None):
        self.name, self.executor_plugin = "slurm", self
        self.executor_settings = SimpleNamespace(array_jobs=array, status_command=None)
        self.remote_execution_settings = SimpleNamespace(seconds_between_status_checks=5)
        self.Executor = type("Executor", (Plugin.Executor,), {})


@pytest.mark.parametrize("memory", [4000, None])
def test_a_job_runs_at_once_what_it_has_asked_for(tmp_path, monkeypatch, memory):
    answering(tmp_path, monkeypatch, scontrol=SHOWN.format(300))
    run = Plugin()
    monkeypatch.setitem(sys.modules, "snakemake_executor_plugin_slurm", run)
    cluster.listen(run)
    resources = {"mem_mb": memory} if memory else {}
    job = SimpleNamespace(rule="mesh", threads=2, resources=resources)
    executor = run.Executor()
    asked = executor.get_job_args(job)
    assert asked == "--cores 16 mesh --cores 2" + " --resources mem_mb=4000" * bool(memory)
    assert "--executor local" in executor.additional_general_args()
    executor.next_seconds_between_status_checks = 180
    assert executor.next_seconds_between_status_checks == 5


def test_an_array_of_jobs_is_left_to_the_plugin(tmp_path, monkeypatch):
    """Only its own executor knows which job of the array it is."""
    answering(tmp_path, monkeypatch, scontrol=SHOWN.format(300))
    run = Plugin(array="train")
    monkeypatch.setitem(sys.modules, "snakemake_executor_plugin_slurm", run)
    cluster.listen(run)
    assert run.Executor().additional_general_args() == "--executor slurm-jobstep"


def test_every_rule_of_the_profile_is_one_of_ours():
    profile = yaml.safe_load((ROOT / PROFILE[1] / "profile.yaml").read_text())
    grouped = dict(entry.split("=") for entry in profile["groups"])
    scripts = {path.stem for path in Path(ROOT / "scripts").glob("*.py")}
    alone = {"train", "choose", "refuse", "calibrate", "scene", "verify", "shard", "dataset"}
    assert {*grouped} | alone == scripts
    parts = [entry.split("=")[0] for entry in profile["group-components"]]
    assert {*parts} == {*grouped.values()}
