"""What a user may get wrong: a sentence that names the file or key and the remedy."""

import hashlib
import http.server
import threading

import pytest
import yaml

from support import box_mesh, octahedron, snakemake, write_obj


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
        "nofaces.obj: no reader finds a usable mesh in it (trimesh: no faces",
        "nan.obj: 1 of 98 vertices are NaN or infinite",
        "infinite.obj: 1 of 98 vertices are NaN or infinite",
        "part.step: unknown format '.step'; known are .obj",
        "fine.obj: the file's sha256 is",
        "'analytic:spere' is unknown; closed-form shapes are analytic:sphere",
        "PyMeshLab ships no 'bunnny.obj'",
        "the mesh is open: 4 boundary edges",
        "Other meshes went on.",
    ):
        assert message in done.stdout
    assert "Traceback" not in done.stdout
    finished = {p.parent.name for p in (workspace / "results").glob("*/mesh.zarr.zip")}
    assert finished == {"good", "fine"}


@pytest.mark.parametrize(
    ("meshes", "sections", "message"),
    [
        ({"logs": {"source": "a.obj"}}, {}, "meshes.logs: this name is taken"),
        ({"a": {"source": "a.obj"}}, {"fields": ["tricubik-64"]}, "'tricubik-64' is no field"),
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
    assert "config/bad.yaml, line 4: the key 'a' stands twice" in done.stdout


def test_file_that_appears_later_is_taken_up(workspace):
    assert run(workspace, {"late": {"source": "late.obj"}}).returncode != 0
    write_obj(workspace / "late.obj", *octahedron())
    assert run(workspace, {"late": {"source": "late.obj"}}).returncode == 0
    write_obj(workspace / "late.obj", *box_mesh())
    done = run(workspace, {"late": {"source": "late.obj"}})
    assert "Updated input files: late.obj" in done.stdout


def test_defect_shows_its_traceback(workspace):
    source = workspace / "workflow/pandis/mesh/build.py"
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
    assert f"the sha256 of what came is {digest}, the configuration says 00" in done.stdout
    assert "none.obj: cannot be fetched (HTTP Error 404" in done.stdout
    assert (workspace / "results/fetched/mesh.zarr.zip").is_file()
    assert not list((workspace / "results/changed").glob("source*"))
    del meshes["changed"], meshes["absent"]
    assert "Nothing to be done" in run(workspace, meshes).stdout
