"""Reading: every format, every reader's known faults, refusals in plain words."""

import gzip
import json
import os
import struct

import numpy as np
import pytest

from pandis.errors import PandisError
from pandis.geometry.shapes import find_shape
from pandis.mesh import tools
from pandis.mesh.cleanup import clean, orient
from pandis.mesh.declared import Declared, declared
from pandis.mesh.diagnosis import diagnose
from pandis.mesh.intake import check_arrays, choose, find_file, read_mesh
from pandis.mesh.polygons import triangulate_polygons
from support import box_mesh, octahedron, write_obj
from validity import assert_valid, volume


@pytest.mark.parametrize("ending", ["obj", "off", "ply", "stl", "glb", "3mf", "obj.gz", "3mf.gz"])
def test_formats(tmp_path, ending):
    import trimesh

    vertices, faces = box_mesh()
    path = tmp_path / f"part.{ending}"
    plain = tmp_path / f"part.{ending.removesuffix('.gz')}"
    trimesh.Trimesh(vertices, faces, process=False).export(plain)
    if ending.endswith(".gz"):
        path.write_bytes(gzip.compress(plain.read_bytes()))
    read, read_faces, record = read_mesh("part", path)
    assert len(read_faces) == len(faces)
    assert record["format"] == ending.split(".")[0]
    assert record["passed_over"] == {}
    assert_valid(*clean(read, read_faces))


def test_obj_is_read_to_the_last_bit(tmp_path):
    vertices, faces = octahedron()
    vertices = vertices * np.pi + 1e-17
    read, read_faces, _ = read_mesh("o", write_obj(tmp_path / "o.obj", vertices, faces))
    assert read.tobytes() == vertices.tobytes()
    assert np.array_equal(read_faces, faces)


def refuse(path, content, **options):
    path.write_bytes(content)
    with pytest.raises(PandisError) as caught:
        read_mesh(str(path), find_file(str(path)), **options)
    assert str(path) in str(caught.value)
    return str(caught.value)


def test_refusals_name_the_file_and_the_remedy(tmp_path):
    obj = tmp_path / "a.obj"
    assert "the file is empty; export" in refuse(obj, b"")
    assert "no faces" in refuse(obj, b"v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    octa = write_obj(obj, *octahedron()).read_bytes()
    assert "NaN or infinite" in refuse(obj, octa.replace(b"v 1.0", b"v nan", 1))
    assert "NaN or infinite" in refuse(obj, octa.replace(b"v 1.0", b"v inf", 1))
    assert "unknown format '.step'; known are .obj" in refuse(tmp_path / "a.step", b"x")
    assert "unknown format" in refuse(tmp_path / "noending", b"x")
    assert "the configuration says 00" in refuse(obj, octa, sha256="0" * 64)
    assert "no reader finds a usable mesh" in refuse(tmp_path / "a.stl", os.urandom(500))
    assert "not a whole gzip" in refuse(tmp_path / "a.obj.gz", gzip.compress(octa)[:-20])
    assert "extent" in refuse(obj, b"v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n")
    with pytest.raises(PandisError, match="there is no file"):
        find_file(str(tmp_path / "missing.obj"))
    with pytest.raises(PandisError, match=r"ships no 'bnny.obj'; it has .*bunny\.obj"):
        find_file("pymeshlab:bnny.obj")
    with pytest.raises(PandisError, match="closed-form shapes are analytic:sphere"):
        find_shape("spher")


def test_a_child_that_crashes_hangs_or_grows_is_reported(tmp_path, monkeypatch):
    path = write_obj(tmp_path / "a.obj", *octahedron())
    with pytest.raises(tools.ToolError, match="took longer than 0.01 s"):
        tools.call("read_trimesh", path=str(path), seconds=0.01, memory_gb=3)
    with pytest.raises(tools.ToolError):
        tools.call("read_trimesh", path=str(path), seconds=60, memory_gb=0.05)
    module = tmp_path / "crash.py"
    module.write_text("import os, signal\nos.kill(os.getpid(), signal.SIGSEGV)\n")
    monkeypatch.setattr(tools.sys, "executable", str(crashing(tmp_path)))
    with pytest.raises(tools.ToolError, match="crashed \\(signal 11\\)"):
        tools.call("read_trimesh", path=str(path), seconds=60, memory_gb=3)


def crashing(folder):
    script = folder / "python"
    script.write_text("#!/bin/sh\nkill -SEGV $$\n")
    script.chmod(0o755)
    return script


def test_second_reader_takes_over(tmp_path):
    """PLY triangle strips: trimesh finds no face in them, PyMeshLab reads them."""
    header = (
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
        "property float z\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    )
    path = tmp_path / "strip.ply"
    path.write_text(header + "0 0 0\n1 0 0\n0 1 0\n0 0 1\n6 0 1 2 3 0 1\n")
    vertices, faces, record = read_mesh("strip", path)
    assert (len(vertices), len(faces)) == (4, 4)
    assert record["reader"] == "pymeshlab"
    assert "trimesh" in record["passed_over"]
    assert_valid(*orient(vertices, faces))


def test_check_arrays():
    vertices, faces = octahedron()
    check_arrays(np.concatenate([vertices, [[np.nan] * 3]]), faces)  # a stray vertex is no fault
    with pytest.raises(tools.ToolError, match="not there"):
        check_arrays(vertices, faces + 1)


# --- what the file declares -----------------------------------------------------------


def test_a_reader_that_loses_faces_is_passed_over(tmp_path, monkeypatch):
    """The file says eight triangles; a reader that finds six is not believed."""
    path = write_obj(tmp_path / "o.obj", *octahedron())
    honest = tools.call

    def call(operation, *arguments, **options):
        vertices, faces = honest(operation, *arguments, **options)
        return vertices, faces[:6] if operation == "read_trimesh" else faces

    monkeypatch.setattr(tools, "call", call)
    _, faces, record = read_mesh("o", path)
    assert len(faces) == 8
    assert record["reader"] == "pymeshlab"
    assert record["passed_over"]["trimesh"] == "finds 6 triangles, the file declares 8"
    assert record["declared_triangles"] == "8"


def test_where_all_readers_disagree_with_the_file_the_majority_counts():
    def mesh(n):
        return None, np.zeros((n, 3))

    says = Declared(8, exact=True)
    assert choose({"a": mesh(6), "b": mesh(5), "c": mesh(5)}, says) == "b"
    assert choose({"a": mesh(6), "b": mesh(8), "c": mesh(6)}, says) == "b"
    assert choose({"a": mesh(6), "b": mesh(7)}, says) == "b"
    assert choose({"a": mesh(6)}, None) == "a"


def test_declared_counts(tmp_path):
    def says(name, content):
        path = tmp_path / name
        path.write_bytes(content)
        return declared(path, name.split(".")[-1])

    obj = b"v 0 0 0\nf 1 2 3 4 \\\n 5\n  f 1/1 2/2 3/3 # f 1 2 3\n"
    assert says("a.obj", obj) == Declared(4, exact=True, polygons=True)
    ply = b"ply\nformat ascii 1.0\nelement vertex 3\nelement face 7\nend_header\n"
    assert says("a.ply", ply) == Declared(7, exact=False)
    assert Declared(7, exact=False).agrees(9)
    assert not Declared(7, exact=True).agrees(9)
    assert says("a.off", b"OFF # x\n8 6 0\n").triangles == 6
    assert says("a.stl", b"solid a\nendfacet\n endfacet\nendsolid").triangles == 2
    assert says("b.stl", bytes(80) + struct.pack("<I", 2) + bytes(100)).triangles == 2
    assert says("c.stl", os.urandom(90)) is None
    assert says("a.3mf", b"x") is None
    scene = {
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0, "children": [2]}, {"mesh": 0}, {"mesh": 1}, {"mesh": 1}],
        "meshes": [
            {"primitives": [{"indices": 0, "attributes": {}}]},
            {"primitives": [{"attributes": {"POSITION": 1}, "mode": 5}]},
        ],
        "accessors": [{"count": 36}, {"count": 10}],
    }
    text = json.dumps(scene).encode()
    assert says("a.gltf", text).triangles == 12 + 12 + 8  # the last node is in no scene
    assert says("a.glb", struct.pack("<5I", 0, 2, 0, len(text), 0) + text).triangles == 32
    assert says("b.gltf", b"{}") is None


def test_scene_with_node_transforms_is_baked(tmp_path):
    import trimesh

    vertices, faces = octahedron()
    scene = trimesh.Scene()
    ball = trimesh.Trimesh(vertices, faces, process=False)
    scene.add_geometry(ball, geom_name="ball", node_name="a")
    shift = trimesh.transformations.translation_matrix([5, 0, 0])
    scene.graph.update("b", geometry="ball", matrix=shift @ np.diag([2.0, 2, 2, 1]))
    scene.export(tmp_path / "scene.glb")
    read, read_faces, _ = read_mesh("scene", tmp_path / "scene.glb")
    assert len(read_faces) == 16
    assert volume(read, read_faces) == pytest.approx(4 / 3 * (1 + 8))
    assert read.max(axis=0).tolist() == [7, 2, 2]


# --- polygons ---------------------------------------------------------------------------


def test_concave_polygons_are_covered_not_fanned(tmp_path):
    """An L-shaped prism, its ends as six-cornered faces; a fan from corner 0 folds over."""
    outline = [[1, 1], [0, 1], [0, 0], [2, 0], [2, 2], [1, 2]]
    lines = [f"v {x} {y} {z}" for z in (0, 1) for x, y in outline]
    lines += ["f 6 5 4 3 2 1", "f -6 -5 -4 \\", " -3 -2 -1"]
    lines += [f"f {i + 1} {(i + 1) % 6 + 1} {(i + 1) % 6 + 7} {i + 7}" for i in range(6)]
    path = tmp_path / "prism.obj"
    path.write_text("\n".join(lines) + "\n")
    vertices, faces, record = read_mesh("prism", path)
    assert record["reader"] == "polygons"
    assert len(faces) == 4 + 4 + 12
    assert_valid(vertices, faces)
    assert volume(vertices, faces) == pytest.approx(3)
    fan_vertices, fan_faces = tools.call("read_trimesh", path=str(path), seconds=60, memory_gb=3)
    assert diagnose(*clean(fan_vertices, fan_faces)).self_intersections  # why this is ours


def test_convex_polygons_are_cut_as_readers_do():
    angle = 2 * np.pi * np.arange(7) / 7
    vertices = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    assert triangulate_polygons(vertices, [list(range(7))]).tolist() == [
        [0, i, i + 1] for i in range(1, 6)
    ]
    with pytest.raises(ValueError, match="not there"):
        triangulate_polygons(vertices, [[0, 1, 2, 7]])
