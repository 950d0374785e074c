"""Kills, damage, failures and lost records: nothing stale or broken is ever taken for good."""

import hashlib
import json
import os
import shutil
import signal
import subprocess

import numpy as np
import pytest

from support import edit, environment, plan, results, snakemake, snakemake_command

#: Takes long: `make test-slow`.
pytestmark = pytest.mark.slow

FAST = ("--configfile", "config/fast.yaml")
#: Stage, the output that is removed to make it run, and the line that says it has begun.
STAGES = {
    "mesh": "sphere/mesh.zarr.zip",
    "sample": "sphere/samples.zarr.zip",
    "train": "sphere/model-pandis-exact.zarr.zip",
    "bake": "sphere/grid-force-24.zarr.zip",
    "export_graph": "sphere/export/trilinear-24.onnx",
    "trajectory": "sphere/trajectory.zarr.zip",
    "evaluate": "sphere/evaluation.zarr.zip",
    "stress": "sphere/stress.zarr.zip",
    "timing": "sphere/timing.zarr.zip",
    "validate": "sphere/hardware.zarr.zip",
    "summary": "summary.csv",
    "report": "report.html",
}
QUICK = ("train",)


def kill_at(folder, text, command=("-j2", "all", *FAST)):
    """Start a run and kill -9 all of it as soon as a line with ``text`` appears."""
    run = subprocess.Popen(
        snakemake_command(*command),
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
    kills = 0
    for stage in STAGES:
        name = f"all meshes {stage}" if stage in ("summary", "report") else f"sphere {stage}"
        kills += kill_at(workspace, name)  # some stages are over before their turn comes
        snakemake(workspace, "--unlock", *FAST)
    assert kills  # how many is a matter of time; every stage's kill has its own test
    done = snakemake(workspace, "-j2", "all", *FAST)
    assert done.returncode == 0, done.stdout
    assert results(workspace) == results(finished)


@pytest.mark.full
def test_failure_after_an_option_change_leaves_nothing_stale(rerun):
    """The hole in Snakemake's records: a failed job counts as run with the new options."""
    # a spiral is for a sphere, and not for the torus
    edit(rerun / "config/fast.yaml", "hardware:", "trajectory: {kind: spiral}\nhardware:")
    done = snakemake(rerun, "-j2", "all", *FAST)
    assert done.returncode != 0
    assert "a spiral is for analytic:sphere" in done.stdout
    # the sphere has its report, which says what is left out
    assert "a spiral is for analytic:sphere" in (rerun / "results/report.html").read_text()
    assert "results/summary.csv cover the meshes that could be built (1)" in done.stdout
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
    assert "all 34 results are whole and belong to this configuration and code" in done.stdout
    crate = json.loads((rerun / "results/ro-crate-metadata.json").read_text(encoding="utf-8"))
    things = {thing["@id"]: thing for thing in crate["@graph"]}
    files = [rerun / "results" / part["@id"] for part in things["./"]["hasPart"]]
    assert len(files) == 34
    for path in files:
        described = things[path.relative_to(rerun / "results").as_posix()]
        assert described["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    (evaluated,) = [thing for name, thing in things.items() if name.startswith("#evaluate-torus")]
    assert {"@id": "torus/mesh.zarr.zip"} in evaluated["object"]
    with (rerun / "results/summary.csv").open("a", encoding="utf-8") as stream:
        stream.write("damage\n")
    assert verify(rerun).returncode == 1
    assert not (rerun / "results/ro-crate-metadata.json").exists()


def test_verify_without_snakemakes_records(rerun):
    """The records are lost, an option is changed: only the artifacts can tell."""
    shutil.rmtree(rerun / ".snakemake")
    edit(rerun / "config/fast.yaml", "steps: 300", "steps: 301")
    done = verify(rerun)
    assert done.returncode == 1
    for mesh in ("sphere", "torus"):
        line = f"results/{mesh}/model-pandis-exact.zarr.zip"
        found = next(t for t in done.stdout.splitlines() if line in t and "stale" in t)
        assert "options changed (recipe.steps)" in found
    assert "-R results/" in done.stdout


def test_verify_names_the_module_that_changed(rerun):
    edit(rerun / "workflow/pandis/pipeline/geometry/trajectories.py", "_TRIES = 24", "_TRIES = 23")
    done = verify(rerun)
    assert done.returncode == 1
    assert "stale: code changed (pandis.pipeline.geometry.trajectories)" in done.stdout


FILES = (
    "sphere/timing.zarr.zip",
    "report.html",
    "sphere/samples.zarr.zip",
    "sphere/export/pandis-exact.onnx",
    "sphere/hardware.json",
    "summary.csv",
)


@pytest.mark.parametrize(
    ("path", "damage"),
    [
        pytest.param(path, damage, marks=[] if quick else pytest.mark.full)
        for path in FILES
        for damage in ("flip", "truncate", "remove", "swap")
        for quick in [damage == "flip" or path in FILES[:2]]
    ],
)
def test_verify_detects_damage(rerun, path, damage):
    target = rerun / "results" / path
    data = bytearray(target.read_bytes())
    if damage == "flip":
        data[len(data) // 2] ^= 4
        target.write_bytes(data)
    elif damage == "truncate":
        cut = len(data) // 2
        if path.endswith((".csv", ".html")):  # in the middle of a character of several bytes
            cut = next(k for k, byte in enumerate(data) if byte >= 0xC0) + 1
        target.write_bytes(data[:cut])
    elif damage == "remove":
        target.unlink()
    elif "sphere" in path:  # another mesh's result: whole, but not this one
        target.write_bytes((rerun / "results" / path.replace("sphere", "torus")).read_bytes())
    else:
        target.write_bytes(b"something else")
    done = verify(rerun)
    assert done.returncode == 1
    # the file itself is named, not only what was made from it
    assert f"all meshes verify: results/{path} " in done.stdout


def test_mending_as_verify_says(rerun, finished):
    target = rerun / "results/sphere/grid-force-24.zarr.zip"
    target.write_bytes(target.read_bytes()[:-1000])
    said = verify(rerun).stdout
    line = next(t for t in said.splitlines() if "To restore what is lost or damaged" in t)
    restore, rest = line.split(": snakemake ")[1].split(" && snakemake ")
    given = "-j2 --configfile config/fast.yaml"
    assert restore == f"{given} -f results/sphere/grid-force-24.zarr.zip"
    assert rest == f"{given} -- all"
    done = snakemake(rerun, *restore.split())
    assert done.returncode == 0, done.stdout
    # its bytes are the same: nothing that was made from it is stale
    assert plan(rerun) == set()
    assert snakemake(rerun, *rest.split()).returncode == 0
    assert verify(rerun).returncode == 0
    assert results(rerun) == results(finished)


@pytest.mark.parametrize("export", [False, True])
def test_damaged_input_stops_its_reader_with_the_remedy(rerun, export):
    """As after `cp -p`: an older time, so that Snakemake sees nothing."""
    name = "sphere/export/pandis-exact.onnx" if export else "sphere/samples.zarr.zip"
    reader = "sphere/timing.zarr.zip" if export else "sphere/model-pandis-exact.zarr.zip"
    target = rerun / "results" / name
    stamp = target.stat()
    data = bytearray(target.read_bytes())
    data[len(data) // 3] ^= 1
    target.write_bytes(data)
    os.utime(target, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    (rerun / "results" / reader).unlink()
    done = snakemake(rerun, "-j2", f"results/{reader}", *FAST)
    assert done.returncode != 0
    assert f"results/{name}: " in done.stdout
    assert f"rebuild it with: snakemake -j2 -R results/{name}" in done.stdout
    assert not (rerun / "results" / reader).exists()


def test_code_changed_during_a_run_is_noticed(rerun):
    """The plan has digested one version, the job would run another."""
    script = rerun / "scripts/trajectory.py"
    edit(rerun / "workflow/pandis/pipeline/mesh/build.py", "shape = find_shape(name)", SABOTAGE)
    (rerun / "results/sphere/trajectory.zarr.zip").unlink()
    (rerun / "results/sphere/mesh.zarr.zip").unlink()
    done = snakemake(rerun, "-j1", "results/sphere/trajectory.zarr.zip", *FAST)
    assert "late change" in script.read_text()
    assert done.returncode != 0
    assert "the code was changed after this run was planned" in done.stdout


#: Makes the mesh stage edit the script of a stage that runs after it.
SABOTAGE = """shape = find_shape(name)
    from pathlib import Path
    script = Path("scripts/trajectory.py")
    if "late" not in script.read_text():
        script.write_text(script.read_text() + "\\nlate = 'late change'\\n")"""


@pytest.mark.full
def test_kill_in_the_middle_of_training_resumes_bit_identical(workspace):
    """Killed after a checkpoint, the next run goes on from it and ends as an undisturbed one."""
    edit(workspace / "config/fast.yaml", "steps: 300", "steps: 20000")
    model = "results/sphere/model-pandis-exact.zarr.zip"
    command = ("-j2", model, *FAST)
    done = snakemake(workspace, *command)
    assert done.returncode == 0, done.stdout
    undisturbed = (workspace / model).read_bytes()
    (workspace / model).unlink()
    assert kill_at(workspace, "checkpoint at step", command)
    snakemake(workspace, "--unlock", *FAST)
    done = snakemake(workspace, *command)
    assert "resumed at step" in done.stdout
    assert (workspace / model).read_bytes() == undisturbed
    assert not (workspace / "results/sphere/.resume").exists()


@pytest.mark.full
def test_random_damage_is_always_found(rerun):
    rng = np.random.default_rng(1)
    files = sorted(
        p
        for p in (rerun / "results").rglob("*")
        if p.suffix in (".zip", ".onnx", ".pt2") and p.is_file()
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
