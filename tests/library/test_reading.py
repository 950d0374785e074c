"""Reading: every format, four hundred files with what is right for each, refusals in plain words.

What a file contains is stated by `counter.py` and `cases.py`, which share no code with the readers.
"""

import gzip
import os
import re
import zipfile

import numpy as np
import pytest
import trimesh

from cases import CASES, Reads, mutations
from casework.packages import model, package
from counter import Refused, count
from pandis.base.errors import PandisError
from pandis.pipeline.geometry.shapes import find_shape
from pandis.pipeline.mesh import tools
from pandis.pipeline.mesh.cleanup import clean, orient
from pandis.pipeline.mesh.diagnosis import diagnose
from pandis.pipeline.mesh.formats import FormatError, ply, read
from pandis.pipeline.mesh.intake import check_arrays, find_file, read_mesh, unpacked
from pandis.pipeline.mesh.polygons import triangulate_polygons
from support import box_mesh, octahedron, write_obj
from validity import assert_valid, volume


@pytest.mark.parametrize("ending", ["obj", "off", "ply", "stl", "glb", "3mf", "obj.gz", "3mf.gz"])
def test_formats(tmp_path, ending):
    vertices, faces = box_mesh()
    path = tmp_path / f"part.{ending}"
    plain = tmp_path / f"part.{ending.removesuffix('.gz')}"
    trimesh.Trimesh(vertices, faces, process=False).export(plain)
    if ending.endswith(".gz"):
        path.write_bytes(gzip.compress(plain.read_bytes()))
    reading, record = read_mesh("part", path)
    assert len(reading.faces) == len(faces)
    assert record["format"] == ending.split(".")[0]
    assert record["notes"] == []
    assert_valid(*clean(reading.vertices, reading.faces))


@pytest.mark.parametrize("form", ["obj", "3mf"])
def test_coordinates_are_read_to_the_last_bit(tmp_path, form):
    vertices, faces = octahedron()
    vertices = vertices * np.pi + 1e-17
    path = tmp_path / f"o.{form}"
    if form == "obj":
        write_obj(path, vertices, faces)
    else:
        path.write_bytes(package({"/3D/3dmodel.model": model({1: (vertices, faces)}, [1])}))
    reading, _ = read_mesh("o", path)
    assert reading.vertices.tobytes() == vertices.tobytes()
    assert np.array_equal(reading.faces, faces)


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
    assert "line 1: 'nan' is not a number" in refuse(obj, octa.replace(b"v 1.0", b"v nan", 1))
    assert "line 1: 'inf' is not a number" in refuse(obj, octa.replace(b"v 1.0", b"v inf", 1))
    long = b"1" * 200_000 + b"x"  # reading it must not take the square of its length
    assert "line 1: '1111" in refuse(obj, octa.replace(b"v 1.0", b"v " + long, 1))
    assert "unknown format '.step'; the known formats are .obj" in refuse(tmp_path / "a.step", b"x")
    assert "unknown format" in refuse(tmp_path / "noending", b"x")
    assert "the configuration says 00" in refuse(obj, octa, sha256="0" * 64)
    assert "triangles, but there are 8" in refuse(tmp_path / "a.stl", os.urandom(500))
    assert "not a complete gzip" in refuse(tmp_path / "a.obj.gz", gzip.compress(octa)[:-20])
    assert "extent" in refuse(obj, b"v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n")
    with pytest.raises(PandisError, match="there is no file"):
        find_file(str(tmp_path / "missing.obj"))
    with pytest.raises(PandisError, match=r"ships no 'bnny.obj'; it has .*bunny\.obj"):
        find_file("pymeshlab:bnny.obj")
    with pytest.raises(PandisError, match="closed-form shapes are analytic:sphere"):
        find_shape("spher")


def test_a_child_that_crashes_hangs_or_grows_is_reported(tmp_path, monkeypatch):
    path = write_obj(tmp_path / "a.obj", *octahedron())
    with pytest.raises(PandisError, match="took longer than 0.01 s; raise mesh.reader_s"):
        read_mesh("a.obj", path, seconds=0.01)
    with pytest.raises(PandisError, match="a.obj: .*"):
        read_mesh("a.obj", path, memory_gb=0.05)
    monkeypatch.setattr(tools.sys, "executable", str(crashing(tmp_path)))
    with pytest.raises(PandisError, match="crashed \\(signal 11\\).*defect of pandis"):
        read_mesh("a.obj", path)


def crashing(folder):
    script = folder / "python"
    script.write_text("#!/bin/sh\nkill -SEGV $$\n")
    script.chmod(0o755)
    return script


def outcome(path):
    """What reading a file here comes to: a reading, or what it is refused with."""
    name = path.name.removesuffix(".gz")
    try:
        with unpacked(path.name, path) as plain:
            reading = read(plain, name.rsplit(".", 1)[-1], path.parent)
        check_arrays(reading.vertices, reading.faces)
    except (PandisError, FormatError) as error:
        return str(error)
    return reading


def as_lists(found):
    """Return an outcome as something that can be compared."""
    if isinstance(found, str):
        return found
    return [a.tolist() if isinstance(a, np.ndarray) else a for a in found]


def wrong(found, right):
    """Say what is wrong with an outcome; empty if nothing."""
    if isinstance(found, str):
        return found if isinstance(right, Reads) else right.lacks(found)
    corners = found.vertices[found.faces]
    a, b, c = corners.transpose(1, 0, 2)
    size = np.einsum("ij,ij->", a, np.cross(b, c)) / 6  # from the origin, also of what is open
    told = len(found.faces), size, corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    return right.differs(*told) if isinstance(right, Reads) else f"read: {told}"


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_file_is_read_as_it_was_meant_or_refused_with_its_place(case, tmp_path):
    found = outcome(case.write(tmp_path))
    answers = [case.right] + ([case.otherwise] if case.either else [])
    assert not all(wrong(found, right) for right in answers), [wrong(found, r) for r in answers]


@pytest.mark.slow
def test_lines_of_an_obj_that_are_read_in_runs_mean_what_they_mean_one_by_one(tmp_path):
    """No run contains a line that begins with a space."""
    rng, path = np.random.default_rng(0), tmp_path / "runs.obj"
    usual = ["v 0 0 0", "v 1 -2.5 3e-4", "v\t.5 5. +1"]
    usual += ["f 1 2 3", "f 1/1 2/2/2 3//3", "f 3/ 2 1"]
    others = """v 1 2 3 ,v 1 2,v 1 2 3 4 5 6,v 1 2 nan,v 1 2 1e999,v 1 2 3 # c,v\v1 2 3,v 1 \\,\\,
    f 1 2 3 4,f 1 2,f -1 -2 -3,f 1 2 0,f 1 2 99,f 1 2 3///,f 01 2 3,F 1 2 3,f 1 2 3 #,f 1 2 \\,
    usemtl a,usemtl b,,# c,g x,zz 1 2 3"""
    lines = usual * 6 + others.replace("\n    ", "").split(",")
    read_all = 0
    for _ in range(4_000):
        chosen = [lines[i] for i in rng.integers(len(lines), size=rng.integers(12))]
        ends = rng.choice(["\n", "\n", "\n", "\r\n", "\r", ""], size=len(chosen))
        text = "v 0 0 0\nv 1 0 0\nv 0 1 0\n" + "".join(map("".join, zip(chosen, ends, strict=True)))
        path.write_text(text, newline="")
        in_runs = as_lists(outcome(path))
        path.write_text(re.sub(r"(\A|\r\n|\r|\n)", r"\1 ", text), newline="")
        assert in_runs == as_lists(outcome(path)), text
        read_all += not isinstance(in_runs, str)
    assert 400 < read_all < 3_600


def test_what_is_changed_at_random_is_refused_or_read_as_the_counter_does(tmp_path):
    """The core of tests/benchmarks/mutations.py, which changes two hundred thousand files."""
    rng, path = np.random.default_rng(0), tmp_path / "mutated"
    both = 0
    for case in CASES[::4]:
        (name, data), *_ = case.files.items()
        form = name.rsplit(".", 1)[-1]
        if form == "gz":
            continue
        for mutated in mutations(data, form, rng, 12):
            path.write_bytes(mutated)
            try:
                found = read(path, form)  # whatever else it raises is a defect
                check_arrays(found.vertices, found.faces)
                counted = count(path.rename(tmp_path / f"counted.{form}"))
            except (FormatError, Refused):
                continue
            both += 1
            corners = found.vertices[found.faces]
            assert len(found.faces) == counted.triangles
            assert np.allclose(corners.min(axis=(0, 1)), counted.low)
            assert np.allclose(corners.max(axis=(0, 1)), counted.high)
    assert both > 50


def test_rows_of_a_ply_that_are_read_at_once_mean_what_they_mean_one_by_one(tmp_path, monkeypatch):
    """No row that is read at once begins with a vertical tab."""
    rng, path = np.random.default_rng(0), tmp_path / "rows.ply"
    points = ["0 0 0", "1 -2.5 3e-4", "\t.5 5. +1 "] * 8
    points += [
        "1 2",
        "1 2 3 4",
        "1 2 nan",
        "1 2 1e999",
        "1 2 1-2",
        "1 2 - 3",
        "1 2 3#",
        "1 2 3 # c",
        "",
        "1 1_0 2",
    ]
    corners = ["3 0 1 2", "3\t2 1 0", " 3 1 2 0 "] * 8
    corners += [
        "4 0 1 2 3",
        "3 0 1",
        "3 0 1 2 3",
        "2 0 1",
        "3 -1 0 1",
        "3 0 1 9",
        "3.0 0 1 2",
        "03 0 1 2",
        "+3 0 1 2",
    ]
    corners += ["3 0 1 1e0", "3 0 1 2 # c", "", "3 0 1 2222222222222222222", "3 0 1 02"]
    read_all, at_a_time = 0, []
    run = ply._Text._run
    monkeypatch.setattr(ply._Text, "_run", lambda *a: at_a_time.append(run(*a)) or at_a_time[-1])
    for _ in range(2_000):
        rows = ["0 0 0", "1 0 0", "0 1 0"], ["3 0 1 2"]
        for part, pool in zip(rows, (points, corners), strict=True):
            part += [pool[i] for i in rng.integers(len(pool), size=rng.integers(4))]
        counts = [len(part) + (rng.random() < 0.1) - (rng.random() < 0.1) for part in rows]
        if rng.random() < 0.02:
            counts[rng.integers(2)] = 10**12
        text = (
            f"ply\nformat ascii 1.0\nelement vertex {counts[0]}\nproperty float x\n"
            f"property double y\nproperty int z\nelement face {counts[1]}\n"
            "property list uchar int vertex_indices\n"
        )
        more = rng.integers(4)  # a further element of faces, of strips, or none
        if more < 2:
            name = ("face", "tristrips")[more]
            text += f"element {name} 1\nproperty list uchar int vertex_indices\n"
            rows[1].append("3 2 1 0")
        text += "end_header\n"
        ends = rng.choice(["\n"] * 6 + ["\r\n", "\r", ""], size=len(rows[0] + rows[1]))
        body = "".join(map("".join, zip(rows[0] + rows[1], ends, strict=True)))
        path.write_text(text + body, newline="")
        at_once = as_lists(outcome(path))
        path.write_text(text + re.sub(r"(\A|\r\n|\r|\n)", "\\1\v", body), newline="")
        assert at_once == as_lists(outcome(path)), body
        read_all += not isinstance(at_once, str)
    assert 200 < read_all < 1_800
    assert sum(columns is not None for columns in at_a_time) > 400


def test_strips_of_a_ply_are_triangles(tmp_path):
    header = (
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
        "property float z\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    )
    path = tmp_path / "strip.ply"
    path.write_text(header + "0 0 0\n1 0 0\n0 1 0\n0 0 1\n6 0 1 2 3 0 1\n")
    reading, _ = read_mesh("strip", path)
    assert (len(reading.vertices), len(reading.faces)) == (4, 4)
    more = "element face 2\nproperty list uchar int vertex_index\nend_header\n"
    path.write_text(
        header.replace("tristrips 1", "face 1").replace("end_header\n", more)
        + "0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n4 0 3 2 1\n"
    )
    joined = read(path, "ply").faces.tolist()
    assert joined[:2] == [[0, 2, 1], [0, 1, 3]]
    assert len(joined) == 4
    assert_valid(*orient(reading.vertices, reading.faces))


@pytest.mark.full
def test_a_nested_placement_is_refused_before_it_fills_the_memory(tmp_path):
    """Two children each, forty levels down: a short file that places a million million parts."""
    core = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
    triangle = (
        '<vertices><vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/>'
        '<vertex x="0" y="1" z="0"/></vertices>'
        '<triangles><triangle v1="0" v2="1" v3="2"/></triangles>'
    )
    objects = f'<object id="1"><mesh>{triangle}</mesh></object>'
    for level in range(2, 42):
        two = f'<component objectid="{level - 1}"/>' * 2
        objects += f'<object id="{level}"><components>{two}</components></object>'
    model = (
        f'<model unit="millimeter" xmlns="{core}"><resources>{objects}</resources>'
        '<build><item objectid="41"/></build></model>'
    )
    with zipfile.ZipFile(tmp_path / "bomb.3mf", "w") as package:
        package.writestr("3D/3dmodel.model", model)
    with pytest.raises(PandisError, match="places more than a million parts"):
        read_mesh("bomb.3mf", tmp_path / "bomb.3mf", seconds=60)


def test_check_arrays():
    vertices, faces = octahedron()
    check_arrays(np.concatenate([vertices, [[np.nan] * 3]]), faces)  # a stray vertex is no fault
    with pytest.raises(FormatError, match="3 of 6 vertices are NaN or infinite"):
        check_arrays(np.where(vertices > 0.5, np.nan, vertices), faces)
    with pytest.raises(FormatError, match="it has no faces"):
        check_arrays(vertices, faces[:0])


def test_scene_with_node_transforms_is_baked(tmp_path):
    vertices, faces = octahedron()
    scene = trimesh.Scene()
    ball = trimesh.Trimesh(vertices, faces, process=False)
    scene.add_geometry(ball, geom_name="ball", node_name="a")
    shift = trimesh.transformations.translation_matrix([5, 0, 0])
    scene.graph.update("b", geometry="ball", matrix=shift @ np.diag([2.0, 2, 2, 1]))
    scene.export(tmp_path / "scene.glb")
    reading, _ = read_mesh("scene", tmp_path / "scene.glb")
    assert len(reading.faces) == 16
    assert volume(reading.vertices, reading.faces) == pytest.approx(4 / 3 * (1 + 8))
    assert reading.vertices.max(axis=0).tolist() == [7, 2, 2]
    assert reading.unit == "m"


# --- polygons ---------------------------------------------------------------------------


def test_concave_polygons_are_covered_not_fanned(tmp_path):
    """An L-shaped prism, its ends as six-cornered faces; a fan from corner 0 folds over."""
    outline = [[1, 1], [0, 1], [0, 0], [2, 0], [2, 2], [1, 2]]
    lines = [f"v {x} {y} {z}" for z in (0, 1) for x, y in outline]
    lines += ["f 6 5 4 3 2 1", "f -6 -5 -4 \\", " -3 -2 -1"]
    lines += [f"f {i + 1} {(i + 1) % 6 + 1} {(i + 1) % 6 + 7} {i + 7}" for i in range(6)]
    path = tmp_path / "prism.obj"
    path.write_text("\n".join(lines) + "\n")
    vertices, faces = read_mesh("prism", path)[0][:2]
    assert len(faces) == 4 + 4 + 12
    assert_valid(vertices, faces)
    assert volume(vertices, faces) == pytest.approx(3)
    fans = trimesh.load_mesh(path, process=False)
    assert diagnose(*clean(fans.vertices, fans.faces)).self_intersections  # why this is ours


def test_convex_polygons_are_cut_as_readers_do():
    angle = 2 * np.pi * np.arange(7) / 7
    vertices = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    assert triangulate_polygons(vertices, [list(range(7))]).tolist() == [
        [0, i, i + 1] for i in range(1, 6)
    ]


def test_a_reader_whose_package_is_missing_says_what_to_install(tmp_path, monkeypatch):
    path = tmp_path / "part.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "lxml.py").write_text("import a_package_that_is_missing")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(PandisError, match=r"part: its reader needs a package: .*fields\[make\]"):
        read_mesh("part", path)
    monkeypatch.delenv("PYTHONPATH")
    assert len(read_mesh("part", path)[0].faces) == 1
