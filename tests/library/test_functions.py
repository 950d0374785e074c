"""What users call with a mesh: check, repair, labels, signed_distance, field, compare."""

import json
import os
import signal
import subprocess
import sys
import threading
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from threadpoolctl import threadpool_info

import pandis
from oracle import Solid
from pandis.base.errors import PandisError, RepairError
from pandis.base.files import write_new
from pandis.pipeline.api.fields import read_budget
from pandis.pipeline.api.options import FLAT, sections
from pandis.pipeline.api.writing import MESH_FORMATS, mesh_bytes
from pandis.pipeline.geometry.strata import STRATA
from pandis.pipeline.mesh.diagnosis import FAULTS
from pandis.runtime.field import NativeField
from support import ROOT


def ball():
    mesh = trimesh.creation.icosphere(2, radius=10.0)
    return np.array(mesh.vertices) + (5, -3, 2), np.array(mesh.faces)


def block():
    mesh = trimesh.creation.box((30.0, 20.0, 12.0)).subdivide().subdivide()
    return np.array(mesh.vertices), np.array(mesh.faces)


def two_blocks():
    one, other = block(), block()
    return np.concatenate([one[0], other[0] + (50, 0, 0)]), np.concatenate(
        [one[1], other[1] + len(one[0])]
    )


SHAPES = {"ball": ball, "block": block, "two blocks": two_blocks}


# --- what a mesh may be -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def stl(tmp_path_factory):
    path = tmp_path_factory.mktemp("mesh") / "My Part.v2.stl"
    path.write_bytes(mesh_bytes("stl", *block()))
    return path


def test_a_mesh_is_a_path_or_arrays_or_an_object_of_another_library(stl):
    vertices, faces = block()
    padded = np.column_stack([np.full(len(faces), 3), faces]).ravel()
    meshes = [
        stl,
        str(stl),
        (vertices, faces),
        [vertices.tolist(), faces.tolist()],
        trimesh.Trimesh(vertices, faces, process=False),
        SimpleNamespace(vertices=vertices, triangles=faces),  # Open3D
        SimpleNamespace(points=vertices, faces=padded),  # PyVista
        SimpleNamespace(points=vertices, cells_dict={"triangle": faces, "line": faces[:, :2]}),
        pandis.repair((vertices, faces)),
    ]
    reports = [pandis.check(mesh) for mesh in meshes]
    assert [report.faces for report in reports] == [len(faces)] * len(meshes)
    assert all(report.volume == pytest.approx(30 * 20 * 12) for report in reports)
    assert all(report.ok for report in reports)  # an STL repeats its vertices, and is valid


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (3, "int is no mesh: expected the path"),
        ("nowhere.stl", "there is no file 'nowhere.stl'"),
        ("part.step", "unknown format '.step'"),
        ("https://example.org/a.stl", "download the mesh first"),
        ((np.zeros((4, 2)), np.zeros((1, 3), int)), r"shape \(V, 3\), not \(4, 2\)"),
        ((np.zeros((4, 3)), np.zeros((1, 4), int)), "triangulate the mesh"),
        ((np.zeros((4, 3)), [[0, 1, 4]]), "refers to vertex 4, but there are 4"),
        ((np.zeros((4, 3)), [[0, 1, -1]]), "integers from 0"),
        ((np.zeros((4, 3)), [[0, 1, 2.5]]), "integers from 0"),
        (SimpleNamespace(points=np.zeros((4, 3)), faces=[4, 0, 1, 2, 3]), "triangulate"),
        (SimpleNamespace(points=np.zeros((4, 3)), cells_dict={"tetra": [[0, 1, 2, 3]]}), "tetra"),
        (("a", "b"), "this is no mesh"),
    ],
)
def test_what_is_no_mesh_is_refused_with_what_would_be(mesh, message):
    with pytest.raises(PandisError, match=message):
        pandis.check(mesh)


@pytest.mark.parametrize("function", [pandis.check, pandis.repair])
def test_arrays_without_a_surface_are_refused(function):
    vertices, faces = block()
    with pytest.raises(PandisError, match="no faces"):
        function((vertices, faces[:0]))
    vertices[3] = np.nan
    with pytest.raises(PandisError, match="NaN or infinite"):
        function((vertices, faces))


@pytest.mark.slow
def test_the_callers_process_stays_as_it_is():
    """From several threads, too: the stages run in it, and set what a process of theirs would."""

    def state():
        blas = [info["num_threads"] for info in threadpool_info() if info["user_api"] == "blas"]
        handlers = [signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)]
        return (dict(os.environ), os.getcwd(), list(sys.argv), handlers, warnings.showwarning,
                blas, [n for n in sys.modules if "<" in n])  # fmt: skip

    few = {"surface": 20, "near": 20, "volume": 20}
    expected = pandis.labels(block(), seed=0, **few)
    before, results = state(), {}

    def draw(k):
        results[k] = pandis.labels(block(), seed=k % 2, **few)

    threads = [threading.Thread(target=draw, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert state() == before
    assert (results[0].points == expected.points).all()
    assert (results[2].distance == expected.distance).all()
    assert (results[1].points == results[3].points).all()


def test_arrays_of_the_caller_stay_as_they_are():
    vertices, faces = block()
    before = vertices.copy(), faces.copy()
    for array in (vertices, faces):
        array.flags.writeable = False
    pandis.repair((vertices, faces))
    pandis.labels((vertices, faces), surface=10, near=10, volume=10)
    assert (vertices == before[0]).all()
    assert (faces == before[1]).all()


# --- check ------------------------------------------------------------------------------------


def faulty(kind, shape, rng):
    """Return a shape with a planted fault."""
    vertices, faces = SHAPES[shape]()
    face = rng.integers(len(faces))
    corners = faces[face]
    if kind == "boundary_edges":
        return vertices, np.delete(faces, face, axis=0)
    if kind == "duplicate_faces":
        return vertices, np.concatenate([faces, faces[[face]]])
    if kind == "orientation_conflicts":
        flipped = faces.copy()
        flipped[face] = flipped[face][::-1]
        return vertices, flipped
    if kind == "split_vertices":
        moved = faces.copy()
        moved[face, 0] = len(vertices)
        return np.concatenate([vertices, vertices[corners[:1]]]), moved
    if kind == "degenerate_faces":
        # a vertex on an edge, used by one side only with a face of no area between them
        middle = vertices[corners[:2]].mean(axis=0)
        a, b, c = corners
        m = len(vertices)
        cut = np.delete(faces, face, axis=0)
        return np.concatenate([vertices, [middle]]), np.concatenate(
            [cut, [[a, m, c], [m, b, c], [a, b, m]]]
        )
    if kind == "inverted_components":
        return vertices, faces[:, ::-1]
    if kind == "self_intersections":
        other = SHAPES["block"]()
        place = vertices[corners].mean(axis=0) - other[0].mean(axis=0)
        return np.concatenate([vertices, other[0] + place]), np.concatenate(
            [faces, other[1] + len(vertices)]
        )
    if kind == "nonmanifold_edges":
        top = vertices[corners].mean(axis=0) + rng.uniform(15, 20, 3)
        return np.concatenate([vertices, [top]]), np.concatenate(
            [faces, [[corners[0], corners[1], len(vertices)]]]
        )
    return None


PLANTED = (
    "boundary_edges", "duplicate_faces", "orientation_conflicts", "split_vertices",
    "degenerate_faces", "inverted_components", "self_intersections", "nonmanifold_edges",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("kind", PLANTED)
def test_every_planted_fault_is_named(kind):
    """Whatever else it causes: with its place, where faults have one."""
    rng = np.random.default_rng(len(kind))
    for shape in SHAPES:
        for _ in range(12):
            report = pandis.check(faulty(kind, shape, rng))
            assert not report.ok
            assert report.faults[kind] > 0
            assert kind in report.places or kind == "inverted_components"
            assert FAULTS[kind] in str(report)


@pytest.mark.parametrize("shape", SHAPES)
def test_no_fault_is_invented(shape):
    rng = np.random.default_rng(3)
    for scale in (1e-6, 1.0, 1e7):
        vertices, faces = SHAPES[shape]()
        turn = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
        report = pandis.check((scale * (vertices @ turn.T + rng.normal(0, 100, 3)), faces))
        assert report.ok, str(report)
        assert report.fit
        assert report.faults == report.places == {}
        assert (report.repair, report.option) == ("nothing", {})


def test_the_place_of_a_fault_is_where_it_is():
    vertices, faces = block()
    report = pandis.check((vertices, np.delete(faces, 7, axis=0)))
    sides = np.roll(faces[7], -1)
    middles = (vertices[faces[7]] + vertices[sides]) / 2
    assert sorted(report.places["boundary_edges"]) == sorted(middles.tolist())


@pytest.mark.slow
def test_a_report_says_what_repair_would_do_and_that_option_works():
    vertices, faces = block()
    top = vertices[faces].mean(axis=1)[:, 2] > 5.9
    cup = vertices, faces[~top]
    report = pandis.check(cup)
    assert (report.repair, report.option, report.fit) == ("refusal", {"solid": "always"}, False)
    with pytest.raises(RepairError) as refused:
        pandis.repair(cup)
    assert refused.value.option == report.option
    closed = pandis.repair(cup, **report.option)
    assert pandis.check(closed).ok
    assert pandis.check(cup, **report.option).fit
    holed = pandis.check((vertices, np.delete(faces, 7, axis=0)))
    assert (holed.repair, holed.begins_with) == ("repair", "fill")
    twice = pandis.check((vertices, np.concatenate([faces, faces[:1]])))
    assert twice.repair == "lossless"


def test_a_report_is_json_and_text(stl):
    report = pandis.check(stl, unit="mm")
    stored = json.loads(report.to_json())
    assert stored["ok"] is stored["fit"] is True
    assert stored["wall"]["min"] == pytest.approx(12, rel=1e-3)
    assert stored["size"] == pytest.approx([30, 20, 12])
    assert "30 x 20 x 12 mm" in str(report)
    assert "unit unknown" in str(pandis.check(stl))


# --- repair -----------------------------------------------------------------------------------


def test_a_valid_mesh_comes_back_bit_for_bit():
    vertices, faces = ball()
    mesh = pandis.repair((vertices, faces))
    assert mesh.unchanged
    assert mesh.rungs == []
    assert (mesh.vertices == vertices).all()
    assert (mesh.faces == faces).all()
    assert (mesh.origin == 0).all()
    assert (mesh.deviation == 0).all()


@pytest.mark.parametrize("form", MESH_FORMATS)
def test_a_saved_mesh_is_read_as_it_was(form, tmp_path):
    mesh = pandis.repair(ball())
    mesh.save(tmp_path / f"ball.{form}")
    again = pandis.repair(tmp_path / f"ball.{form}")
    assert again.vertices[again.faces] == pytest.approx(
        mesh.vertices[mesh.faces], abs=1e-5 if form == "stl" else 0
    )
    with pytest.raises(PandisError, match=r"exists; --force \(force=True\) replaces it"):
        mesh.save(tmp_path / f"ball.{form}")
    mesh.save(tmp_path / f"ball.{form}", force=True)
    assert [path.name for path in tmp_path.iterdir()] == [f"ball.{form}"]


def test_an_stl_that_would_merge_vertices_is_refused_with_a_format_that_does_not(tmp_path):
    vertices, faces = ball()
    far = pandis.repair((vertices + (3e8, 0, 0), faces))
    with pytest.raises(PandisError, match=r"single precision.* write \.ply or \.obj instead"):
        far.save(tmp_path / "far.stl")
    assert list(tmp_path.iterdir()) == []
    far.save(tmp_path / "far.ply")
    assert (pandis.repair(tmp_path / "far.ply").vertices == far.vertices).all()


def test_a_wrong_ending_or_folder_is_refused_before_anything_is_written(tmp_path):
    mesh = pandis.repair(ball())
    for path, message in (
        (tmp_path / "ball.step", r"written as \.obj, \.off, \.ply, \.stl, not as '\.step'"),
        (tmp_path / "none/ball.ply", "there is no folder"),
        (tmp_path, "written as"),
    ):
        with pytest.raises(PandisError, match=message):
            mesh.save(path)


def test_of_many_writers_of_one_file_one_succeeds_whole(tmp_path):
    path, outcomes = tmp_path / "out.bin", []
    start = threading.Barrier(8)

    def write(k):
        start.wait()
        try:
            write_new(path, bytes([k]) * 100_000)
            outcomes.append(k)
        except PandisError as error:
            assert "exists" in str(error)  # noqa: PT017

    threads = [threading.Thread(target=write, args=(k,)) for k in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    (won,) = outcomes
    assert path.read_bytes() == bytes([won]) * 100_000
    assert list(tmp_path.iterdir()) == [path]


def test_a_link_is_written_through_and_a_device_is_no_file(tmp_path):
    (tmp_path / "link.bin").symlink_to("there.bin")
    write_new(tmp_path / "link.bin", b"one")
    assert (tmp_path / "there.bin").read_bytes() == b"one"
    with pytest.raises(PandisError, match="exists"):
        write_new(tmp_path / "link.bin", b"two")
    write_new(tmp_path / "link.bin", b"two", force=True)
    assert (tmp_path / "there.bin").read_bytes() == b"two"
    assert (tmp_path / "link.bin").is_symlink()
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(PandisError, match="no file"):
        write_new(tmp_path / "pipe", b"three", force=True)
    with pytest.raises(PandisError, match="cannot be written"):
        write_new(tmp_path / ("a" * 300), b"four")
    write_new(tmp_path / ("a" * 251 + ".npz"), b"five")  # as long as a name may be
    assert (tmp_path / ("a" * 251 + ".npz")).read_bytes() == b"five"


def test_what_a_check_refuses_leaves_nothing(tmp_path):
    def refuse(part):
        assert part.read_bytes() == b"data"
        raise PandisError("wrong")

    with pytest.raises(PandisError, match="wrong"):
        write_new(tmp_path / "a.ply", b"data", check=refuse)
    assert list(tmp_path.iterdir()) == []


# --- labels -----------------------------------------------------------------------------------


def test_labels_are_exact_by_another_library():
    vertices, faces = ball()
    labels = pandis.labels((vertices, faces), surface=500, near=2000, volume=1000, seed=3)
    assert len(labels.points) == 3500
    solid = Solid(vertices, faces)
    distance, normal = solid.distance(labels.points)
    size = 1e-6 * 20
    assert labels.distance == pytest.approx(distance, abs=size)
    away = (np.abs(distance) > 0.01) & ~labels.tied
    assert np.abs(labels.normal - normal)[away].max() < 1e-5
    assert away.sum() > 2500
    near = labels.distance[labels.stratum == STRATA.index("near")]
    assert 0.3 < (near < 0).mean() < 0.7  # both signs
    volume = labels.points[labels.stratum == STRATA.index("volume")]
    low, high = vertices.min(0), vertices.max(0)
    margin = 0.1 / labels.frame.scale
    assert (volume >= low - margin).all()
    assert (volume <= high + margin).all()
    assert np.ptp(volume, axis=0) == pytest.approx(high - low + 2 * margin, rel=0.02)


def test_labels_depend_on_the_seed_alone():
    first, again, other = (
        pandis.labels(block(), surface=50, near=50, volume=50, seed=seed) for seed in (1, 1, 2)
    )
    assert all(np.array_equal(a, b) for a, b in zip(first[:5], again[:5], strict=True))
    assert not np.array_equal(first.points, other.points)


def test_labels_are_saved_with_what_is_needed_to_read_them(tmp_path):
    labels = pandis.labels(block(), surface=0, near=100, volume=0)
    labels.save(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as stored:
        assert set(stored) == {
            "points", "distance", "normal", "stratum", "tied", "moved", "strata", "centre",
            "scale",
        }  # fmt: skip
        assert (stored["points"] == labels.points).all()
        assert stored["strata"][stored["stratum"]].tolist() == ["near"] * 100
        unit = (stored["points"] - stored["centre"]) * stored["scale"]
    assert np.abs(unit).max() < 1.1


def test_signed_distances_are_exact():
    vertices, faces = two_blocks()
    points = np.random.default_rng(0).uniform(-30, 80, (500, 3))
    distance, _ = Solid(vertices, faces).distance(points)
    assert pandis.signed_distance((vertices, faces), points) == pytest.approx(distance, abs=1e-9)
    assert pandis.signed_distance((vertices, faces), points[0]).shape == (1,)


# --- fields -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "kind", ["exact", "compact-16", "compact-auto", "spline-32", "tricubic-32"]
)
def test_a_field_answers_in_the_units_of_the_mesh(kind, tmp_path):
    field = pandis.field(ball(), kind)
    distance, normal, _ = field.query([[5, -3, 2 + 9.5], [5, -3, 2 + 11]])
    assert distance == pytest.approx([-0.5, 1], abs=0.3)
    assert normal[:, 2] == pytest.approx(1, abs=0.05)
    field.save(tmp_path / "a.pandis")
    assert pandis.load(tmp_path / "a.pandis").query([[5, -3, 11.5]])[0] == distance[0]
    with pytest.raises(PandisError, match="exists"):
        field.save(tmp_path / "a.pandis")


@pytest.mark.slow
def test_a_budget_is_met_or_refused():
    messages = []
    field = pandis.field(ball(), "auto", budget="20 mN, 500 kB", log=messages.append)
    assert field.bytes <= 500_000
    assert any("0.10 m at 400 N/m" in text for text in messages)
    messages.clear()
    pandis.field(ball(), "auto", budget="5 %", size="60 mm", log=messages.append)
    assert not any("0.10 m" in text for text in messages)
    with pytest.raises(PandisError, match="no field meets the budget"):
        pandis.field(ball(), "auto", budget="1 mN, 1 kB")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kind": "auto"}, "needs a budget"),
        ({"budget": "20 mN"}, 'a budget needs kind="auto"'),
        ({"kind": "auto", "budget": "20 mm"}, "'20 mm' is no limit"),
        ({"kind": "auto", "budget": "20 mN, 3 N"}, "limits force_error a second time"),
        ({"kind": "auto", "budget": "15 kB"}, "add one, such as '20 mN, 15 kB'"),
        ({"kind": "auto", "budget": ""}, "it is empty"),
        ({"name": "My Part"}, "must start with a-z"),
        ({"kind": "compact-atuo"}, "did you mean 'compact-auto'"),
        ({"opne": "cap"}, "opne: unknown option; did you mean 'open'"),
        ({"mesh": 3}, "mesh: expected options by name, not 3"),
        ({"mesh": {"opne": 1}}, "mesh.opne: unknown option; did you mean 'open'"),
        ({"seed": -1}, "seed: expected a whole number from 0"),
        ({"seed": "abc"}, "seed: expected a whole number from 0"),
        ({"kind": "auto", "budget": "20 mN, 1e999 kB"}, "is no limit"),
        ({"name": "../../evil"}, "must start with a-z"),
        ({"name": 5}, "must start with a-z"),
        ({"weld": -1}, "mesh.weld"),
        ({"size": 60}, "for a part of 60 mm, write 0.06"),
    ],
)
def test_wrong_options_are_refused_with_the_right_ones(options, message):
    with pytest.raises(PandisError, match=message):
        pandis.field(ball(), **options)


@pytest.mark.parametrize(
    ("text", "limits"),
    [
        ("20 mN, 500 kB", {"force_error": "20 mN", "bytes": 500_000}),
        ("0.02N,1MB", {"force_error": "0.02N", "bytes": 1_000_000}),
        ("5 %, 2 us", {"force_error": "5 %", "query_time": 2e-6}),
        ("1 N, 800 bytes", {"force_error": "1 N", "bytes": 800}),
    ],
)
def test_a_budget_is_read(text, limits):
    read = read_budget(text)
    assert read == pytest.approx(limits) if "query_time" in limits else read == limits


def test_every_option_of_the_stages_has_a_name_of_its_own():
    names = [name for model in FLAT.values() for name in model.model_fields]
    assert len(names) == len(set(names))
    for section, model in FLAT.items():
        for name in model.model_fields:
            assert sections({name: 1}, tuple(FLAT)) == {section: {name: 1}}


# --- compare ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_field_is_compared_with_its_mesh_and_with_another():
    mesh = ball()
    field = pandis.field(mesh)
    good = pandis.compare(field, mesh, probes=5000)
    assert good.ok
    assert good.sets["contact-deep"]["relative"] < 1e-3
    assert good.note == ""
    assert json.loads(good.to_json())["ok"] is True
    coarse = pandis.compare(pandis.field(mesh, "nearest-8"), mesh, probes=5000)
    assert not coarse.ok
    assert "NOT fit for use" in str(coarse)
    assert set(coarse.failed) >= {"missing"}
    moved = mesh[0] * 25.4, mesh[1]
    other = pandis.compare(field, moved, probes=5000)
    assert not other.ok
    assert "different units" in other.note
    for count in (-3, 0, 5):
        with pytest.raises(PandisError, match="probes"):
            pandis.compare(field, mesh, probes=count)
    larger = pandis.compare(field, mesh, probes=5000, size=0.2, stiffness=800)
    assert larger.sets["contact-deep"]["newtons"] == pytest.approx(
        4 * good.sets["contact-deep"]["newtons"], rel=0.3
    )


class Wrong(NativeField):
    """The exact field, wrong in one way that leaves the force of the others as it is."""

    def query(self, points):
        distance, normal, flag = super().query(points)
        if self.way == "twice":
            distance = np.where(distance < 0, 2 * distance, distance)
        elif self.way == "aside":
            normal = normal[:, [1, 2, 0]]
        elif self.way == "zero":
            distance = np.abs(distance)
        elif self.way == "one place":  # a disc of 6 % of the ball, with three times the force
            there = normal[:, 2] > 0.88
            distance = np.where(there & (distance < 0), 3 * distance, distance)
        elif self.way == "in free space":
            there = (np.asarray(points)[:, 2] > 2 + 10.2) & (distance > 0)
            distance = np.where(there, -distance, distance)
        return distance, normal, flag


@pytest.mark.slow
@pytest.mark.parametrize(
    ("way", "failed"),
    [
        ("right", set()),
        ("twice", {"other"}),
        ("aside", {"missing", "other"}),
        ("zero", {"missing", "other"}),
        ("one place", {"other"}),
        ("in free space", {"contacts"}),
    ],
)
def test_each_kind_of_wrong_field_fails(way, failed, tmp_path):
    """The missing force alone is no verdict: twice the force misses none."""
    pandis.field(ball(), "exact").save(tmp_path / "ball.pandis")
    field = Wrong(tmp_path / "ball.pandis")
    field.way = way
    compared = pandis.compare(field, ball(), probes=5000)
    assert set(compared.failed) == failed
    assert compared.ok == (not failed)
    assert ("NOT fit for use" in str(compared)) == bool(failed)
    assert all(why in str(compared) for why in compared.failed.values())


# --- packages ---------------------------------------------------------------------------------

BLOCKED = """
import sys

class Without:
    def __init__(self, finder):
        self.finder = finder

    def __getattr__(self, name):
        return getattr(self.finder, name)

    def find_spec(self, name, *more):
        absent = name.partition(".")[0] in {names!r}
        return None if absent else self.finder.find_spec(name, *more)

sys.meta_path[:] = map(Without, sys.meta_path)
"""


def run_without(names, program, folder):
    """Run a program where packages are missing, in its children, too."""
    (folder / "sitecustomize.py").write_text(BLOCKED.format(names=names))
    path = os.pathsep.join([str(folder), str(ROOT / "workflow")])
    return subprocess.run(
        [sys.executable, "-c", program], env=os.environ | {"PYTHONPATH": path},
        capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.mark.slow
def test_without_the_workflows_packages_everything_but_their_rungs_works(tmp_path):
    (tmp_path / "block.stl").write_bytes(mesh_bytes("stl", *block()))
    _, faces = block()
    program = f"""
import numpy as np, pandis
path = {str(tmp_path / "block.stl")!r}
print(pandis.check(path).repair, len(pandis.repair(path).faces))
print(len(pandis.labels(path, surface=10, near=10, volume=10).points))
print(pandis.compare(pandis.field(path), path, probes=2000).ok)
print(pandis.label_meshes(path, path + ".zarr", surface=10, near=10, volume=10).names)
try:
    pandis.field(path, "pandis-exact")
except Exception as error:
    print(error)
"""
    names = {"torch", "snakemake", "pymeshlab", "pymeshfix", "onnx", "matplotlib"}
    done = run_without(names, program, tmp_path)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[:4] == [f"nothing {len(faces)}", "30", "True", "['block']"]
    assert "pip install 'pandis-fields[workflow]'" in lines[4]


def test_with_numpy_alone_the_remedy_is_one_line(tmp_path):
    names = {"pydantic", "zarr", "trimesh", "igl", "scipy", "threadpoolctl"}
    done = run_without(names, "import pandis; pandis.check", tmp_path)
    assert "pip install 'pandis-fields[make]'" in done.stderr.splitlines()[-1]
