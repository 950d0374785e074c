"""Verify, asked again and again: every kind of damage or change is found, named and mended."""

import json
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

from pandis.pipeline.run.ask.sourcing import (
    SourceDigests,
    source_digest,
    source_fault,
    source_files,
)
from pandis.pipeline.run.job.artifact import read_artifact, write_artifact
from support import box_mesh, edit, plan, snakemake, write_obj

#: Takes long: `make test-slow`.
pytestmark = pytest.mark.slow

CONFIG = "config/scene.yaml"
GIVEN = ("--configfile", CONFIG)
SMALL = {
    "fields": ["nearest-12"],
    "results": "made/here",
    "trajectory": {"samples": 50, "deep": 0.01},
    "evaluation": {"probes": 500},
    "stress": {"ticks": 1000, "loops": 5},
    "timing": {"queries": 100, "batch": 100, "cold": 0},
    "hardware": {"seconds": 0.05, "loaded_seconds": 0},
}
HOME = "made/here/part"


def write_scene(folder, size):
    """Write a box as a glTF scene: one file, and another one with the numbers."""
    box = trimesh.creation.box((size, 1.0, 0.8))
    for name, data in trimesh.exchange.gltf.export_gltf(trimesh.Scene(box)).items():
        (folder / name).write_bytes(data)
    return folder / "model.gltf", next(folder.glob("*.bin"))


def mended(folder, said):
    """Run every command that verify has printed, as a user would copy it."""
    commands = re.findall(r"snakemake (-j2 [^&\n]+)", said)
    assert commands
    for command in commands:
        done = snakemake(folder, *command.split())
        assert done.returncode == 0, done.stdout
    return commands


def flip(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 4
    path.write_bytes(data)


@pytest.mark.full
def test_twelve_kinds_of_damage_and_change_are_found_and_mended(workspace):
    scene, numbers = write_scene(workspace, 1.0)
    write_obj(workspace / "other.obj", *box_mesh())
    meshes = {"part": {"source": scene.name}, "other": {"source": "other.obj"}}
    (workspace / CONFIG).write_text(yaml.safe_dump(SMALL | {"meshes": meshes}))
    assert snakemake(workspace, "-j2", "all", *GIVEN).returncode == 0
    assert not (workspace / "results").exists()
    home = workspace / HOME
    other = home.with_name("other")

    def change_config(**sections):
        config = yaml.safe_load((workspace / CONFIG).read_text())
        (workspace / CONFIG).write_text(yaml.safe_dump(config | sections))

    def older_source():
        """Another mesh under the same name, with an older time than any result."""
        vertices, faces = box_mesh()
        write_obj(workspace / "other.obj", 1.1 * vertices + [0.3, 0, 0], faces)
        os.utime(workspace / "other.obj", (1_000_000_000, 1_000_000_000))

    def replace_numbers():
        """The buffer of the scene is of another box: the scene's own file is as it was."""
        before = scene.read_bytes()
        write_scene(workspace, 1.5)
        scene.write_bytes(before)

    def edit_json():
        found = json.loads((other / "hardware.json").read_text())
        found["fields"]["nearest-12"]["verdict"] = "excellent"
        (other / "hardware.json").write_text(json.dumps(found))

    def forge():
        """A whole artifact, with the provenance of the real one and other numbers in it."""
        path = home / "trajectory.zarr.zip"
        real = read_artifact(path)
        arrays = real.arrays | {"points": real.arrays["points"] + 1e-3}
        write_artifact(
            path, "trajectory", arrays, attributes=real.attributes, provenance=real.provenance
        )

    def fake_package():
        """Another version of a package that the mesh stage imports."""
        folder = workspace / "newer/lxml-99.0.dist-info"
        folder.mkdir(parents=True)
        (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: lxml\nVersion: 99.0\n")

    truncate = home / "export/nearest-12.onnx"
    code = "workflow/pandis/pipeline/geometry/trajectories.py"
    # no mend of one thing of a round makes what another has damaged: they belong to two meshes,
    # or nothing is made of them but the page
    rounds = (
        {
            "a byte flipped": (lambda: flip(home / "mesh.zarr.zip"), "part/mesh.zarr.zip"),
            "the source replaced by an older file": (
                older_source,
                "other/mesh.zarr.zip +stale: its source",
            ),
        },
        {
            "a file cut off": (
                lambda: truncate.write_bytes(truncate.read_bytes()[:-50]),
                "part/export/nearest-12.onnx",
            ),
            "the result of another mesh": (
                lambda: shutil.copy(other / "stress.zarr.zip", home),
                "part/stress.zarr.zip +is another result, of stress other",
            ),
            "an evaluation deleted": (
                (other / "evaluation.zarr.zip").unlink,
                "other/evaluation.zarr.zip +missing",
            ),
        },
        {
            "a forged artifact": (forge, "its input made/here/part/trajectory.zarr.zip changed"),
            "a path deleted": (
                (other / "trajectory.zarr.zip").unlink,
                "other/trajectory.zarr.zip +missing",
            ),
        },
        {
            "a table edited": (
                lambda: edit(workspace / "made/here/summary.csv", "part,nearest-12", "part,best"),
                "summary.csv +differs",
            ),
        },
        {
            "a buffer of the source replaced": (
                replace_numbers,
                "part/mesh.zarr.zip +stale: its source",
            ),
            "a companion edited": (edit_json, "other/hardware.json +differs"),
        },
        {
            "an option changed": (
                lambda: change_config(timing=SMALL["timing"] | {"queries": 110}),
                r"timing.zarr.zip +stale: options changed \(queries\)",
            ),
            "a module changed": (
                lambda: edit(workspace / code, "_TRIES = 24", "_TRIES = 23"),
                r"trajectory.zarr.zip +stale: code changed "
                r"\(pandis.pipeline.geometry.trajectories\)",
            ),
        },
        {
            "another version of a package": (
                fake_package,
                r"mesh.zarr.zip +stale: code changed \(package lxml\)",
            ),
        },
    )
    assert sum(map(len, rounds)) >= 12
    for kinds in rounds:
        sound = snakemake(workspace, "-j2", "verify", *GIVEN)
        assert sound.returncode == 0, (list(kinds), sound.stdout)
        assert "are whole and belong to this configuration and code" in sound.stdout
        for damage, _ in kinds.values():
            damage()
        newer = workspace / "newer"  # in front of the real package, only for this
        given = {"PYTHONPATH": str(newer)} if newer.is_dir() else {}
        found = snakemake(workspace, "-j2", "verify", *GIVEN, **given)
        for name, (_, wanted) in kinds.items():
            assert found.returncode == 1, (name, found.stdout)
            assert re.search(wanted, found.stdout), (name, found.stdout)
        if not given:  # nothing is built with a package that is not there
            mended(workspace, found.stdout)
    assert snakemake(workspace, "-j2", "verify", *GIVEN).returncode == 0
    assert numbers.is_file()


def test_a_run_notices_what_verify_does(workspace):
    """The buffer of a scene, and a source replaced by an older file: through a plain plan."""
    scene, _ = write_scene(workspace, 1.0)
    meshes = {"part": {"source": scene.name}}
    (workspace / CONFIG).write_text(yaml.safe_dump(SMALL | {"meshes": meshes}))
    assert snakemake(workspace, "-j1", "meshes", *GIVEN).returncode == 0
    assert plan(workspace, CONFIG, ["meshes"]) - {("meshes", None)} == set()
    before = scene.read_bytes()
    _, numbers = write_scene(workspace, 1.5)
    scene.write_bytes(before)
    os.utime(numbers, (1_000_000_000, 1_000_000_000))
    os.utime(scene, (1_000_000_000, 1_000_000_000))
    assert ("mesh", "part") in plan(workspace, CONFIG, ["meshes"])


def test_sources_are_their_files_and_those_they_name(tmp_path, monkeypatch):
    vertices, faces = box_mesh()
    mesh = write_obj(tmp_path / "a.obj", vertices, faces)
    mesh.write_text("mtllib a.mtl\n" + mesh.read_text())
    (tmp_path / "a.mtl").write_text("newmtl x\nmap_Kd -s 1 1 1 wood.png\nmap_Bump gone.png\n")
    (tmp_path / "wood.png").write_bytes(b"brown")
    assert [path.name for path in source_files(mesh)] == ["a.obj", "a.mtl", "wood.png"]
    digests = SourceDigests(tmp_path / "memory.json")
    monkeypatch.chdir(tmp_path)
    first = digests.of("a.obj")
    assert first == source_digest(source_files(mesh))
    assert digests.files(mesh) == source_files(mesh)
    assert SourceDigests(tmp_path / "memory.json").of("a.obj") == first
    (tmp_path / "wood.png").write_bytes(b"black")  # as long, and as old
    assert SourceDigests(tmp_path / "memory.json").of("a.obj") != first
    (tmp_path / "memory.json").write_text("{")
    assert SourceDigests(tmp_path / "memory.json").of("a.obj") == source_digest(source_files(mesh))


def test_what_is_wrong_with_a_source_is_known_before_anything_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "a.obj").write_text("")
    (tmp_path / "b.obj").write_text("v 0 0 0\n")
    for source, said in {
        "none.obj": "there is no file 'none.obj'",
        "~/b.obj": "a ~ is not the home folder here; write ",
        "part.step": "unknown format '.step'",
        "part": "unknown format '.'",
        "a.obj": "the file is empty",
        "pymeshlab:none.obj": "PyMeshLab ships no 'none.obj'",
    }.items():
        assert said in source_fault(source)
        assert "\n" not in source_fault(source)
    for source in ("b.obj", "analytic:sphere", "pymeshlab:bunny.obj", "https://x.org/a.ply.gz"):
        assert source_fault(source) is None


def test_a_mesh_inside_a_package_is_a_source_too(tmp_path, monkeypatch):
    """Replaced there, its digest is another: that alone told nobody."""
    monkeypatch.setattr("pandis.pipeline.run.ask.sourcing.shipped_folder", lambda: tmp_path)
    write_obj(tmp_path / "bunny.obj", *box_mesh())
    digests = SourceDigests(tmp_path / "memory.json")
    before = digests.of("pymeshlab:bunny.obj")
    vertices, faces = box_mesh()
    write_obj(tmp_path / "bunny.obj", 2 * vertices, faces)
    assert digests.of("pymeshlab:bunny.obj") not in ("", before)
    assert np.isfinite(vertices).all()
    assert Path(tmp_path / "bunny.obj").is_file()


FAST = ("--configfile", "config/fast.yaml")


@pytest.mark.full
def test_what_was_built_is_checked_wherever_it_lies(rerun):
    """A damaged export, a folder that was moved, one left over, and a run that ended early."""
    home = rerun / "results"
    whole = (home / "sphere/export/exact.pandis").read_bytes()
    flip(home / "sphere/export/exact.pandis")
    said = snakemake(rerun, "-j2", "verify", *FAST).stdout
    assert "results/sphere/export/exact.pandis" in said
    assert "its input results/sphere/export/exact.pandis is missing or damaged" in said
    assert "stale:" not in said
    # the job's log says it, and the table at the run's end
    (remedy,) = set(re.findall(r"snakemake -j2 [^\n]*-f ([^&\n]+) &&", said))
    assert remedy.strip() == "results/sphere/export/exact.pandis"
    (home / "sphere/export/exact.pandis").write_bytes(whole)

    shutil.copytree(home / "torus", home / "gone")
    home.rename(rerun / "moved")
    done = snakemake(rerun, "-j2", "verify", *FAST, "--config", "results=moved")
    assert done.returncode == 0, done.stdout
    assert "results are whole and belong to this configuration and code" in done.stdout
    assert "moved/gone belongs to no mesh of the configuration" in done.stdout
    (rerun / "moved").rename(home)

    for path in (home / "report.html", home / "summary.csv"):
        path.unlink()
    # one stage gone from one mesh alone was asked for
    (home / "torus/stress.zarr.zip").unlink()
    assert "torus/stress.zarr.zip" in snakemake(rerun, "-j2", "verify", *FAST).stdout
    for name in ("evaluation", "stress", "timing", "hardware", "trajectory"):
        for path in home.glob(f"*/{name}*"):
            path.unlink()
    done = snakemake(rerun, "-j2", "verify", *FAST)
    assert done.returncode == 0, done.stdout
    assert "not built so far, and not checked" in done.stdout
