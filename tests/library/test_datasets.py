"""Data sets: what becomes of each mesh, exact rows, work that is done once, and layouts."""

import csv
import errno
import fcntl
import hashlib
import io
import json
import os
import signal
import subprocess
import sys
import tarfile
import tempfile
import time
import zipfile
from pathlib import Path

import igl
import numpy as np
import pytest
import trimesh

import pandis
from pandis.__main__ import main
from pandis.base.errors import PandisError, ReadError
from pandis.pipeline.dataset import fields, worker
from pandis.pipeline.dataset.layouts import LAYOUTS
from pandis.pipeline.dataset.pool import Lost, Pool
from pandis.pipeline.dataset.reading import MESH, ROWS, Shard
from pandis.pipeline.dataset.rows import Work
from pandis.pipeline.geometry.strata import STRATA
from pandis.pipeline.mesh import tools
from pandis.pipeline.run.ask import sourcing
from pandis.pipeline.run.ask.datasets import DatasetOptions
from pandis.pipeline.run.ask.members import RATIO, Member, members
from pandis.pipeline.run.ask.sharding import shard_count, shard_of
from pandis.pipeline.run.records.dataset import MeshFacts
from support import ROOT, environment

FEW = {"surface": 300, "near": 500, "volume": 400, "seed": 3}


def shape(kind, **sizes):
    mesh = getattr(trimesh.creation, kind)(**sizes)
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)


@pytest.fixture
def folder(tmp_path):
    """Four meshes: two valid, one without a top, one that is none."""
    place = tmp_path / "meshes"
    (place / "round").mkdir(parents=True)
    shape("box", extents=(3, 2, 1)).export(place / "box.ply")
    shape("icosphere", subdivisions=2).export(place / "round/ball.obj")
    open_box = shape("box", extents=(1, 1, 1))
    open_box.update_faces(open_box.triangles_center[:, 2] < 0.49)
    open_box.export(place / "cup.off")
    (place / "none.stl").write_bytes(b"solid nothing\nendsolid nothing\n")
    return place


def label(folder, store, **options):
    """Label a folder; return the store and the number of meshes that were computed."""
    lines = []
    made = pandis.label_meshes(folder, store, workers=2, log=lines.append, **FEW | options)
    counts = [line.rpartition("meshes, ")[2].split()[0] for line in lines if "to compute" in line]
    return made, sum(map(int, counts))


def files_of(store):
    return {path.name: path.read_bytes() for path in Path(store).glob("shards/*.zip")}


# --- rows -------------------------------------------------------------------------------------


def test_every_mesh_is_in_the_store_with_its_rows_or_its_reason(folder, tmp_path):
    store, computed = label(folder, tmp_path / "parts.zarr")
    assert computed == 4
    assert store.names == ["box", "cup", "round/ball"]
    assert set(store.failed) == {"none"}
    assert "no faces" in store.failed["none"].reason
    assert store.summary.ready == 3
    assert store.summary.rows == 3 * 1200
    assert store.facts["box"].repair == []
    cup = store.facts["cup"]
    assert cup.kinds or cup.repair
    assert cup.invented == pytest.approx(1 / 6, abs=0.02)  # its lid, however it was closed
    assert store.facts["box"].invented == 0
    assert (tmp_path / "parts.zarr/card.html").read_text().count("round/ball") >= 1


def test_labels_are_exact_at_the_points_as_they_are_stored(folder, tmp_path):
    store, _ = label(folder, tmp_path / "parts.zarr")
    whole = pandis.LabelStore(store.path, columns=tuple(ROWS))
    for name in whole.names:
        vertices, faces = whole.mesh(name)
        centre, scale = whole.frame(name)
        corners, faces = (vertices - centre) * scale, faces.astype(np.int64)
        rows = whole.rows(name)
        points = rows["points"].astype(np.float64)
        square = igl.point_mesh_squared_distance(points, corners, faces)[0]
        inside = igl.winding_number(corners, faces, points) > 0.5
        exact = np.where(inside, -1, 1) * np.sqrt(square)
        # the judge's own rounding, and the last bit of the stored type
        allowed = np.spacing(np.abs(exact).astype(np.float32)) + 1e-12
        off_surface = np.abs(exact) > 1e-9
        assert (np.abs(rows["distance"] - exact)[off_surface] <= allowed[off_surface]).all()
        assert ((rows["distance"] < 0) == inside)[off_surface].all()
        on = rows["stratum"] == STRATA.index("surface")
        assert np.abs(rows["distance"][on]).max() < 1e-6
        assert np.linalg.norm(rows["normal"], axis=1) == pytest.approx(1, abs=1e-6)


def test_rows_are_those_of_the_command_for_one_mesh_in_random_order(folder, tmp_path):
    store, _ = label(folder, tmp_path / "parts.zarr")
    rows = pandis.LabelStore(store.path, columns=tuple(ROWS)).rows("box")
    alone = pandis.labels(folder / "box.ply", name="box", **FEW)
    centre, scale = store.frame("box")
    unit = ((alone.points - centre) * scale).astype(np.float32)
    assert sorted(map(tuple, rows["points"])) == sorted(map(tuple, unit))
    assert (rows["stratum"] != np.sort(rows["stratum"])).any()
    shares = [np.mean(rows["stratum"][k::4] == STRATA.index("near")) for k in range(4)]
    assert shares == pytest.approx([500 / 1200] * 4, abs=0.1)


def test_points_that_noise_moved_beyond_a_wall_are_doubted(tmp_path):
    (tmp_path / "meshes").mkdir()
    shape("box", extents=(1, 1, 0.004)).export(tmp_path / "meshes/plate.ply")
    shape("box", extents=(1, 1, 1)).export(tmp_path / "meshes/cube.ply")
    store, _ = label(tmp_path / "meshes", tmp_path / "s.zarr", scales=[0.03], near=2000)
    whole = pandis.LabelStore(store.path, columns=tuple(ROWS))
    plate, cube = (whole.rows(name) for name in ("plate", "cube"))
    near = plate["stratum"] == STRATA.index("near")
    assert np.mean(plate["doubt"][near] & 2 > 0) > 0.8
    assert not (plate["doubt"][~near] & 2).any()
    assert not (cube["doubt"] & 2).any()


def test_chunks_cover_every_row_once(folder, tmp_path):
    store, _ = label(folder, tmp_path / "parts.zarr", chunk=256)
    assert len(store) == 3 * 5
    chunks = [store[k]["distance"] for k in range(len(store))]
    assert [len(chunk) for chunk in chunks] == [256, 256, 256, 256, 176] * 3
    rows = np.concatenate([store.rows(name)["distance"] for name in store.names])
    assert (np.concatenate(chunks) == rows).all()
    assert len(store.draw("cup", seed=1)["points"]) in (176, 256)
    with pytest.raises(IndexError):
        store[len(store)]
    with pytest.raises(PandisError, match="no rows of none: "):
        store.rows("none")


# --- work that is done once -------------------------------------------------------------------


def test_fields_are_those_of_the_command_for_one_mesh(folder, tmp_path):
    """Each file of the layout, and each field of the store, answers with the command's bits."""
    kinds = ["trilinear-24", "exact", "compact-16", "tricubic-24"]
    store, computed = label(folder, tmp_path / "parts.zarr", fields=kinds)
    assert (computed, store.names) == (4, ["box", "cup", "round/ball"])
    written = store.export("pandis", tmp_path / "fields")
    assert len(written) == len(kinds) * len(store.names)
    points = np.random.default_rng(0).uniform(-1, 1, (500, 3))
    for name in store.names:
        assert list(store.facts[name].files) == sorted(kinds)
        for kind in kinds:
            field = store.field(name, kind)
            place = name.rpartition("/")
            path = tmp_path / f"fields/{place[0] or 'all'}/{place[2]}.{kind}.pandis"
            assert path.read_bytes() == store.file(name, kind)
            expected = pandis.field(store.mesh(name), kind)
            for one, other in zip(field.query(points), expected.query(points), strict=True):
                assert np.array_equal(one, other)
    with pytest.raises(PandisError, match=r"has compact-16, exact, .* of box, not compact-12"):
        store.field("box", "compact-12")


def test_a_field_that_cannot_be_built_costs_nothing_else(folder, tmp_path):
    dust = shape("icosphere", subdivisions=1, radius=1e-4)  # a step of 10 bits is larger
    both = trimesh.util.concatenate([dust, dust.copy().apply_translation((1, 0, 0))])
    both.export(folder / "dust.ply")
    store, _ = label(folder, tmp_path / "parts.zarr", fields=["exact", "compact-10"])
    assert store.names == ["box", "cup", "dust", "round/ball"]
    assert (list(store.facts["dust"].files), len(store.rows("dust")["points"])) == (["exact"], 1200)
    with pytest.raises(PandisError, match="not compact-10: on a lattice of 10 bits nothing"):
        store.field("dust", "compact-10")
    assert {cause.stage for cause in store.summary.causes} == {"read", "field"}
    assert len(store.export("pandis", tmp_path / "files")) == 7
    without, _ = label(folder, tmp_path / "none.zarr")
    with pytest.raises(PandisError, match="there are no fields of box; add them to `fields`"):
        without.export("pandis", tmp_path / "fields")


@pytest.mark.slow
def test_other_fields_compute_no_rows_and_give_the_bytes_of_a_new_store(folder, tmp_path):
    """Fields are added, taken off, or built otherwise; a mesh with materials is done anew."""
    text = (folder / "round/ball.obj").read_text()
    faces = [line for line in text.splitlines() if line.startswith("f ")]
    (folder / "round/ball.obj").write_text(
        text.replace(faces[0], f"usemtl red\n{faces[0]}").replace(faces[9], f"usemtl b\n{faces[9]}")
    )
    path = tmp_path / "parts.zarr"
    label(folder, path)
    steps = [["compact-10"], ["compact-10", "trilinear-24"], ["trilinear-16"], []]
    for number, kinds in enumerate(steps):
        _, computed = label(folder, path, fields=kinds, force=number > 1)
        assert computed == bool(kinds)  # the mesh with materials
        fresh, _ = label(folder, tmp_path / f"{number}/parts.zarr", fields=kinds)
        assert files_of(path) == files_of(fresh.path)
    assert fresh.facts["round/ball"].materials == 2
    with pytest.raises(PandisError, match=r"other options \(fields\)"):
        label(folder, tmp_path / "1/parts.zarr", fields=["trilinear-24"])


def test_a_field_that_fails_costs_no_rows_and_is_tried_again_with_more(tmp_path, monkeypatch):
    shape("box", extents=(1, 1, 1)).export(tmp_path / "box.ply")
    options = DatasetOptions.model_validate({"source": "x", "seed": 0})
    [member] = members(options.model_copy(update={"source": str(tmp_path / "*.ply")}))
    few = options.samples.model_dump() | {key: FEW[key] for key in ("surface", "near", "volume")}
    work = Work(
        member, options.mesh.model_dump(), few, 0, {"exact": {}, "later": {}}, {}, key="rows",
        field_keys={"exact": "file", "later": "too"}, output=str(tmp_path / "box.npz"),
    )  # fmt: skip

    def answer(error, **changes):
        def fail(name, work, **given):
            assert worker.read_rows(work.output)[0].rows == 1200  # should this process be killed
            if error and name == "exact":
                raise error
            return b"file"

        monkeypatch.setattr(worker, "field_file", fail)
        worker._answer(work._replace(**changes), lambda note: None)
        facts, arrays = worker.read_rows(work.output)
        assert (len(arrays["points"]), facts.failed) == (1200, None)
        assert facts.files["later"] == 4
        return fields.only_fields(work, facts)

    facts = answer(caused(PandisError("out of room"), MemoryError()))
    assert facts.unbuilt == {"exact": "it needs more memory; raise memory_gb of the data set"}
    assert fields.missing_fields(work, facts) == []
    more = work._replace(limits=(300.0, 8.0))
    assert fields.missing_fields(more, facts) == ["exact"]
    monkeypatch.setattr(worker, "mesh_rows", None)  # the rows are there
    assert answer(ImportError("c"), limits=more.limits).unbuilt["exact"].startswith("a defect of")
    facts = answer(OSError(errno.EIO, "Input/output error"), limits=(300.0, 9.0))
    assert (facts.again, fields.missing_fields(work, facts)) == (True, ["exact"])
    assert not fields.only_fields(work._replace(builds={}, field_keys={}), facts).again
    monkeypatch.setattr(worker, "_known_rows", lambda work: 1 / 0)  # not written over the rows
    assert worker._answer(work, lambda note: None)["failed"][0] == "read"
    monkeypatch.undo()
    facts = answer(None)
    assert (facts.files, facts.unbuilt, facts.again) == ({"exact": 4, "later": 4}, {}, False)
    assert fields.missing_fields(work, facts) == []
    assert fields.missing_fields(work._replace(field_keys={"exact": "new"}), facts) == ["exact"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("answer", "again"),
    [
        (Lost("field exact", "its process ended"), False),
        (Lost("read", "its process ended", killed=True), True),
        (["read", {"reason": "its process ended", "again": True}], True),
    ],
)
def test_a_task_that_fails_costs_no_rows(answer, again, folder, tmp_path, monkeypatch):
    path, answers = tmp_path / "parts.zarr", Pool.answers
    label(folder, path)

    def lose(self, tasks):
        lost = [work for work in tasks if work.member.name == "box"]
        yield from ((work, answer) for work in lost)
        yield from answers(self, [work for work in tasks if work not in lost])

    with monkeypatch.context() as patch:
        patch.setattr(Pool, "answers", lose)
        store, _ = label(folder, path, fields=["exact", "trilinear-16"])
    assert len(store.rows("box")["points"]) == 1200
    assert store.facts["box"].unbuilt["exact"] == "its process ended"
    assert list(store.facts["cup"].files) == ["exact", "trilinear-16"]
    store, _ = label(folder, path, fields=["exact", "trilinear-16"])
    assert ("exact" in store.facts["box"].files) == again
    assert "trilinear-16" in store.facts["box"].files  # whatever its neighbour did
    more = {"fields": ["exact", "trilinear-16"], "seconds": 100}
    label(folder, path, **more)
    fresh, _ = label(folder, tmp_path / "fresh/parts.zarr", **more)
    assert files_of(path) == files_of(fresh.path)


def test_the_same_call_computes_nothing_and_gives_the_same_bytes(folder, tmp_path):
    store, _ = label(folder, tmp_path / "parts.zarr")
    before = files_of(store.path)
    assert label(folder, store.path)[1] == 0
    other, _ = label(folder, tmp_path / "other/parts.zarr")
    assert files_of(store.path) == files_of(other.path) == before


@pytest.mark.slow
def test_adding_changing_removing_and_overriding_computes_that_mesh_alone(folder, tmp_path):
    options = {"shards": 2}
    path = tmp_path / "parts.zarr"
    label(folder, path, **options)
    steps = {
        "add": lambda: shape("icosphere", subdivisions=1).export(folder / "new.ply"),
        "change": lambda: shape("box", extents=(3, 2, 2)).export(folder / "box.ply"),
    }
    for name, step in steps.items():
        step()
        touched = shard_of("new" if name == "add" else "box", 2)
        before = files_of(path)
        store, computed = label(folder, path, **options)
        assert computed == 1, name
        same = {file for file, data in files_of(path).items() if data == before[file]}
        assert same == {f"{1 - touched:05}.zarr.zip"}
        assert len(store.names) == 4
    (folder / "new.ply").unlink()
    store, computed = label(folder, path, **options)
    assert (computed, len(store.names)) == (0, 3)
    override = {"cup": {"mesh": {"open": "cap", "solid": "never"}}}
    store, computed = label(folder, path, override=override, force=True, **options)
    assert computed == 1
    assert store.facts["cup"].kinds == {}
    fresh, _ = label(folder, tmp_path / "fresh/parts.zarr", override=override, **options)
    assert files_of(fresh.path) == files_of(path)


@pytest.mark.slow
def test_another_number_of_shards_moves_rows_and_computes_none(folder, tmp_path):
    store, _ = label(folder, tmp_path / "parts.zarr", shards=1)
    again, computed = label(folder, store.path, shards=4)
    assert computed == 0
    fresh, _ = label(folder, tmp_path / "fresh/parts.zarr", shards=4)
    for number in range(4):
        name = f"{number:05}.zarr.zip"
        assert files_of(again.path)[name] == files_of(fresh.path)[name]


@pytest.mark.slow
def test_a_damaged_shard_is_computed_again(folder, tmp_path):
    store, _ = label(folder, tmp_path / "parts.zarr")
    shard = store.path / "shards/00000.zarr.zip"
    whole = shard.read_bytes()
    shard.unlink()
    assert label(folder, store.path)[1] == 0  # the last version is remembered
    assert shard.read_bytes() == whole
    damaged = bytearray(whole)
    damaged[len(damaged) // 2] ^= 1
    remembered = next((store.path / "shards/.resume").glob("*.zip"))
    remembered.write_bytes(damaged)
    shard.unlink()
    assert label(folder, store.path)[1] == 4
    assert shard.read_bytes() == whole


@pytest.mark.slow
def test_a_killed_call_goes_on_where_it_was(folder, tmp_path):
    for k in range(6):
        shape("icosphere", subdivisions=3, radius=1 + k).export(folder / f"more{k}.ply")
    path = tmp_path / "parts.zarr"
    program = (
        "import sys, pandis\n"
        f"pandis.label_meshes({str(folder)!r}, {str(path)!r}, workers=1, **{FEW!r})\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program], env=environment(PYTHONPATH=str(ROOT / "workflow"))
    )
    work = path / "shards/.resume/00000-of-00001"
    while process.poll() is None and len(list(work.glob("*.npz"))) < 3:
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    done = len(list(work.glob("*.npz")))
    assert done >= 3
    store, computed = label(folder, path)
    assert computed == 10 - done
    assert len(store.names) == 9
    fresh, _ = label(folder, tmp_path / "fresh/parts.zarr")
    assert files_of(fresh.path) == files_of(path)


def test_rows_that_were_damaged_by_a_power_cut_are_computed_again(folder, tmp_path):
    path = tmp_path / "parts.zarr"
    label(folder, path)
    whole, shard = files_of(path), Shard(path / "shards/00000.zarr.zip")
    rest = path / "shards/.resume/00000-of-00001"
    rest.mkdir()
    for place, facts in enumerate(shard.meshes):
        part = rest / f"{facts.key[:32]}.npz"
        worker.write_rows(part, facts, {} if facts.failed else shard.arrays(place))
    data = bytearray(part.read_bytes())
    data[len(data) // 2] ^= 1  # its facts, which come first, are whole
    part.write_bytes(data)
    shard.path.unlink()
    next((path / "shards/.resume").glob("*.zip")).unlink()
    assert label(folder, path)[1] == 1
    assert files_of(path) == whole


# --- limits and refusals ----------------------------------------------------------------------


@pytest.mark.slow
def test_a_mesh_beyond_its_time_costs_itself_alone_and_is_tried_again_with_more(folder, tmp_path):
    grid = np.random.default_rng(0).random((300, 3, 3))  # triangles that all cross
    soup = trimesh.Trimesh(grid.reshape(-1, 3), np.arange(900).reshape(-1, 3), process=False)
    soup.export(folder / "soup.ply")
    path = tmp_path / "parts.zarr"
    store, _ = label(folder, path, seconds=4)
    assert store.names == ["box", "cup", "round/ball"]
    assert store.failed["soup"].reason == "it took longer than 4 s; raise seconds of the data set"
    assert label(folder, path, seconds=4)[1] == 0
    assert label(folder, path, seconds=5)[1] == 1


def test_a_process_that_ends_is_a_result():
    work = Work(None, {}, {}, 0)  # raises before anything can be answered
    pool = Pool(1, seconds=60, memory_gb=4)
    answers = [answer for _, answer in pool.answers([work, work])]
    assert all(isinstance(answer, Lost) for answer in answers)
    assert "its process ended (status 1)" in str(answers[0])


def test_too_little_memory_is_a_result(folder, tmp_path):
    store, _ = label(folder, tmp_path / "parts.zarr", memory_gb=0.2)
    assert not store.names
    reasons = [why.reason for why in store.failed.values()]
    assert [why for why in reasons if "memory_gb" not in why] == []


def caused(error, cause):
    error.__cause__ = cause
    return error


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (MemoryError(), "it needs more memory"),
        (OSError(errno.ENOMEM, "Cannot allocate memory"), "it needs more memory"),
        (OSError("a.so: failed to map segment from shared object"), "it needs more memory"),
        (RuntimeError("can't start new thread"), "it needs more memory"),
        (ImportError("b.so: failed to map segment from shared object"), "it needs more memory"),
        (PandisError("not enough memory: too many faces cross"), "it needs more memory"),
        (caused(ReadError("a.obj: cannot be read"), OSError(errno.ENOMEM, "?")), "it needs more"),
        (PandisError("bad_alloc/a.obj: no faces"), "bad_alloc/a.obj: no faces"),
        (OSError(errno.ENOENT, "No such file", "MemoryError/a.obj"), "a file cannot be read"),
        (OSError(errno.EIO, "Input/output error"), "a file cannot be read or written: Input"),
        (ImportError("no module c"), "a defect of pandis"),
    ],
)
def test_a_lack_of_memory_is_named_whoever_notices_it(error, reason, tmp_path, monkeypatch):
    def fail(work, note):
        raise error

    monkeypatch.setattr(worker, "mesh_rows", fail)
    output = tmp_path / "box.npz"
    work = Work(Member("box", "box.obj", digest="0"), {}, {}, 0, output=str(output))
    assert worker._answer(work, lambda note: None) == {"written": str(output)}
    with np.load(output) as stored:
        facts = MeshFacts.model_validate_json(str(stored["facts"]))
    assert facts.failed.reason.startswith(reason)
    assert facts.again == reason.startswith("a file")


def test_a_rung_without_memory_does_not_leave_the_mesh_to_the_next_one(monkeypatch):
    def fail(vertices, faces):
        raise OSError("a.so: failed to map segment from shared object")

    monkeypatch.setitem(tools.OPERATIONS, "orient", fail)
    monkeypatch.setitem(tools._SETTINGS, "isolated", False)
    with pytest.raises(MemoryError):
        tools.call("orient", np.zeros((3, 3)), np.zeros((1, 3), int), seconds=9, memory_gb=1)


def test_what_cannot_be_read_now_is_tried_again_and_costs_no_other_mesh(tmp_path, monkeypatch):
    options = DatasetOptions.model_validate({"source": "x", "seed": 0})
    gone = Member("gone", str(tmp_path / "gone.stl"), digest="0")
    output = tmp_path / "gone.npz"
    work = Work(
        gone, options.mesh.model_dump(), options.samples.model_dump(), 0, output=str(output)
    )
    assert worker._answer(work, lambda note: None) == {"written": str(output)}
    with np.load(output) as stored:
        assert MeshFacts.model_validate_json(str(stored["facts"])).again

    def refuse(path):
        raise ReadError(f"{path}: the file cannot be read: Permission denied")

    (tmp_path / "parts").mkdir()
    for name in ("a", "b"):
        shape("box", extents=(1, 1, 1)).export(tmp_path / f"parts/{name}.obj")
    monkeypatch.setattr(sourcing, "file_digest", lambda path: refuse(path) if path.name == "a.obj"
                        else "0" * 64)  # fmt: skip
    task = options.model_copy(update={"source": str(tmp_path / "parts")})
    faults = {member.name: member.fault for member in members(task)}
    assert "Permission denied" in faults["a"]
    assert not faults["b"]


@pytest.mark.parametrize("source", ["", "{tmp}/link/.."])
def test_a_source_is_the_one_that_is_named(source, folder, tmp_path, monkeypatch):
    """Not the working folder, and not what lies beside a link."""
    (tmp_path / "real/inner").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "real/inner")
    monkeypatch.chdir(folder)
    with pytest.raises(PandisError):  # there is no mesh in real
        label(source.format(tmp=tmp_path), tmp_path / "parts.zarr")


@pytest.mark.slow
def test_a_store_of_other_options_is_not_mixed(folder, tmp_path):
    store, _ = label(folder, tmp_path / "parts.zarr")
    before = files_of(store.path)
    with pytest.raises(PandisError, match=r"other options \(samples.near\)"):
        label(folder, store.path, near=100)
    assert files_of(store.path) == before
    begun = store.path / "options.json"
    for same in (f"{folder}/", os.path.relpath(folder)):
        assert label(same, store.path)[1] == 0
    options = json.loads(begun.read_text())
    begun.write_text(json.dumps(options | {"place": "/before/the/folder/was/moved"}))
    assert label(options["source"], store.path)[1] == 0
    with pytest.raises(PandisError, match=r"other options \(source\)"):
        label(folder / "round", store.path)
    changed, computed = label(folder, store.path, near=100, force=True)
    assert computed == 4
    assert changed.summary.rows == 3 * 800
    (tmp_path / "other").mkdir()
    (tmp_path / "other/letter.txt").write_text("mine")
    with pytest.raises(PandisError, match="other files than a store"):
        label(folder, tmp_path / "other")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"nearr": 3}, "did you mean 'near'"),
        ({"surface": 0, "near": 0, "volume": 0}, "no points"),
        ({"override": {"box": {"mesh": {"opn": 1}}}}, "override.box.mesh.opn: unknown option"),
        ({"override": {"vase": {}}}, "there is no mesh vase"),
        (
            {"override": {"box": {"samples": dict.fromkeys(("surface", "near", "volume"), 0)}}},
            "override.box.samples: no points",
        ),
        ({"table": "none.csv"}, "there is no file or folder 'none.csv'"),
        ({"chunk": 0}, "chunk"),
        ({"fields": ["pandis"]}, "'pandis' is not a field"),
        ({"fields": ["auto"]}, "auto cannot be stored"),
        ({"fields": ["trilinear-auto"]}, "trilinear-auto cannot be stored"),
        ({"fields": ["exact", "exact"]}, "a field is named twice"),
    ],
)
def test_wrong_options_are_refused(folder, tmp_path, options, message):
    with pytest.raises(PandisError, match=message):
        label(folder, tmp_path / "parts.zarr", **options)
    assert not (tmp_path / "parts.zarr").exists()


@pytest.mark.slow
def test_an_index_is_not_read_over_newer_shards(folder, tmp_path):
    """Otherwise a mesh that was added would answer for its neighbour."""
    store, _ = label(folder, tmp_path / "parts.zarr")
    old = (store.path / "index.zarr.zip").read_bytes()
    shape("icosphere", subdivisions=1).export(folder / "a.ply")
    label(folder, store.path)
    (store.path / "index.zarr.zip").write_bytes(old)
    with pytest.raises(PandisError, match="newer than the index"):
        pandis.LabelStore(store.path).rows("box")


def test_a_worker_whose_parent_has_died_writes_nothing(folder, tmp_path):
    """It cannot say that a stage begins, which is no defect of the mesh."""
    data, output = (folder / "box.ply").read_bytes(), tmp_path / "box.npz"
    member = Member("box", str(folder / "box.ply"), digest=hashlib.sha256(data).hexdigest())
    options = DatasetOptions(source=str(folder))
    parts = options.mesh.model_dump(), options.samples.model_dump() | {"near": 100}
    work = Work(member, parts[0], parts[1], 0, output=str(output))
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "pandis.pipeline.dataset.worker", str(4 << 30)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=write,
                               env=environment(PYTHONPATH=str(ROOT / "workflow")))  # fmt: skip
    os.close(write)
    process.communicate(work.to_json().encode() + b"\n")
    assert (process.returncode, output.exists()) == (1, False)


@pytest.mark.slow
def test_a_store_that_is_built_anew_is_not_read_on_by_other_processes(folder, tmp_path):
    store, _ = label(folder, tmp_path / "parts.zarr")
    store.rows("box")
    shape("icosphere", subdivisions=1).export(folder / "a.ply")
    label(folder, store.path)
    store._shards[0]._process = -1  # as in a worker that is forked now
    with pytest.raises(PandisError, match="was built anew"):
        store.rows("box")


def test_a_store_is_not_named_like_one_mesh(folder, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["labels", str(folder), "-o", "s.zarr", "--name", "box", "--quiet"]) == 2
    assert "a store has many" in capsys.readouterr().err


@pytest.mark.slow
def test_what_failed_for_want_of_memory_is_tried_again_with_more(folder, tmp_path):
    path = tmp_path / "parts.zarr"
    assert not label(folder, path, memory_gb=0.2)[0].names
    store, computed = label(folder, path, memory_gb=4)
    assert (computed, len(store.names)) == (4, 3)


@pytest.mark.slow
def test_a_full_disk_ends_the_run_and_is_forgotten(folder, tmp_path):
    path = tmp_path / "parts.zarr"
    program = (
        "import resource, pandis\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))\n"
        f"pandis.label_meshes({str(folder)!r}, {str(path)!r}, surface=30_000)\n"
    )
    path_of_library = environment(PYTHONPATH=str(ROOT / "workflow"))
    done = subprocess.run([sys.executable, "-c", program], text=True, capture_output=True,
                          check=False, env=path_of_library)  # fmt: skip
    assert "cannot write" in done.stderr
    assert not (path / "index.zarr.zip").exists()
    store = pandis.label_meshes(folder, path, surface=30_000)
    assert len(store.names) == 3


def test_a_mesh_that_cannot_be_fetched_is_tried_at_every_run(tmp_path):
    (tmp_path / "list.txt").write_text(f"http://127.0.0.1:9/a.ply {'0' * 64}\n")
    for _ in range(2):
        store, computed = label(tmp_path / "list.txt", tmp_path / "s.zarr")
        assert computed == 1
        assert "cannot be fetched" in store.failed["a"].reason


def test_a_store_is_written_by_one_process(folder, tmp_path):
    store, _ = label(folder, tmp_path / "parts.zarr")
    with (store.path / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(PandisError, match="another process is writing this store"):
            label(folder, store.path)


def test_a_file_that_gets_the_right_ending_is_read(tmp_path):
    (tmp_path / "meshes").mkdir()
    shape("box", extents=(1, 1, 1)).export(tmp_path / "box.obj")
    (tmp_path / "box.obj").rename(tmp_path / "meshes/box.stl")
    store, _ = label(tmp_path / "meshes", tmp_path / "s.zarr")
    assert "box" in store.failed
    (tmp_path / "meshes/box.stl").rename(tmp_path / "meshes/box.obj")
    assert label(tmp_path / "meshes", store.path)[0].names == ["box"]


@pytest.mark.slow
def test_a_finished_shard_is_checked_before_it_is_taken(folder, tmp_path):
    store, _ = label(folder, tmp_path / "parts.zarr")
    shard = store.path / "shards/00000.zarr.zip"
    whole = shard.read_bytes()
    damaged = bytearray(whole)
    damaged[300:320] = bytes(20)
    shard.unlink()  # not through the hard link
    shard.write_bytes(damaged)
    with pytest.raises(PandisError, match="damaged"):
        list(pandis.LabelStore(store.path, columns=tuple(ROWS)))
    label(folder, store.path)
    assert shard.read_bytes() == whole


@pytest.mark.slow
def test_nothing_stays_in_the_temporary_folder(folder, tmp_path, monkeypatch):
    with zipfile.ZipFile(tmp_path / "all.zip", "w") as archive:
        grid = np.random.default_rng(0).random((300, 3, 3))
        soup = trimesh.Trimesh(grid.reshape(-1, 3), np.arange(900).reshape(-1, 3), process=False)
        archive.writestr("soup.ply", trimesh.exchange.ply.export_ply(soup))
    (tmp_path / "tmp").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    monkeypatch.setattr(tempfile, "tempdir", None)
    store, _ = label(tmp_path / "all.zip", tmp_path / "s.zarr", seconds=2)
    assert "longer than 2 s" in store.failed["soup"].reason
    assert not list((tmp_path / "tmp").iterdir())


def test_rows_that_do_not_exist_are_refused(folder, tmp_path):
    store, _ = label(folder, tmp_path / "parts.zarr")
    for chunk in (-1, 1):
        with pytest.raises(IndexError):
            store.rows("box", chunk)
    for columns in ((), ("sdf",)):
        with pytest.raises(PandisError, match="columns: a tuple"):
            pandis.LabelStore(store.path, columns=columns)
    with pytest.raises(PandisError, match="no rows of vase"):
        store.draw("vase")
    with pytest.raises(PandisError, match="workers: expected a whole number from 1"):
        pandis.label_meshes(folder, store.path, workers=0)


# --- sources ----------------------------------------------------------------------------------


def listed(source, **options):
    return {m.name: m for m in members(DatasetOptions(source=str(source), **options))}


def test_folders_patterns_lists_and_tables_name_the_same_meshes(folder, tmp_path):
    names = {"box", "cup", "none", "round/ball"}
    assert set(listed(folder)) == names
    assert set(listed(f"{folder}/**/*.obj")) == {"round/ball"}
    paths = [path for path in folder.rglob("*.*") if path.is_file()]
    texts = [str(path.relative_to(tmp_path)) for path in paths]
    (tmp_path / "list.txt").write_text("# meshes\n" + "\n".join(texts) + "\n")
    assert set(listed(tmp_path / "list.txt")) == {f"meshes/{name}" for name in names}
    with (tmp_path / "table.csv").open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["source", "name", "unit", "licence"])
        writer.writerow([texts[0], "first", "mm", "CC-BY"])
    first = listed(tmp_path / "table.csv")["first"]
    assert (first.unit, first.licence, first.fault) == ("mm", "CC-BY", "")


def test_meshes_with_one_name_another_digest_or_no_row_fail_alone(folder, tmp_path):
    shape("box", extents=(1, 1, 1)).export(folder / "cup.ply")
    table = tmp_path / "about.csv"
    table.write_text(f"name,sha256\nbox,{'0' * 64}\ncup,\nround/ball,\n")
    meshes = listed(folder, table=str(table))
    assert "2 files have the name cup" in meshes["cup"].fault
    assert "but the table says 000" in meshes["box"].fault
    assert "no row" in meshes["none"].fault
    assert not meshes["round/ball"].fault
    table.write_text("name\nbox\ncup\nround/ball\nnone\nvase\n")
    with pytest.raises(PandisError, match="names 1 meshes that are not in the source"):
        listed(folder, table=str(table))
    table.write_text("name\nbox\nbox\n")
    with pytest.raises(PandisError, match="line 3: box has a row already"):
        listed(folder, table=str(table))


def ball():
    return trimesh.exchange.ply.export_ply(shape("icosphere", subdivisions=1))


@pytest.mark.parametrize("ending", ["zip", "tar.gz"])
def test_an_archive_writes_nothing_outside_and_its_good_meshes_are_labelled(tmp_path, ending):
    path, outside = tmp_path / f"all.{ending}", tmp_path / "outside.ply"
    entries = {"good/a.ply": ball(), "../outside.ply": ball(), "/tmp/pandis-abs.ply": ball()}
    if ending == "zip":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in entries.items():
                archive.writestr(name, data)
            archive.writestr("bomb.ply", b"\0" * (RATIO * 200_000))
            link = zipfile.ZipInfo("link.ply")
            link.external_attr = 0o120777 << 16
            archive.writestr(link, "/etc/passwd")
    else:
        with tarfile.open(path, "w:gz") as archive:
            for name, data in entries.items():
                info = tarfile.TarInfo(name)
                info.size = len(data)
                archive.addfile(info, io.BytesIO(data))
            link = tarfile.TarInfo("link.ply")
            link.type, link.linkname = tarfile.SYMTYPE, "/etc/passwd"
            archive.addfile(link)
    store, _ = label(path, tmp_path / "all.zarr")
    assert store.names == ["good/a"]
    reasons = [why.reason for why in store.failed.values()]
    assert sum("leaves the archive" in why for why in reasons) == 2
    assert sum("is a link" in why for why in reasons) == 1
    assert sum("times its size" in why for why in reasons) == (ending == "zip")
    assert not outside.exists()
    assert not Path("/tmp/pandis-abs.ply").exists()


@pytest.mark.parametrize("ending", ["zip", "tar"])
def test_digests_in_a_table_are_those_of_the_files_in_an_archive(tmp_path, ending):
    path, data = tmp_path / f"all.{ending}", ball()
    if ending == "zip":
        with zipfile.ZipFile(path, "w") as archive:
            [archive.writestr(f"{name}.ply", data) for name in "ab"]
    else:
        with tarfile.open(path, "w") as archive:
            for name in "ab":
                info = tarfile.TarInfo(f"{name}.ply")
                info.size = len(data)
                archive.addfile(info, io.BytesIO(data))
    right = hashlib.sha256(data).hexdigest()
    (tmp_path / "t.csv").write_text(f"name,sha256\na,{right}\nb,{'0' * 64}\n")
    store, _ = label(path, tmp_path / "s.zarr", table=str(tmp_path / "t.csv"))
    assert store.names == ["a"]
    assert "but the table says 000" in store.failed["b"].reason


def test_a_tar_that_unpacks_to_much_more_is_refused(tmp_path):
    with tarfile.open(tmp_path / "all.tar.xz", "w:xz") as archive:
        info = tarfile.TarInfo("bomb.ply")
        info.size = 30_000_000
        archive.addfile(info, io.BytesIO(bytes(info.size)))
    assert "times the size of the archive" in listed(tmp_path / "all.tar.xz")["bomb"].fault


def test_awkward_names_cost_nothing_but_their_meshes(tmp_path):
    place = tmp_path / "parts [v2] <x>"
    place.mkdir()
    for name in (b"caf\xe9.ply", b"a" * 250 + b".ply", b"<!--<script>.ply", b"good.ply"):
        with open(os.path.join(os.fsencode(place), name), "wb") as stream:
            stream.write(ball())
    store, _ = label(place, tmp_path / "s.zarr")
    assert {"<!--<script>", "good"} <= set(store.names)
    assert any("not UTF-8" in why.reason for why in store.failed.values())
    page = (store.path / "card.html").read_text(encoding="utf-8")
    assert "<!--<script>" not in page


def test_a_path_above_a_list_is_no_name_above_the_store(tmp_path):
    (tmp_path / "lists").mkdir()
    (tmp_path / "a.ply").write_bytes(ball())
    (tmp_path / "lists/l.txt").write_text("../a.ply\n")
    (tmp_path / "lists/t.csv").write_text("source,name\n../a.ply,../../b\n")
    assert set(listed(tmp_path / "lists/l.txt")) == {"a"}
    assert "leaves the data set" in listed(tmp_path / "lists/t.csv")["b"].fault


def test_layouts_refuse_names_that_they_cannot_tell_apart(tmp_path):
    for name in ("a/b/x", "a-b/x"):
        (tmp_path / "meshes" / name).parent.mkdir(parents=True)
        (tmp_path / "meshes" / f"{name}.ply").write_bytes(ball())
    store, _ = label(tmp_path / "meshes", tmp_path / "s.zarr")
    for layout in set(LAYOUTS) - {"zarr"}:
        with pytest.raises(PandisError, match="would both be written to"):
            store.export(layout, tmp_path / "out")
    with pytest.raises(PandisError, match="at least 1"):
        store.export("npz", tmp_path / "out", volume=-1)


def test_a_damaged_archive_is_refused(tmp_path):
    path = tmp_path / "all.zip"
    path.write_bytes(b"PK\x03\x04 and nothing more")
    with pytest.raises(PandisError, match="no complete archive"):
        listed(path)


def test_a_mesh_that_changes_after_planning_fails_and_is_tried_again(folder, tmp_path, monkeypatch):
    from pandis.pipeline.api import datasets

    planned = datasets.plan_dataset

    def plan_then_change(*arguments):
        result = planned(*arguments)
        os.utime(folder / "box.ply")
        with (folder / "box.ply").open("ab") as stream:
            stream.write(b"\n")
        return result

    monkeypatch.setattr(datasets, "plan_dataset", plan_then_change)
    with pytest.raises(PandisError, match="meshes were changed after this run was planned"):
        label(folder, tmp_path / "parts.zarr")


def test_shards_are_by_hash_and_their_number_grows_in_powers_of_two():
    assert shard_count(1) == shard_count(80) == 1
    assert shard_count(81) == 2
    assert shard_count(10_000) == 128
    counts = np.bincount([shard_of(f"mesh{k}", 128) for k in range(10_000)], minlength=128)
    assert counts.min() > 40
    assert all(shard_of(f"m{k}", 4) % 2 == shard_of(f"m{k}", 2) for k in range(100))


# --- layouts ----------------------------------------------------------------------------------


def occupancies(folder):
    """Read every model of `vecset`, by the keys of 3DShape2VecSet's data set."""
    for listing in sorted(folder.glob("ShapeNetV2_point/*/train.lst")):
        for model in listing.read_text().split("\n"):
            category = listing.parent.name
            with np.load(listing.parent / f"{model}.npz") as data:
                points = {key: (data[f"{key}_points"], data[f"{key}_label"])
                          for key in ("vol", "near")}  # fmt: skip
            scale = np.load(listing.parent / f"{model}.npy").item()
            cloud = folder / f"ShapeNetV2_watertight/{category}/4_pointcloud/{model}.npz"
            with np.load(cloud) as data:
                surface = data["points"].astype(np.float32) * scale
            yield points, surface


def exact(store, name, points):
    vertices, faces = store.mesh(name)
    centre, scale = store.frame(name)
    corners, faces = (vertices - centre) * scale, faces.astype(np.int64)
    points = points.astype(np.float64)
    square = igl.point_mesh_squared_distance(points, corners, faces)[0]
    return np.where(igl.winding_number(corners, faces, points) > 0.5, 1, -1) * -np.sqrt(square)


@pytest.fixture
def ball_store(folder, tmp_path):
    return label(f"{folder}/**/*.obj", tmp_path / "ball.zarr")[0]


COUNTS = {"volume": 500, "near": 400, "surface": 300, "sharp": 60}


def test_vecset_has_occupancies_of_the_points_that_it_states(ball_store, tmp_path):
    ball_store.export("vecset", tmp_path / "out", **COUNTS)
    ((points, surface),) = occupancies(tmp_path / "out")
    assert surface.shape == (300, 3)
    for key, count in (("vol", 500), ("near", 400)):
        rows, labels = points[key]
        assert rows.shape == (count, 3)
        assert ((exact(ball_store, "round/ball", rows) < 0) == (labels == 1)).all()
        assert 0 < labels.mean() < 1


def test_hunyuan_labels_are_exact_in_half_precision(ball_store, tmp_path):
    ball_store.export("hunyuan", tmp_path / "out", **COUNTS)
    with np.load(tmp_path / "out/round/ball_surface.npz") as data:
        assert data["random_surface"].shape == (300, 6)
        assert data["sharp_surface"].dtype == np.float16
    with np.load(tmp_path / "out/round/ball_sdf.npz") as data:
        assert str(data["sign"]) == "positive outside"
        for key in ("vol", "random_near", "sharp_near"):
            points, labels = data[f"{key}_points"], data[f"{key}_label"]
            assert points.dtype == labels.dtype == np.float16
            off = np.abs(labels - exact(ball_store, "round/ball", points))
            assert (off <= np.spacing(np.abs(labels))).all()


def test_dora_has_surfaces_with_normals_and_points_with_distances(folder, tmp_path):
    store, _ = label(f"{folder}/box.*", tmp_path / "box.zarr")
    store.export("dora", tmp_path / "out", **COUNTS)
    with np.load(tmp_path / "out/all/box.npz") as data:
        assert data["fps_coarse_surface"].shape == (300, 1, 6)
        sharp = data["fps_sharp_surface"][:, 0]
        for key, count in (("sharp_near_surface", 60), ("rand_points", 900)):
            rows = data[key]
            assert rows.shape == (count, 4)
            off = np.abs(rows[:, 3] - exact(store, "box", rows[:, :3]))
            assert (off <= np.spacing(np.abs(rows[:, 3])) + 1e-12).all()
    half = np.array([3, 2, 1]) * 0.3  # the box in its unit frame
    on_faces = np.isclose(np.abs(sharp[:, :3]), half, atol=1e-6).sum(axis=1)
    assert (on_faces >= 2).all()


def test_rows_are_written_as_files_and_as_tars(ball_store, tmp_path):
    (path,) = ball_store.export("npz", tmp_path / "npz")
    rows = pandis.LabelStore(ball_store.path, columns=tuple(ROWS)).rows("round/ball")
    with np.load(path) as data:
        assert all((data[name] == rows[name]).all() for name in ROWS)
        assert str(data["sign"]) == "negative inside"
    (path,) = ball_store.export("webdataset", tmp_path / "tars")
    with tarfile.open(path) as archive:
        assert archive.getnames() == ["round-ball.npz", "round-ball.json"]
        data = np.load(io.BytesIO(archive.extractfile("round-ball.npz").read()))
        assert (data["distance"] == rows["distance"]).all()


def test_all_rows_are_written_as_one_zarr_group(folder, tmp_path, monkeypatch):
    import zarr

    monkeypatch.setattr("pandis.pipeline.dataset.joined._ROWS_PER_FILE", 512)  # several files
    store, _ = label(folder, tmp_path / "s.zarr", chunk=256)
    files = store.export("zarr", tmp_path / "all.zarr")
    assert all(path.is_file() for path in files)
    group = zarr.open(tmp_path / "all.zarr", mode="r")
    listed = group.attrs["meshes"]
    assert [mesh["name"] for mesh in listed] == store.names
    assert len(listed) > 1
    assert group["points"].shards
    assert group.attrs["sign"] == "negative inside"
    whole = pandis.LabelStore(store.path, columns=tuple(ROWS))
    for mesh in listed:
        expected = whole.rows(mesh["name"])
        start, count = mesh["rows"]
        for name in ROWS:
            assert (group[name][start : start + count] == expected[name]).all()
        for name, expected in zip(MESH, store.mesh(mesh["name"]), strict=True):
            start, count = mesh[name]
            assert (group[name][start : start + count] == expected).all()
        centre, scale = store.frame(mesh["name"])
        assert mesh["centre"] == centre.tolist()
        assert mesh["scale"] == scale
    assert group["points"].shape[0] == sum(mesh["rows"][1] for mesh in listed)
    with pytest.raises(PandisError, match="no empty folder"):
        store.export("zarr", tmp_path / "all.zarr")


def test_one_zarr_group_is_written_whole_or_not_at_all(folder, tmp_path, monkeypatch):
    store, _ = label(folder, tmp_path / "s.zarr")
    target, rows = tmp_path / "out", pandis.LabelStore.rows
    with monkeypatch.context() as patched:
        patched.setattr(pandis.LabelStore, "rows", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            store.export("zarr", target)
        assert not target.exists()

        def second(self, name):  # another process is faster
            if not target.joinpath("zarr.json").exists():
                patched.setattr(pandis.LabelStore, "rows", rows)
                target.rename(tmp_path / "aside")
                self.export("zarr", target)
                for path in (tmp_path / "aside").iterdir():
                    path.rename(target / path.name)
            return rows(self, name)

        patched.setattr(pandis.LabelStore, "rows", second)
        with pytest.raises(PandisError, match="no empty folder"):
            store.export("zarr", target)
    assert not [path for path in target.iterdir() if path.name.startswith(".")]
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    command = ["layout", str(store.path), "--as", "zarr", "-o", "."]
    assert main(command) == 0
    written = {path.name for path in (tmp_path / "here").iterdir()}
    assert written == {path.name for path in target.iterdir()}
    assert main(command) != 0


def test_unknown_layouts_and_columns_are_refused(ball_store, tmp_path):
    with pytest.raises(PandisError, match=f"there are {LAYOUTS[0]}"):
        ball_store.export("obj", tmp_path / "out")
    with pytest.raises(PandisError, match="is needed, not"):
        pandis.LabelStore(ball_store.path, columns=("sdf",))
    with pytest.raises(PandisError, match="no finished data set"):
        pandis.LabelStore(tmp_path)
