"""What a user may get wrong: a sentence that names the file or key and the remedy."""

import hashlib
import http.server
import json
import os
import re
import signal
import subprocess
import threading

import pytest
import trimesh
import yaml

from support import (
    box_mesh,
    edit,
    environment,
    octahedron,
    snakemake,
    snakemake_command,
    write_obj,
)

#: Takes long: `make test-slow`.
pytestmark = pytest.mark.slow


def run(folder, meshes, *targets, **sections):
    config = {"fields": ["exact"], "meshes": meshes} | sections
    (folder / "config/bad.yaml").write_text(yaml.safe_dump(config))
    return snakemake(folder, "-j2", *(targets or ["meshes"]), "--configfile", "config/bad.yaml")


def test_bad_meshes_fail_in_plain_words_and_the_others_finish(workspace):
    vertices, faces = box_mesh()
    good = write_obj(workspace / "good.obj", vertices, faces).read_text()
    files = {
        "empty.obj": "",
        "nofaces.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\n",
        "nan.obj": good.replace("v -1.0", "v nan", 1),
        "infinite.obj": good.replace("v -1.0", "v inf", 1),
        "part.step": good,
        "sheet.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n",
        "fine.obj": good,
    }
    for name, text in files.items():
        (workspace / name).write_text(text)
    meshes = {name.split(".")[0]: {"source": name} for name in files}
    meshes["missing"] = {"source": "missing.obj"}
    meshes["digest"] = {"source": "fine.obj", "sha256": "0" * 64}
    meshes["shape"] = {"source": "analytic:spere"}
    meshes["shipped"] = {"source": "pymeshlab:bunnny.obj"}
    meshes["good"] = {"source": "good.obj"}
    done = run(workspace, meshes)
    assert done.returncode != 0
    for message in (
        "there is no file 'missing.obj'",
        "empty.obj: the file is empty; export the mesh again",
        "nofaces.obj: it has no faces; export it as a triangle mesh",
        "nan.obj: line 1: 'nan' is not a number",
        "infinite.obj: line 1: 'inf' is not a number",
        "part.step: unknown format '.step'; the known formats are .obj",
        "fine.obj: the file's sha256 is",
        "'analytic:spere' is unknown; closed-form shapes are analytic:sphere",
        "PyMeshLab ships no 'bunnny.obj'",
        "the mesh lies in one plane: it has no volume, and so no inside",
        "Other meshes continued.",
    ):
        assert message in done.stdout
    assert "Traceback" not in done.stdout
    finished = {p.parent.name for p in (workspace / "results").glob("*/mesh.zarr.zip")}
    assert finished == {"good", "fine"}


@pytest.mark.parametrize(
    ("meshes", "sections", "message"),
    [
        ({"logs": {"source": "a.obj"}}, {}, "meshes.logs: this name is taken"),
        ({"a": {"source": "a.obj"}}, {"fields": ["tricubik-64"]}, "'tricubik-64' is not a field"),
        (
            {"a": {"source": "a.obj", "train": {"pandis": {"steps": 0}}}},
            {},
            "meshes.a.train.pandis.steps: Input should be greater than or equal to 1",
        ),
    ],
)
def test_impossible_configuration_stops_before_anything_runs(workspace, meshes, sections, message):
    done = run(workspace, meshes, **sections)
    assert done.returncode != 0
    assert message in done.stdout
    assert "Traceback" not in done.stdout
    assert not (workspace / "results").exists()


def test_name_clash(workspace):
    (workspace / "config/bad.yaml").write_text(
        "fields: [exact]\nmeshes:\n  a: {source: 'analytic:box'}\n  a: {source: 'analytic:torus'}\n"
    )
    done = snakemake(workspace, "-j2", "meshes", "--configfile", "config/bad.yaml")
    assert done.returncode != 0
    assert "config/bad.yaml, line 4: the key 'a' occurs twice" in done.stdout


def test_file_that_appears_later_is_taken_up(workspace):
    assert run(workspace, {"late": {"source": "late.obj"}}).returncode != 0
    write_obj(workspace / "late.obj", *octahedron())
    assert run(workspace, {"late": {"source": "late.obj"}}).returncode == 0
    write_obj(workspace / "late.obj", *box_mesh())
    done = run(workspace, {"late": {"source": "late.obj"}})
    assert "Updated input files: late.obj" in done.stdout


def test_defect_shows_its_traceback(workspace):
    source = workspace / "workflow/pandis/pipeline/mesh/build.py"
    source.write_text(source.read_text().replace("shape = find_shape(name)", "shape = 1 / 0"))
    done = run(workspace, {"a": {"source": "analytic:box"}})
    assert done.returncode != 0
    assert done.stdout.count("ZeroDivisionError: division by zero") == 1
    assert "Traceback" in (workspace / "results/logs/a/mesh.log").read_text()


@pytest.fixture
def server(tmp_path):
    """A web server on this machine that has one mesh."""
    folder = tmp_path / "served"
    folder.mkdir()
    write_obj(folder / "box.obj", *box_mesh())

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, directory=str(folder), **options)

        def log_message(self, *arguments):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Quiet) as served:
        thread = threading.Thread(target=served.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{served.server_port}", folder
        served.shutdown()
        thread.join()


def test_mesh_from_a_url(workspace, server):
    address, folder = server
    digest = hashlib.sha256((folder / "box.obj").read_bytes()).hexdigest()
    meshes = {
        "fetched": {"source": f"{address}/box.obj", "sha256": digest},
        "changed": {"source": f"{address}/box.obj", "sha256": "0" * 64},
        "absent": {"source": f"{address}/none.obj", "sha256": digest},
    }
    done = run(workspace, meshes)
    assert done.returncode != 0
    assert f"file's sha256 is {digest}, but the configuration says 00" in done.stdout
    assert "none.obj: cannot be fetched (HTTP Error 404" in done.stdout
    assert (workspace / "results/fetched/mesh.zarr.zip").is_file()
    assert not list((workspace / "results/changed").glob("source*"))
    del meshes["changed"], meshes["absent"]
    assert "Nothing to be done" in run(workspace, meshes).stdout


SMALL = {
    "fields": ["exact", "nearest-12"],
    "trajectory": {"samples": 50, "deep": 0.01},
    "evaluation": {"probes": 500},
    "stress": {"ticks": 1000, "loops": 5},
    "timing": {"queries": 100, "batch": 100, "cold": 0},
    "hardware": {"seconds": 0.05, "loaded_seconds": 0},
}
SHEET = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n"


@pytest.mark.full
def test_a_refused_mesh_costs_itself_alone_and_a_complete_run_makes_the_report_anew(workspace):
    write_obj(workspace / "good.obj", *box_mesh())
    (workspace / "sheet.obj").write_text(SHEET)
    good = {"good": {"source": "good.obj"}}
    bad = {
        "sheet": {"source": "sheet.obj"},
        "gone": {"source": "gone.obj"},
        "odd": {"source": "good.obj", "stress": {"ticks": 1}},
    }
    assert run(workspace, good, "all", **SMALL).returncode == 0
    report, summary = (workspace / "results" / name for name in ("report.html", "summary.csv"))
    whole = summary.read_text()
    done = run(workspace, good | bad, "all", **SMALL)
    assert done.returncode == 1
    for message in (
        "refused: odd: meshes.odd.stress.ticks: Input should be greater than or equal to 1000",
        "refused: gone: meshes.gone.source: there is no file 'gone.obj'",
        "the mesh lies in one plane",
        "the meshes that could be built (1) and give reasons for those left out: odd, gone, sheet",
    ):
        assert message in done.stdout
    assert "Traceback" not in done.stdout
    page, rows = report.read_text(), summary.read_text().splitlines()
    for name in bad:
        assert f"<td>{name}</td>" in page
        assert any(row.startswith(f"{name},") for row in rows)
    assert "mesh: {open: thicken}" in page
    assert 'id="good"' in page
    check = run(workspace, good | bad, "verify", **SMALL)
    assert check.returncode == 1
    assert "leaves out the meshes that a run could not build" in check.stdout
    # nothing of the good one is built again, and both files are made anew
    done = run(workspace, good, "all", **SMALL)
    assert done.returncode == 0, done.stdout
    assert summary.read_text() == whole
    assert not (workspace / "results/refused.json").exists()
    assert "could not be built" not in report.read_text()
    assert run(workspace, good, "verify", **SMALL).returncode == 0
    assert "Nothing to be done" in run(workspace, good, "all", **SMALL).stdout


def test_a_missing_source_never_loses_what_was_built_from_it(workspace):
    write_obj(workspace / "good.obj", *box_mesh())
    write_obj(workspace / "other.obj", *box_mesh())
    meshes = {"good": {"source": "good.obj"}, "other": {"source": "other.obj"}}
    assert run(workspace, meshes).returncode == 0
    (workspace / "other.obj").unlink()
    assert run(workspace, meshes).returncode == 1
    assert (workspace / "results/other/mesh.zarr.zip").is_file()


def test_a_mesh_compressed_by_an_unknown_extension_is_refused_by_its_name(workspace):
    box = trimesh.Scene(trimesh.creation.box((1.0, 1.0, 0.8)))
    for name, data in trimesh.exchange.gltf.export_gltf(box).items():
        (workspace / name).write_bytes(data)
    scene = json.loads((workspace / "model.gltf").read_text())
    scene["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    (workspace / "model.gltf").write_text(json.dumps(scene))
    done = run(workspace, {"part": {"source": "model.gltf"}})
    assert "compressed with KHR_draco_mesh_compression, which is not supported" in done.stdout


def test_ctrl_c_ends_in_a_sentence_and_keeps_the_training(workspace):
    edit(workspace / "config/fast.yaml", "steps: 300", "steps: 200000")
    model = "results/sphere/model-pandis-exact.zarr.zip"
    command = snakemake_command("-j2", model, "--configfile", "config/fast.yaml")
    with subprocess.Popen(
        command,
        cwd=workspace,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as started:
        said = []
        for line in started.stdout:
            said.append(line)
            if "train pandis-exact: training:" in line and len(said) < 10_000:
                os.killpg(started.pid, signal.SIGINT)
                break
        said += started.stdout.readlines()
    text = "".join(said)
    assert started.returncode != 0
    assert "Traceback" not in text
    assert re.search("checkpoint at step [1-9]", text)
    assert "interrupted; run the same command again to go on" in text
    again = snakemake(workspace, "-n", model, "--configfile", "config/fast.yaml")
    assert again.returncode == 0, again.stdout
