"""Intake and repair: known answers, every fault class, refusals in plain words."""

import gzip
import os

import igl
import numpy as np
import pytest

from pandis.config import MeshOptions
from pandis.errors import PandisError
from pandis.mesh import tools
from pandis.mesh.build import build
from pandis.mesh.diagnosis import diagnose
from pandis.mesh.intake import check_arrays, find_file, read_mesh
from pandis.mesh.repair import clean, deviation, orient, repair, resolve_duplicates
from pandis.mesh.shapes import SHAPES, find_shape
from support import box_mesh, octahedron, write_obj

OPTIONS = MeshOptions().model_dump()


def fix(vertices, faces, **options):
    return repair(vertices, np.asarray(faces, np.int64), OPTIONS | options, log=lambda text: None)


def valid(vertices, faces):
    """Closed, manifold, consistent and outward, by code that shares nothing with the library."""
    edges = {}
    for face in faces.tolist():
        for a, b in zip(face, face[1:] + face[:1], strict=True):
            edges.setdefault(frozenset((a, b)), []).append((a, b))
    assert all(len(e) == 2 and e[0] == e[1][::-1] for e in edges.values())
    points = np.random.default_rng(0).uniform(vertices.min(0), vertices.max(0), (2000, 3))
    turns = igl.winding_number(vertices, np.asarray(faces, np.int64), points)
    off = np.abs(turns[:, None] - [0.0, 1.0]).min(axis=1)
    assert off.max() < 1e-3
    return True


def test_valid_mesh_passes_bit_identical():
    vertices, faces = box_mesh()
    vertices = vertices + np.random.default_rng(0).normal(0, 1e-3, vertices.shape)
    fixed, fixed_faces, record = fix(vertices, faces)
    assert fixed.tobytes() == vertices.tobytes()
    assert np.array_equal(fixed_faces, faces)
    assert record["rungs"] == []


def test_soup_is_welded():
    vertices, faces = box_mesh()
    soup = vertices[faces].reshape(-1, 3)
    fixed, fixed_faces, record = fix(soup, np.arange(len(soup)).reshape(-1, 3))
    assert valid(fixed, fixed_faces)
    assert len(fixed) == len(vertices)
    assert [rung["rung"] for rung in record["rungs"]] == ["clean"]


def test_last_bit_cracks_are_welded_by_tolerance():
    vertices, faces = octahedron()
    soup = vertices[faces].reshape(-1, 3)
    soup = soup + np.random.default_rng(1).uniform(-1, 1, soup.shape) * 1e-10
    fixed, fixed_faces, record = fix(soup, np.arange(24).reshape(-1, 3))
    assert valid(fixed, fixed_faces)
    assert len(fixed) == 6
    assert "weld" in [rung["rung"] for rung in record["rungs"]]
    with pytest.raises(PandisError):
        fix(soup, np.arange(24).reshape(-1, 3), weld=0, max_hole_edges=0)


def test_every_pair_within_the_tolerance_is_welded():
    """A lattice would part one pair in seven at a sixth of the tolerance."""
    rng = np.random.default_rng(0)
    base = rng.uniform(-1, 1, (2000, 3))
    offset = rng.normal(size=base.shape)
    offset *= 1e-9 / np.linalg.norm(offset, axis=1, keepdims=True)
    vertices = np.concatenate([base, base + offset])
    faces = np.arange(2000).reshape(-1, 2)
    faces = np.concatenate([faces, faces[::-1, :1] + 2000], axis=1)  # mixes both copies
    kept, _ = clean(vertices, faces, tolerance=1.7e-9)
    gaps = np.linalg.norm(kept[:, None] - kept[None], axis=2)[~np.eye(len(kept), dtype=bool)]
    assert gaps.min() > 1.7e-9


def test_inside_out_is_turned():
    vertices, faces = box_mesh()
    fixed, fixed_faces, record = fix(vertices, faces[:, ::-1])
    assert record["before"]["volume"] < 0 < record["after"]["volume"]
    assert valid(fixed, fixed_faces)


def test_random_flips_are_made_consistent():
    vertices, faces = box_mesh()
    faces = faces.copy()
    some = np.random.default_rng(2).random(len(faces)) < 0.3
    faces[some] = faces[some][:, ::-1]
    fixed, fixed_faces, record = fix(vertices, faces)
    assert record["before"]["orientation_conflicts"] > 0
    assert valid(fixed, fixed_faces)


def test_cavity_stays_a_cavity_and_island_an_island():
    vertices, faces = box_mesh()
    n = len(vertices)
    nested = np.concatenate([vertices, vertices * 0.5, vertices * 0.25])
    outward = np.concatenate([faces, faces + n, faces + 2 * n])
    fixed, fixed_faces, _ = fix(nested, outward)
    volume = 2.8 * (1 - 0.5**3 + 0.25**3)
    assert diagnose(fixed, fixed_faces).volume == pytest.approx(volume)
    assert orient(fixed, fixed_faces) is None


def test_overlapping_solids_are_both_matter():
    """Each has vertices inside the other; neither is a cavity of it."""
    vertices, faces = octahedron()
    both = np.concatenate([vertices, vertices + [0.3, 0.3, 0.3]])
    outward = np.concatenate([faces, faces + 6])
    fixed, fixed_faces, record = fix(both, outward)
    assert record["before"]["inverted_components"] == 0
    assert fixed.tobytes() == both.tobytes()
    assert np.array_equal(fixed_faces, outward)
    assert record["after"]["self_intersections"] > 0
    turned, turned_faces, _ = fix(both, np.concatenate([faces, faces[:, ::-1] + 6]))
    assert diagnose(turned, turned_faces).volume == pytest.approx(2 * 4 / 3)


def test_doubles_degenerates_and_strays_are_dropped():
    vertices, faces = octahedron()
    dirty = np.concatenate([faces, faces[:2], [[0, 0, 2]], faces[3:4, ::-1], faces[3:4]])
    fixed, fixed_faces, record = fix(np.concatenate([vertices, [[9.0, 9, 9]]]), dirty)
    assert valid(fixed, fixed_faces)
    assert len(fixed_faces) == 8
    assert len(fixed) == 6
    assert record["before"]["duplicate_faces"] == 4
    assert record["before"]["degenerate_faces"] == 1


def test_opposite_pair_vanishes():
    faces = np.array([[0, 1, 2], [2, 1, 0], [3, 4, 5], [4, 5, 3]])
    assert resolve_duplicates(faces).tolist() == [[3, 4, 5]]


def test_small_hole_is_filled_and_nothing_else_moves():
    vertices, faces = box_mesh()
    fixed, fixed_faces, record = fix(vertices, np.delete(faces, [0, 16], axis=0))
    assert valid(fixed, fixed_faces)
    assert fixed[: len(vertices)].tobytes() == vertices.tobytes()
    assert diagnose(fixed, fixed_faces).volume == pytest.approx(2.8, rel=0.02)
    assert record["before"]["boundary_edges"] > 0


def test_large_hole_is_refused_with_the_option_that_would_fill_it():
    vertices, faces = box_mesh()
    top = (vertices[faces][:, :, 2] == 0.5).all(axis=1)
    with pytest.raises(
        PandisError, match=r"To close it all the same, set mesh\.small_hole: 2\.\d+"
    ):
        fix(vertices, faces[~top])
    fixed, fixed_faces, _ = fix(vertices, faces[~top], small_hole=3.0)
    assert valid(fixed, fixed_faces)
    assert diagnose(fixed, fixed_faces).volume == pytest.approx(2.8)
    with pytest.raises(PandisError, match=r"mesh\.max_hole_edges: 16"):
        fix(vertices, faces[~top], small_hole=3.0, max_hole_edges=3)


@pytest.mark.parametrize(
    ("name", "faces"),
    [
        ("an open sheet", [[0, 2, 4], [2, 1, 4]]),
        ("a fin", [*octahedron()[1].tolist(), [0, 1, 2]]),
    ],
)
def test_what_has_no_inside_is_refused(name, faces):
    with pytest.raises(PandisError, match="mesh is"):
        fix(octahedron()[0], faces)


def test_two_solids_at_one_vertex_are_refused():
    vertices, faces = octahedron()
    vertices = np.concatenate([vertices, vertices + [2.0, 0, 0]])
    second = faces + 6
    second[second == 7] = 0  # the two meet in (1, 0, 0)
    with pytest.raises(PandisError, match="1 non-manifold vertices"):
        fix(vertices, np.concatenate([faces, second]))


def test_crossing_faces_are_counted():
    vertices, faces = octahedron()
    both = np.concatenate([vertices, vertices * 0.9 + [0.5, 0.1, 0.05]])
    assert diagnose(both, np.concatenate([faces, faces + 6]).astype(np.int64)).self_intersections


def test_holes_are_listed_longest_first():
    vertices, faces = box_mesh()
    found = diagnose(vertices, np.delete(faces, [0, 16, 70], axis=0))
    assert sorted(hole["edges"] for hole in found.holes) == [3, 4]
    assert found.holes[0]["length"] > found.holes[1]["length"]
    assert found.boundary_edges == 7


def test_shift_and_scale_change_nothing():
    vertices, faces = box_mesh()
    for scale, shift in ((1e-9, 0.0), (1e9, 0.0), (1.0, 1e6)):
        fixed, fixed_faces, _ = fix(vertices * scale + shift, np.delete(faces, [0, 16], axis=0))
        assert valid((fixed - shift) / scale, fixed_faces)


def test_deviation_sees_faces_not_vertices_only():
    """One skew quad, its diagonal flipped: equal vertices, distance 0.57."""
    vertices = np.array([[0, 0, 0], [1, 0, 1], [1, 1, 0], [0, 1, 1.0]])
    one, other = np.array([[0, 1, 2], [0, 2, 3]]), np.array([[0, 1, 3], [1, 2, 3]])
    found = deviation((vertices, one), (vertices.copy(), other), seed=0)
    assert found["to_result"]["max"] == pytest.approx(0.577, abs=0.02)
    assert deviation((vertices, one), (vertices, one), 0)["to_source"]["max"] == 0


def test_clean_keeps_bits_and_order():
    vertices, faces = box_mesh()
    assert clean(vertices, faces) is None
    shuffled = np.concatenate([[[7.0, 7, 7]], vertices])
    kept, _ = clean(shuffled, faces + 1)
    assert kept.tobytes() == vertices.tobytes()


# --- reading ------------------------------------------------------------------------


@pytest.mark.parametrize("ending", ["obj", "off", "ply", "stl", "glb", "obj.gz"])
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
    fixed, fixed_faces, _ = fix(read, read_faces)
    assert valid(fixed, fixed_faces)


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
        tools.call("read_trimesh", path, seconds=0.01, memory_gb=3)
    with pytest.raises(tools.ToolError):
        tools.call("read_trimesh", path, seconds=60, memory_gb=0.05)
    module = tmp_path / "crash.py"
    module.write_text("import os, signal\nos.kill(os.getpid(), signal.SIGSEGV)\n")
    monkeypatch.setattr(tools.sys, "executable", str(crashing(tmp_path)))
    with pytest.raises(tools.ToolError, match="crashed \\(signal 11\\)"):
        tools.call("read_trimesh", path, seconds=60, memory_gb=3)


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
    assert valid(*fix(vertices, faces)[:2])


def test_check_arrays():
    vertices, faces = octahedron()
    check_arrays(np.concatenate([vertices, [[np.nan] * 3]]), faces)  # a stray vertex is no fault
    with pytest.raises(tools.ToolError, match="not there"):
        check_arrays(vertices, faces + 1)


def test_build_closed_form_and_shipped_mesh():
    arrays, attributes = build(OPTIONS | {"source": "analytic:torus"}, None, lambda text: None)
    assert attributes["shape"] == "torus"
    assert attributes["frame"]["scale"] == pytest.approx(1.8 / 2.8)
    assert attributes["deviation"]["to_result"]["max"] < 1e-3
    assert arrays["faces"].dtype == np.int32
    options = OPTIONS | {"source": "pymeshlab:bunny10k_textured.obj", "sha256": None, "seed": 1}
    arrays, attributes = build(options, None, lambda text: None)
    assert [r["rung"] for r in attributes["rungs"]] == ["clean", "fill holes"]
    assert len(attributes["before"]["holes"]) > 5
    assert attributes["after"]["valid"]
    assert attributes["deviation"]["to_result"]["max"] < 1e-12  # what was there has stayed
    assert valid(arrays["vertices"], arrays["faces"])


def test_real_meshes_read_or_are_refused(meshes):
    """No file of the collection crashes the process or passes without being valid."""
    passed = 0
    for path in sorted(meshes.glob("watertight/*")):
        try:
            vertices, faces, _ = read_mesh(path.name, path)
            fixed, fixed_faces, _ = fix(vertices, faces)
        except PandisError:
            continue
        assert diagnose(fixed, fixed_faces).valid
        passed += 1
    assert passed >= 8


# --- closed forms ---------------------------------------------------------------------


@pytest.mark.parametrize("name", SHAPES)
def test_tessellation_is_valid_and_on_the_shape(name):
    shape = SHAPES[name]
    vertices, faces = shape.tessellation()
    found = diagnose(vertices, np.asarray(faces, np.int64))
    assert found.valid
    assert found.self_intersections == 0
    assert np.abs(shape.distance_and_normal(vertices)[0]).max() < 1e-14
    assert np.abs(np.abs(vertices).max(axis=0) - shape.half_extent).max() < 1e-14


@pytest.mark.parametrize("name", SHAPES)
def test_closed_form_is_a_distance(name):
    shape = SHAPES[name]
    points = np.random.default_rng(0).uniform(-2, 2, (4000, 3))
    distance, normal = shape.distance_and_normal(points)
    assert np.abs(np.linalg.norm(normal, axis=1) - 1).max() < 1e-12
    foot = points - distance[:, None] * normal
    assert np.abs(shape.distance_and_normal(foot)[0]).max() < 1e-12
    step = 1e-6
    gradient = np.stack(
        [
            (shape.distance_and_normal(points + step * e)[0]
             - shape.distance_and_normal(points - step * e)[0]) / (2 * step)
            for e in np.eye(3)
        ],
        axis=1,
    )  # fmt: skip
    smooth = np.linalg.norm(gradient - normal, axis=1) < 1e-4
    assert smooth.mean() > 0.999  # all but points next to the medial axis


def test_closed_form_at_its_centre_is_finite():
    for shape in SHAPES.values():
        distance, normal = shape.distance_and_normal(np.zeros((1, 3)))
        assert np.isfinite(distance).all()
        assert np.linalg.norm(normal) == pytest.approx(1)
