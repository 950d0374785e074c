"""The programs of docs/meshes.md, labels.md, datasets.md and results.md, run as they stand."""

import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
import trimesh

import pandis
from pandis.__main__ import main
from pandis.pipeline.api.running import stages
from pandis.pipeline.geometry.strata import STRATA
from pandis.pipeline.run.job.artifact import read_artifact
from support import ROOT, environment


def program(page):
    """Return a page, and its blocks of Python as one program."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    return text, "".join(re.findall(r"^```python\n(.*?)^```$", text, re.M | re.S))


@pytest.fixture(autouse=True)
def part(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    trimesh.creation.box((30, 20, 12)).export(tmp_path / "part.stl")


def test_the_functions_do_what_the_page_shows():
    seen = {}
    exec(program("meshes.md")[1], seen)
    assert (seen["report"].ok, seen["report"].option) == (False, {"solid": "always"})
    assert seen["report"].faults == {"boundary_edges": 3}
    assert seen["solid"].rungs == ["fill"]
    assert seen["distance"] == pytest.approx([-4, 3])


def test_the_page_lists_every_function_and_command():
    text, _ = program("meshes.md")
    functions = [n for n in pandis.__all__ if n[0].islower() and n not in ("load", "sample")]
    assert all(f"`pandis.{name}(" in text for name in functions)
    assert set(re.findall(r"`pandis (\w+) part", text)) >= {
        "check", "repair", "field", "labels", "compare", "run"
    }  # fmt: skip


def test_the_dataset_holds_the_labels_that_the_command_writes():
    text, block = program("labels.md")
    command = re.search(r"^```sh\npandis (.*)\n```$", text, re.M)[1]
    small = re.sub(r"\d{4,}", lambda match: match[0][:-2], command)  # a hundredth of the points
    assert main([*small.split(), "--quiet"]) == 0
    seen = {}
    exec(block, seen)
    assert len(seen["data"]) == 3500
    points, distance = seen["data"][:]
    inside = (np.abs(points.numpy()) < np.array([15, 10, 6]) * 1.8 / 30).all(axis=1)
    away = np.abs(distance.numpy()) > 1e-4
    assert ((distance.numpy() < 0) == inside)[away].all()
    assert seen["inside"].any()
    with np.load("part.npz") as stored:
        rows = re.findall(r"^\| (`\w+`(?:, `\w+`)*) \| [(t]", text, re.M)
        named = {name for row in rows for name in re.findall(r"\w+", row)}
        assert named == set(stored)
    assert all(f"`{name}`" in text for name in STRATA)


def small_store(tmp_path):
    """Label the part by the first command of docs/datasets.md, with a hundredth of the points."""
    (tmp_path / "meshes").mkdir()
    shutil.move(tmp_path / "part.stl", tmp_path / "meshes/part.stl")
    text, block = program("datasets.md")
    command = re.search(r"^```sh\npandis (labels .*)\n```$", text, re.M)[1]
    small = re.sub(r"\d{4,}", lambda match: match[0][:-2], command)
    assert main([*small.split(), "--fields", "compact-16", "--quiet"]) == 0
    return text, block


def test_a_store_is_loaded_as_the_page_shows(tmp_path):
    text, block = small_store(tmp_path)
    # a program without a file cannot be started again by a worker that is spawned
    seen = {}
    exec(block.replace("num_workers=2", "num_workers=0"), seen)
    assert seen["inside"].any()
    assert len(seen["chunk"]["points"]) == 5640
    for field in (seen["field"], pandis.load("fields/all/part.compact-16.pandis")):
        assert field.query([[0, 0, 0]])[0] == pytest.approx(-6, abs=1e-3)
    shard = read_artifact(tmp_path / "parts.zarr/shards/00000.zarr.zip")
    rows = re.findall(r"^\| (`\w+`(?:, `\w+`)*) \| \(", text, re.M)
    assert {n for row in rows for n in re.findall(r"\w+", row)} | {"ranges"} == set(shard.arrays)


@pytest.mark.slow
def test_the_example_learns_what_is_inside_and_nothing_from_one_sign(tmp_path):
    trimesh.creation.icosphere(subdivisions=3).export(tmp_path / "ball.ply")
    counts = {"surface": 0, "near": 30_000, "volume": 30_000}
    pandis.label_meshes(str(tmp_path / "*.ply"), "ball.zarr", chunk=4096, **counts)
    command = [sys.executable, str(ROOT / "docs/examples/occupancy.py"), "ball.zarr", "ball"]
    path = {"PYTHONPATH": str(ROOT / "workflow")}
    for words, low, high in ((["80"], 0.9, 1.0), (["20", "--one-sign"], 0.0, 0.01)):
        done = subprocess.run([*command, *words], env=environment(**path), text=True,
                              capture_output=True, check=True)  # fmt: skip
        overlap = float(re.search(r"held-out rows: ([\d.]+)", done.stdout)[1])
        assert low <= overlap <= high, done.stdout


def test_an_artifact_is_read_as_the_page_shows(tmp_path, capsys):
    with stages(tmp_path / "part.stl", {}) as run:
        (tmp_path / "results/bunny").mkdir(parents=True)
        shutil.copy(run.make("mesh.zarr.zip"), tmp_path / "results/bunny")
    seen = {}
    exec(program("results.md")[1], seen)
    assert float(capsys.readouterr().out) == pytest.approx(30 * 20 * 12)
    assert (seen["vertices"].shape, seen["faces"].shape) == ((8, 3), (12, 3))
