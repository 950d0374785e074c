"""Scenes of pandis.h: only what the probe may touch is asked, and nothing comes out differently."""

import json
import shutil
import struct
import subprocess
import zlib
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import pandis
from pandis.base.errors import PandisError
from pandis.pipeline.check.verification import Checker
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.judge.scenes import try_scene
from pandis.pipeline.kinds.clearance import clearance
from pandis.pipeline.kinds.field import INVALID
from pandis.pipeline.kinds.native import native_bytes
from pandis.pipeline.run.ask.tasks import SceneTask
from pandis.pipeline.run.job.artifact import write_artifact
from pandis.pipeline.run.job.stage import silent_progress
from pandis.runtime.field import NativeField
from pandis.runtime.scene import NativeScene, Placed

ENGINE = Path(pandis.__file__).parent / "engine"
#: Way of a tick at 0.5 m/s (m).
PACE = 5e-4


def same_bits(one, other):
    """Tell whether two float64 arrays hold the same bits: 0 and -0 differ."""
    return np.array_equal(one.view(np.uint64), other.view(np.uint64))


def walk(count, rng, size):
    """Return a random walk (count, 3) in a cube of half side ``size``, reflected at its faces."""
    steps = rng.normal(size=(count, 3)) * PACE / np.sqrt(3)
    # runs of one direction among them: a probe goes somewhere
    steps += np.repeat(rng.normal(size=(count // 50 + 1, 3)), 50, axis=0)[:count] * PACE / 2
    path = np.cumsum(steps, axis=0) / size
    return size * (1 - np.abs((path + 1) % 4 - 2))


def place(field, rng, size, where=0.15):
    """Place a field somewhere, turned anyhow, with its longest side of ``size`` metres."""
    scale = size * field.frame.scale / 1.8
    rotation = Rotation.random(random_state=rng.integers(1 << 31)).as_matrix()
    centre = scale * rotation @ np.array(field.frame.centre)
    return Placed(field, rotation, rng.uniform(-where, where, 3) - centre, scale, 400.0)


def room(files, names, count, seed):
    rng = np.random.default_rng(seed)
    opened = {name: NativeField(files[name]) for name in names}
    return [place(opened[names[k % len(names)]], rng, rng.uniform(0.02, 0.1)) for k in range(count)]


KINDS = ("exact", "nearest", "trilinear", "trilinear-normal", "tricubic", "spline", "gradient")
KINDS += ("sphere", "torus", "box", "capsule")


def compare(objects, points):
    scene = NativeScene(objects)
    answer = scene.answer(points)
    assert same_bits(answer.force, scene.ask_all(points))
    assert answer.force.any()
    return answer


@pytest.mark.parametrize("name", KINDS)
def test_forces_are_those_of_asking_every_object(name, files):
    """To the last bit, along 20,000 ticks among ten objects of a kind."""
    answer = compare(room(files, [name], 10, 1), walk(20_000, np.random.default_rng(2), 0.15))
    if name not in ("nearest", "gradient"):  # whose distances are too far off to go by
        assert answer.queries.mean() < 1.5


def test_many_objects_of_all_kinds(files):
    answer = compare(room(files, KINDS, 77, 3), walk(5_000, np.random.default_rng(4), 0.2))
    assert np.median(answer.queries) < 30


@pytest.mark.full
def test_ten_million_ticks_among_two_hundred_splines(files):
    objects, rng = room(files, ["spline"], 200, 5), np.random.default_rng(6)
    scene, contacts = NativeScene(objects), 0
    for _ in range(100):
        points = walk(100_000, rng, 0.15)
        answer = scene.answer(points)
        assert same_bits(answer.force, scene.ask_all(points))
        contacts += answer.force.any(axis=1).sum()
    assert contacts > 100_000


@pytest.mark.full
def test_a_hundred_thousand_ticks_among_networks(files):
    """Untrained ones err everywhere: they are hardly ever left out, and must be right then."""
    for name in ("network", "gradient"):
        compare(room(files, [name], 10, 17), walk(100_000, np.random.default_rng(18), 0.15))


def resealed(data, safe):
    """Return a file with another clearance and the right checksum."""
    made = bytearray(data)
    (count,) = struct.unpack_from("<I", made, 36)
    names = [struct.unpack_from("<4sIQQ", made, 256 + 24 * k) for k in range(count)]
    start = next(start for name, _, start, _ in names if name == b"SAFE")
    made[start : start + 72] = struct.pack("<9d", *safe)
    made[24:28] = struct.pack("<I", zlib.crc32(made[32:]))
    return bytes(made)


def test_the_margin_is_what_keeps_contacts(files):
    """A field whose distances are too large is left asleep where its file says nothing of it."""
    data = files["gradient"].read_bytes()
    wrong = NativeField(resealed(data, [-0.9, -0.9, -0.9, 0.9, 0.9, 0.9, 0.0, 0.0, 0.0]))
    objects = [place(wrong, np.random.default_rng(7), 0.1, 0.0)]
    points = walk(20_000, np.random.default_rng(8), 0.05)
    scene = NativeScene(objects)
    assert not same_bits(scene.answer(points).force, scene.ask_all(points))


def test_a_file_that_says_nothing_is_always_asked(fields):
    field = NativeField(native_bytes(fields["tricubic"], {}))
    objects = [place(field, np.random.default_rng(9), 0.1, 0.0)]
    answer = compare(objects, walk(2_000, np.random.default_rng(10), 0.3))
    assert (answer.queries == 1).all()


@pytest.mark.parametrize(
    "safe",
    [
        [-0.9] * 3 + [0.9] * 3 + [-1e-9, 0.0, 0.0],
        [-0.9] * 3 + [0.9] * 3 + [0.0, np.nan, 0.0],
        [0.9] * 3 + [-0.9] * 3 + [0.0, 0.0, 0.0],
        [np.nan] * 3 + [0.9] * 3 + [0.0, 0.0, 0.0],
        [-0.9] * 3 + [np.inf] * 3 + [0.0, 0.0, 0.0],
        [-0.9] * 3 + [0.9] * 3 + [0.0, 0.0, -1e-9],
        [-0.9] * 3 + [0.9] * 3 + [0.0, 0.0, np.nan],
    ],
)
def test_a_clearance_that_cannot_be_is_refused(safe, files):
    with pytest.raises(PandisError, match="are inconsistent"):
        NativeField(resealed(files["tricubic"].read_bytes(), safe))


def test_clearance_is_what_a_field_errs(fields, meshes):
    """Exact fields have none, the nearest node's has that of half its cell's diagonal, and more."""
    found = {}
    for name in ("exact", "sphere", "tricubic", "trilinear-normal", "nearest"):
        field, mesh = fields[name], meshes[name]
        safe = clearance(lambda p, f=field: f.query(p)[::2], Body.open(mesh).distance)
        found[name] = safe[6]
        assert safe[:6] == pytest.approx([-0.9, -0.9, safe[2], 0.9, 0.9, -safe[2]], abs=1e-12)
        assert safe[7] >= found[name] or name in ("exact", "sphere")
    assert found["exact"] < 1e-8
    assert found["sphere"] < 1e-8
    assert max(found["tricubic"], found["trilinear-normal"]) < found["nearest"]
    assert found["nearest"] > 0.05


def test_what_moves_is_looked_at_again(files):
    """Nothing is known of an object that was moved."""
    objects = room(files, ["torus"], 3, 11)
    scene, point = NativeScene(objects), np.array([[0.0, 0.0, 0.0]])
    scene.answer(point)
    inside = objects[1].field.frame.to_mesh(np.array([[1.0 * 0.9 * 1 / 1.4, 0, 0]]))[0]
    objects[1] = objects[1]._replace(translation=-objects[1].scale * objects[1].rotation @ inside)
    scene.move(1, objects[1])
    assert same_bits(scene.answer(point).force, NativeScene(objects).ask_all(point))
    assert scene.answer(point).force.any()


def twisted(vertices, angle):
    """Return vertices stretched along x, and turned around it the more, the farther along."""
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    at = (vertices - middle) * [1.6, 1, 1]
    turn = angle * at[:, 0] / np.ptp(at[:, 0])
    y, z = np.cos(turn) * at[:, 1] - np.sin(turn) * at[:, 2], np.sin(turn) * at[:, 1]
    return np.stack([at[:, 0], y, z + np.cos(turn) * at[:, 2]], axis=1) + middle


def test_a_shape_that_moves_is_felt_where_it_is(files, fields):
    """Also where it reaches out of the box that it had; forces are those of asking every object."""
    field = fields["exact"]
    vertices = field.frame.to_mesh(field.engine.vertices)
    moving, rng = NativeField(files["exact"]).moving(), np.random.default_rng(21)
    objects = [*room(files, ["torus", "spline"], 4, 22), place(moving, rng, 0.1)]
    scene, own = NativeScene(objects), objects[-1]
    for angle in (0.2, 1.5, 0.7):
        shape = twisted(vertices, angle)
        moving.refit(shape)
        scene.move(4, own)
        at = own.scale * shape @ own.rotation.T + own.translation
        points = at[rng.integers(len(at), size=3000)] + rng.normal(0, 1e-3, (3000, 3))
        answer = scene.answer(points)
        assert same_bits(answer.force, scene.ask_all(points))
        outside = (np.abs(field.frame.to_unit(shape)) > 1).any(axis=1)
        assert answer.force.any(axis=1).mean() > 0.2
        assert outside.any()


@pytest.mark.parametrize(
    "change",
    [
        {"rotation": np.eye(3) * 1.01},
        {"rotation": np.diag([1.0, 1.0, -1.0])},
        {"rotation": np.full((3, 3), np.nan)},
        {"scale": 0.0},
        {"scale": -1.0},
        {"scale": np.nan},
        {"stiffness": -1.0},
        {"translation": np.array([0, np.inf, 0])},
    ],
)
def test_an_object_that_lies_nowhere_is_refused(change, files):
    objects = room(files, ["sphere"], 2, 12)
    with pytest.raises(PandisError, match="its rotation, scale, place"):
        NativeScene([objects[0], objects[1]._replace(**change)])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
def test_no_place_no_force(bad, files):
    """And the next tick is as if it had not been."""
    scene = NativeScene(room(files, ["spline"], 40, 13))
    points = walk(200, np.random.default_rng(14), 0.1)
    points[::3, 1] = bad
    answer = scene.answer(points)
    assert (answer.flag[::3] == INVALID).all()
    assert not answer.force[::3].any()
    good = np.arange(200) % 3 > 0
    assert same_bits(answer.force[good], scene.ask_all(points[good]))


def test_rotations_in_single_precision_lose_no_contact(files):
    """They stretch by up to 1e-7: seen from ten metres away that is a micrometre."""
    rng = np.random.default_rng(15)
    rotations = [np.eye(3) * (1 + 4e-7), np.eye(3) * (1 - 4e-7)]
    rotations += [Rotation.random(random_state=k).as_matrix().astype(np.float32) for k in range(9)]
    for rotation in rotations:
        placed = place(NativeField(files["sphere"]), rng, 0.1, 0.0)
        scene = NativeScene([placed._replace(rotation=np.asarray(rotation, np.float64))])
        way = rng.normal(size=(500, 3))
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        near = way * (0.05 + rng.uniform(-1e-5, 1e-5, 500))[:, None]
        points = np.stack([10 * way, near], axis=1).reshape(-1, 3)
        assert same_bits(scene.answer(points).force, scene.ask_all(points))


def test_what_is_moved_must_be_there(files):
    objects = room(files, ["sphere"], 2, 16)
    scene = NativeScene(objects)
    scene.move(-1, objects[0])
    for index in (2, -3):
        with pytest.raises(IndexError):
            scene.move(index, objects[0])


def test_an_empty_scene_is_free_space():
    answer = NativeScene([]).answer(np.zeros((3, 3)))
    assert not answer.force.any()
    assert not answer.queries.any()


# --- scenes of the workflow -----------------------------------------------------------


OBJECTS = [
    {"name": "left", "mesh": "a", "field": "spline", "position": (-0.03, 0, 0.01)},
    {"name": "right", "mesh": "a", "field": "spline", "position": (0.03, 0, 0)},
    {"name": "ball", "mesh": "b", "field": "sphere", "position": (0.0, 0.05, 0.0)},
]
COMMON = {"rotation": (10.0, 90.0, -20.0), "size": 0.05, "stiffness": 400.0}


@pytest.fixture
def tried(files, tmp_path):
    """Return the files, arrays, attributes and text of a scene that was tried."""
    found = []
    for mesh, name in (("a", "spline"), ("b", "sphere")):
        path = tmp_path / mesh / "export" / f"{name}.pandis"
        path.parent.mkdir(parents=True)
        path.write_bytes(files[name].read_bytes())
        found.append(path)
    options = SceneTask(objects=[own | COMMON for own in OBJECTS], ticks=5000, speed=0.5)
    return found, *try_scene("my-table", found, options, progress=silent_progress, log=print)


def test_a_scene_is_tried(tried):
    _, arrays, attributes, text = tried
    assert attributes["different"] == 0
    assert 0.1 < attributes["touched_share"] < 0.9
    assert attributes["asked_mean"] < 1.5
    proxies = attributes["proxies"]
    assert proxies["different"] == 0
    assert 0 < proxies["queries_mean"] < 8
    assert proxies["touched_share"] > attributes["touched_share"]  # a proxy stays where it was
    assert arrays["proxy_force"].any()
    assert json.loads(text)["sentence"].endswith("every force equals that of asking every object")
    steps = np.linalg.norm(np.diff(arrays["points"], axis=0), axis=1)
    assert np.median(steps) == pytest.approx(5e-4)
    left = attributes["objects"][0]
    centre = NativeField(left["file"]).frame.centre
    there = left["scale"] * np.array(left["rotation_matrix"]) @ centre + left["translation"]
    assert there == pytest.approx(OBJECTS[0]["position"])


def test_a_scene_with_penalty_forces_alone_has_no_proxies(tried):
    found, *_ = tried
    asked = [own | COMMON | {"contact": {"kind": "penalty"}} for own in OBJECTS]
    options = SceneTask(objects=asked, ticks=500, speed=0.5)
    arrays, attributes, _ = try_scene("table", found, options, progress=silent_progress, log=print)
    assert attributes["proxies"] is None
    assert attributes["no_proxies"] == "left: contact.kind asks for penalty forces"
    assert "proxy_force" not in arrays


def test_a_scene_that_loses_contacts_fails(tried, tmp_path):
    found, *_ = tried
    data = resealed(found[0].read_bytes(), [-0.1] * 3 + [0.1] * 3 + [0.0] * 3)
    found[0].write_bytes(data)  # so small a box: nearly all of it is left out
    options = SceneTask(objects=[own | COMMON for own in OBJECTS], ticks=5000, speed=0.5)
    with pytest.raises(PandisError, match=r"scene table: .* export it again"):
        try_scene("table", found, options, progress=silent_progress, log=print)


def both_forces(arrays):
    """Return the bytes of the penalty's force and the proxy's, tick by tick."""
    return np.stack([arrays["force"], arrays["proxy_force"]], axis=1).tobytes()


def compiled(tmp_path, header, points):
    """Return the bytes of both forces that a C program with a scene's header (my-table) gives."""
    (tmp_path / "scene.h").write_text(header)
    (tmp_path / "main.c").write_text(
        '#define PANDIS_IMPLEMENTATION\n#include "scene.h"\n'
        "int main(void) {\n"
        "    static double room[PANDIS_SCENE_ROOM(MY_TABLE_OBJECTS)];\n"
        "    static double more[PANDIS_SCENE_ROOM(MY_TABLE_OBJECTS)];\n"
        "    static pandis_contact contacts[MY_TABLE_OBJECTS];\n"
        "    double point[3], force[3], felt[3];\n"
        "    pandis_scene scene, touched;\n"
        "    for (int k = 0; k < MY_TABLE_FILES; k++)\n"
        "        if (pandis_open_file(my_table_fields + k, my_table_files[k])) return 1;\n"
        "    if (pandis_scene_open(&scene, my_table_objects, MY_TABLE_OBJECTS, room,\n"
        "                          PANDIS_SCENE_ROOM(MY_TABLE_OBJECTS))) return 2;\n"
        "    pandis_scene_open(&touched, my_table_objects, MY_TABLE_OBJECTS, more,\n"
        "                      PANDIS_SCENE_ROOM(MY_TABLE_OBJECTS));\n"
        "    my_table_touch_open(&touched, contacts);\n"
        "    while (fread(point, sizeof point, 1, stdin) == 1) {\n"
        "        pandis_scene_force(&scene, point, force);\n"
        "        pandis_scene_touch(&touched, point, 1e-3, felt, NULL, 0, NULL);\n"
        "        fwrite(force, sizeof force, 1, stdout);\n"
        "        fwrite(felt, sizeof felt, 1, stdout);\n"
        "    }\n"
        "    return 0;\n}\n"
    )
    command = ["gcc", "-std=c99", "-O2", "-Wall", "-Wextra", "-Werror"]
    command += ["-I", ENGINE, tmp_path / "main.c", "-o", tmp_path / "main", "-lm"]
    subprocess.run(command, check=True)
    done = subprocess.run(
        [tmp_path / "main"], input=points.tobytes(), capture_output=True, check=True
    )
    return done.stdout


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("gcc"), reason="no gcc here")
def test_the_header_of_a_scene_compiles_and_answers_the_same(tried, tmp_path):
    _, arrays, attributes, _ = tried
    assert compiled(tmp_path, attributes["header"], arrays["points"]) == both_forces(arrays)


def test_the_header_of_a_scene_is_what_verify_compares_it_with(tried, tmp_path):
    _, arrays, attributes, text = tried
    write_artifact(tmp_path / "s.zarr.zip", "scene", arrays, attributes=attributes, provenance={})
    (tmp_path / "s.h").write_text(attributes["header"])
    (tmp_path / "s.json").write_text(text)
    for ending in ("h", "json"):
        assert Checker._companion(None, tmp_path / f"s.{ending}") is None
    (tmp_path / "s.h").write_text(attributes["header"] + "\n")
    assert Checker._companion(None, tmp_path / "s.h") == "differs from its artifact"
