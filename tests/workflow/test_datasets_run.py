"""Data sets as a user runs them: the workflow, the command, a kill, verify and what it says."""

import json
import os
import re
import signal
import subprocess
import sys
import time

import pytest
import trimesh
import yaml

import pandis
from pandis.__main__ import main
from support import environment, snakemake, snakemake_command

SAMPLES = {"surface": 200, "near": 300, "volume": 100}


def typed(*words):
    try:
        return main([str(word) for word in words])
    except SystemExit as end:
        return end.code


def write_meshes(folder, count=4):
    folder.mkdir()
    for k in range(count):
        trimesh.creation.icosphere(subdivisions=2, radius=1 + k).export(folder / f"ball{k}.ply")
    (folder / "none.stl").write_bytes(b"solid nothing\nendsolid nothing\n")


@pytest.mark.slow
def test_the_command_writes_a_store_and_says_what_failed(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_meshes(tmp_path / "meshes", 1)
    counts = [word for name, n in SAMPLES.items() for word in (f"--{name}", n)]
    assert typed("labels", "meshes", "-o", "parts.zarr", "--quiet", *counts) == 1
    said = capsys.readouterr().out
    assert "parts.zarr: 1 of 2 meshes, 600 points; see parts.zarr/card.html" in said
    assert "1 failed: read: it has no faces" in said
    (tmp_path / "meshes/none.stl").unlink()
    assert typed("labels", "meshes", "-o", "parts.zarr", "--quiet", "--json", *counts) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["store"], summary["ready"], summary["failed"]) == ("parts.zarr", 1, 0)
    assert typed("labels", "meshes", "-o", "parts.zarr", "--quiet", "--near", 5) == 3
    assert "--force" in capsys.readouterr().err
    assert typed("labels", "meshes", "-o", "parts.zarr", "--quiet", "--force", *counts) == 0
    assert typed("labels", "nothing", "-o", "x.zarr") == 2
    assert typed("labels", "meshes", "-o", "x.zarr", "--chunk", 1) == 2
    assert typed("labels", "meshes", "meshes", "-o", "x.zarr") == 2
    assert "a store has one source" in capsys.readouterr().err


def test_the_command_layout_writes_files_that_state_their_sign(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_meshes(tmp_path / "meshes", 1)
    (tmp_path / "meshes/none.stl").unlink()
    pandis.label_meshes("meshes", "parts.zarr", **SAMPLES)
    counts = [word for part in ("volume", "near", "surface", "sharp") for word in (f"--{part}", 50)]
    assert typed("layout", "parts.zarr", "--as", "dora", "-o", "out", *counts) == 0
    assert "out: 1 files" in capsys.readouterr().out
    assert typed("layout", "parts.zarr", "--as", "dora", "-o", "out", *counts) == 3
    assert "name a new one" in capsys.readouterr().err
    assert typed("layout", "meshes", "--as", "dora", "-o", "more") == 3
    assert typed("layout", "parts.zarr", "--as", "obj", "-o", "more") == 2


@pytest.fixture
def run(workspace):
    """A folder with meshes and a configuration of a data set alone."""
    write_meshes(workspace / "meshes")
    config = {"datasets": {"parts": {"source": "meshes", "samples": SAMPLES, "shards": 2}}}
    (workspace / "my.yaml").write_text(yaml.safe_dump(config))
    return workspace


def build(folder, *targets):
    return snakemake(folder, "-j2", "--configfile", "my.yaml", "--", *targets)


@pytest.mark.slow
def test_a_killed_run_goes_on_and_verify_covers_the_store(run):
    process = subprocess.Popen(
        snakemake_command("-j2", "--configfile", "my.yaml"), cwd=run, env=environment(),
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    shards = run / "results/datasets/parts/shards"
    while process.poll() is None and not list(shards.rglob("*.npz")):
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    snakemake(run, "--configfile", "my.yaml", "--unlock")  # what its message says
    done = build(run, "all")
    assert done.returncode == 0, done.stdout
    assert "The card is in     results/datasets/parts/card.html" in done.stdout
    store = pandis.LabelStore(run / "results/datasets/parts")
    assert sorted([*store.names, *store.failed]) == [*(f"ball{k}" for k in range(4)), "none"]
    card = json.loads((store.path / "card.json").read_text())
    assert [mesh["name"] for mesh in card["meshes"]] == sorted([*store.names, *store.failed])
    assert "Nothing to be done" in build(run, "all").stdout
    verified = build(run, "verify")
    assert verified.returncode == 0, verified.stdout
    assert "all 5 results are whole" in verified.stdout
    shard = shards / "00001.zarr.zip"
    whole = shard.read_bytes()
    shard.write_bytes(whole[:-40] + b"x" + whole[-39:])
    verified = build(run, "verify")
    assert verified.returncode
    assert re.search(r"00001.zarr.zip +truncated or damaged", verified.stdout)
    mended = snakemake(run, "-j2", "--configfile", "my.yaml", "-f", str(shard.relative_to(run)))
    assert mended.returncode == 0, mended.stdout
    assert shard.read_bytes() == whole
    (store.path / "card.json").write_text("{}")
    assert "differs from its artifact" in build(run, "verify").stdout


@pytest.mark.slow
def test_the_workflow_and_the_function_store_the_same_rows(run):
    done = build(run, "datasets")
    assert done.returncode == 0, done.stdout
    program = (
        f"import pandis\npandis.label_meshes('meshes', 'parts.zarr', shards=2, **{SAMPLES!r})\n"
    )
    subprocess.run([sys.executable, "-c", program], cwd=run, check=True,
                   env=environment(PYTHONPATH=str(run / "workflow")))  # fmt: skip
    for number in range(2):
        name = f"shards/{number:05}.zarr.zip"
        ours = (run / "parts.zarr" / name).read_bytes()
        assert ours == (run / "results/datasets/parts" / name).read_bytes()
