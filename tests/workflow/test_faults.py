"""Kills, damage, failures and lost records: nothing stale or broken is ever taken for good."""

import os
import shutil
import signal
import subprocess

import numpy as np
import pytest

from support import edit, environment, plan, results, snakemake, snakemake_command

FAST = ("--configfile", "config/fast.yaml")
#: Stage, the output that is removed to make it run, and the line that says it has begun.
STAGES = {
    "mesh": "sphere/mesh.zarr.zip",
    "sample": "sphere/samples.zarr.zip",
    "train": "sphere/model-pandis-exact.zarr.zip",
    "export_network": "sphere/export/pandis-exact.onnx",
    "bake": "sphere/grid-force-24.zarr.zip",
    "export_grid": "sphere/export/trilinear-24.onnx",
    "trajectory": "sphere/trajectory.zarr.zip",
    "evaluate": "sphere/evaluation.zarr.zip",
    "timing": "sphere/timing.zarr.zip",
    "validate": "sphere/hardware.zarr.zip",
    "summary": "summary.csv",
    "report": "report.html",
}
QUICK = ("train", "validate")


def kill_at(folder, text):
    """Start a run and kill -9 all of it as soon as a line with ``text`` appears."""
    run = subprocess.Popen(
        snakemake_command("-j2", "all", *FAST),
        cwd=folder,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    seen = False
    for line in run.stdout:
        if text in line:
            seen = True
            os.killpg(run.pid, signal.SIGKILL)
    run.wait()
    run.stdout.close()
    return seen


@pytest.mark.parametrize(
    "stage", [s if s in QUICK else pytest.param(s, marks=pytest.mark.full) for s in STAGES]
)
def test_kill_in_a_stage_then_rerun(rerun, finished, stage):
    (rerun / "results" / STAGES[stage]).unlink()
    name = f"all meshes {stage}" if stage in ("summary", "report") else f"sphere {stage}"
    assert kill_at(rerun, name)
    assert snakemake(rerun, "--unlock", *FAST).returncode == 0
    done = snakemake(rerun, "-j2", "all", *FAST)
    assert done.returncode == 0, done.stdout
    assert results(rerun) == results(finished)
    assert not list((rerun / "results").rglob(".*.part"))
    assert plan(rerun) == set()


@pytest.mark.full
def test_kill_in_a_first_run_again_and_again(workspace, finished):
    """Killed at the start of every single job in turn, the run still ends as an undisturbed one."""
    for stage in STAGES:
        kill_at(workspace, f"sphere {stage}")
        snakemake(workspace, "--unlock", *FAST)
    done = snakemake(workspace, "-j2", "all", *FAST)
    assert done.returncode == 0, done.stdout
    assert results(workspace) == results(finished)


def test_failure_after_an_option_change_leaves_nothing_stale(rerun):
    """The hole in Snakemake's records: a failed job counts as run with the new options."""
    # the sphere has room for that depth, the torus has not
    edit(
        rerun / "config/fast.yaml",
        "hardware:",
        "trajectory: {shallow: 0.85, deep: 0.89}\nhardware:",
    )
    done = snakemake(rerun, "-j2", "all", *FAST)
    assert done.returncode != 0
    assert "reduce trajectory.deep (now 0.89" in done.stdout
    assert "Nothing to be done" not in snakemake(rerun, "-j2", "all", *FAST).stdout
    stale = plan(rerun)
    for stage in ("trajectory", "evaluate", "timing", "validate"):
        assert (stage, "torus") in stale
    assert verify(rerun).returncode == 1


def verify(folder):
    return snakemake(folder, "-j2", "verify", *FAST)


def test_verify_accepts_a_finished_run(rerun):
    done = verify(rerun)
    assert done.returncode == 0, done.stdout
    assert "all 22 results are whole and belong to this configuration and code" in done.stdout


def test_verify_without_snakemakes_records(rerun):
    """The records are lost, an option is changed: only the artifacts can tell."""
    shutil.rmtree(rerun / ".snakemake")
    edit(rerun / "config/fast.yaml", "steps: 300", "steps: 301")
    done = verify(rerun)
    assert done.returncode == 1
    for mesh in ("sphere", "torus"):
        line = f"results/{mesh}/model-pandis-exact.zarr.zip"
        found = next(t for t in done.stdout.splitlines() if line in t and "stale" in t)
        assert "options changed (steps)" in found
    assert "snakemake -j2 -R results/" in done.stdout


def test_verify_names_the_module_that_changed(rerun):
    edit(rerun / "workflow/pandis/trajectories.py", "_TRIES = 24", "_TRIES = 23")
    done = verify(rerun)
    assert done.returncode == 1
    assert "stale: code changed (pandis.trajectories)" in done.stdout


@pytest.mark.parametrize("damage", ["flip", "truncate", "remove", "swap"])
@pytest.mark.parametrize(
    "path", ["sphere/samples.zarr.zip", "sphere/export/pandis-exact.onnx", "sphere/hardware.json"]
)
def test_verify_detects_damage(rerun, path, damage):
    target = rerun / "results" / path
    data = bytearray(target.read_bytes())
    if damage == "flip":
        data[len(data) // 2] ^= 4
        target.write_bytes(data)
    elif damage == "truncate":
        target.write_bytes(data[: len(data) // 2])
    elif damage == "remove":
        target.unlink()
    else:  # another mesh's result of the same kind: whole, but not what was made from these inputs
        target.write_bytes((rerun / "results" / path.replace("sphere", "torus")).read_bytes())
    done = verify(rerun)
    assert done.returncode == 1
    assert f"results/{path}" in done.stdout


def test_mending_as_verify_says(rerun, finished):
    target = rerun / "results/sphere/grid-force-24.zarr.zip"
    target.write_bytes(target.read_bytes()[:-1000])
    said = verify(rerun).stdout
    command = next(t for t in said.splitlines() if "To mend them: snakemake " in t)
    arguments = command.split("To mend them: snakemake ")[1].split()
    done = snakemake(rerun, *FAST, *arguments)
    assert done.returncode == 0, done.stdout
    assert verify(rerun).returncode == 0
    assert results(rerun) == results(finished)


def test_damaged_input_stops_its_reader_with_the_remedy(rerun):
    target = rerun / "results/sphere/samples.zarr.zip"
    data = bytearray(target.read_bytes())
    data[len(data) // 3] ^= 1
    target.write_bytes(data)
    (rerun / "results/sphere/model-pandis-exact.zarr.zip").unlink()
    done = snakemake(rerun, "-j2", "results/sphere/model-pandis-exact.zarr.zip", *FAST)
    if done.returncode == 0:  # Snakemake saw the newer file by itself and made it again
        assert verify(rerun).returncode == 0 or "stale" in verify(rerun).stdout
    else:
        assert "rebuild it with: snakemake" in done.stdout


def test_lost_records_and_touched_files_rerun_nothing_wrongly(rerun):
    shutil.rmtree(rerun / ".snakemake")
    assert verify(rerun).returncode == 0


@pytest.mark.full
def test_random_damage_is_always_found(rerun):
    rng = np.random.default_rng(1)
    files = sorted(
        p for p in (rerun / "results").rglob("*") if p.suffix in (".zip", ".onnx") and p.is_file()
    )
    for _ in range(40):
        target = files[rng.integers(len(files))]
        whole = target.read_bytes()
        data = bytearray(whole)
        data[rng.integers(len(data))] ^= 1 << int(rng.integers(8))
        target.write_bytes(data)
        assert verify(rerun).returncode == 1, target
        target.write_bytes(whole)
    assert verify(rerun).returncode == 0
