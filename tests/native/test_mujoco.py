"""The plugin for MuJoCo: distances are the library's, bit for bit, and what is wrong is said."""

import copy
import json
import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import trimesh
from test_header import resealed, section

from pandis.__main__ import main
from pandis.base.errors import PandisError
from pandis.base.frame import Frame
from pandis.bridges import mujoco as plugin
from pandis.bridges.mujoco import mjcf
from pandis.bridges.mujoco.asking import asker
from pandis.engine.compiler import find_compiler
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.clearance import clearance
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.kinds.native import native_bytes
from pandis.runtime.field import NativeField
from pandis.runtime.scene import Placed
from support import ROOT, artifact

mujoco = pytest.importorskip("mujoco", reason="no MuJoCo here: pip install mujoco-core")
pytestmark = pytest.mark.skipif(find_compiler() is None, reason="no C compiler here")

#: What has a distance everywhere: each kind of file.
KINDS = "exact", "compact", "spline", "tricubic", "trilinear-normal", "network", "gradient", "torus"
FROM_FIELD = '<mesh name="b"><plugin instance="b"/></mesh>'


@pytest.fixture(scope="module", autouse=True)
def registered():
    plugin.register()


@pytest.fixture(autouse=True)
def _log(monkeypatch, tmp_path):
    """MuJoCo writes warnings into a file where the program was started."""
    monkeypatch.chdir(tmp_path)


def xml_of(path, mesh=FROM_FIELD, scale=0.25, more="", world=""):
    return f"""
        <mujoco><option sdf_iterations="20"/>
          <extension><plugin plugin="pandis.sdf"><instance name="b">
            <config key="file" value="{path}"/><config key="scale" value="{scale}"/>
          </instance></plugin></extension>
          <asset>{mesh}{more}</asset>
          <worldbody>
            <body name="object" pos="0.3 -0.2 0.1" euler="20 30 40">
              <geom name="object" type="sdf" mesh="b"><plugin instance="b"/></geom></body>
            {world}
          </worldbody></mujoco>"""


def model_of(*asked, **named):
    return mujoco.MjModel.from_xml_string(xml_of(*asked, **named))


def answers(model, points):
    """Return what MuJoCo has of the first geom's distance (n,) and gradient (n, 3)."""
    return asker(model)(points)


@pytest.mark.parametrize("name", KINDS)
def test_distances_and_gradients_are_those_of_the_library(files, name):
    """At a scale that is a power of two to the last bit, beyond the box of the field, too."""
    field = NativeField(files[name])
    points = field.frame.to_mesh(np.random.default_rng(0).uniform(-1.3, 1.3, (500, 3)))
    distances, gradients = answers(model_of(files[name]), 0.25 * points)
    wanted = field.query(points)
    assert np.array_equal(distances, 0.25 * wanted.distance)
    assert np.array_equal(gradients, wanted.normal)
    assert (distances < 0).sum() > 10


def test_what_is_kept_of_a_spline_changes_no_bit(files):
    """Points around a few places, again and again, so that cells are found kept, and put out."""
    field, rng = NativeField(files["spline"]), np.random.default_rng(6)
    places = rng.uniform(-1.1, 1.1, (40, 1, 3)) + rng.normal(0, 0.02, (40, 30, 3))
    points = field.frame.to_mesh(np.tile(places.reshape(-1, 3), (3, 1)))
    rng.shuffle(points[len(points) // 2 :])
    distances, gradients = answers(model_of(files["spline"]), 0.25 * points)
    wanted = field.query(points)
    assert np.array_equal(distances, 0.25 * wanted.distance)
    assert np.array_equal(gradients, wanted.normal)
    assert (wanted.flag == 0).sum() > 300


@pytest.mark.slow
def test_files_that_share_a_place_in_a_thread_keep_their_own_cells(files, tmp_path):
    """More files than a thread keeps, asked in turns at the same points."""
    data, models = files["spline"].read_bytes(), []
    at = section(data, b"BCOF")
    coarse = np.frombuffer(data, "<i2", 2000, at) // 2
    for number in range(9):  # each with other coefficients
        path = tmp_path / f"{number}.pandis"
        path.write_bytes(resealed(data, at, "<2000h", *(coarse + 100 * number)))
        models.append((NativeField(path), asker(model_of(path))))
    points = models[0][0].frame.to_mesh(np.random.default_rng(7).uniform(-1, 1, (60, 3)))
    for field, ask in models * 2:
        distances, _ = ask(0.25 * points)
        assert np.array_equal(distances, 0.25 * field.query(points).distance)


def obj_of(mesh, path):
    """Write a mesh, turned as MuJoCo's own frame is not, as a file."""
    trimesh.Trimesh(mesh.arrays["vertices"], mesh.arrays["faces"], process=False).export(path)
    return path


def test_a_mesh_of_a_file_is_where_the_field_is(files, meshes, tmp_path):
    """MuJoCo moves the origin of such a mesh to its centre of mass, and the field goes along."""
    path = obj_of(meshes["exact"], tmp_path / "torus.obj")
    mesh = f'<mesh name="b" file="{path}" scale="0.25 0.25 0.25"/>'
    model, field = model_of(files["exact"], mesh), NativeField(files["exact"])
    assert np.abs(model.mesh_pos[0]).max() > 0.1
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.mesh_quat[0])
    turn = turn.reshape(3, 3)
    assert not np.allclose(turn, np.eye(3))
    points = field.frame.to_mesh(np.random.default_rng(1).uniform(-1, 1, (300, 3)))
    distances, gradients = answers(model, (0.25 * points - model.mesh_pos[0]) @ turn)
    wanted = field.query(points)
    assert distances == pytest.approx(0.25 * wanted.distance, abs=1e-9)
    assert gradients @ turn.T == pytest.approx(wanted.normal, abs=1e-6)


BALL = """<body name="ball" pos="{at}"><freejoint/><geom name="ball" size="0.02"/></body>"""


@pytest.mark.parametrize("name", ["exact", "compact", "spline", "tricubic", "sphere"])
def test_a_ball_that_falls_onto_an_object_stays_outside(files, name):
    """From a place over its surface; it sinks in by a part of the ball, which is soft."""
    field = NativeField(files[name])
    model = model_of(files[name], scale=0.05, world=BALL.format(at="0 0 0"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    turn, at = data.geom_xmat[0].reshape(3, 3), data.geom_xpos[0].copy()
    around = field.frame.to_mesh(np.random.default_rng(2).uniform(-0.9, 0.9, (4000, 3)))
    inside = around[field.query(around).distance < 0] * 0.05 @ turn.T + at
    data.qpos[:3] = inside[inside[:, 2].argmax()] + [0, 0, 0.05]
    deepest, touched = -np.inf, 0
    for _ in range(600):
        mujoco.mj_step(model, data)
        point = (data.qpos[:3] - at) @ turn / 0.05
        deepest = max(deepest, 0.02 - 0.05 * field.query(point).distance[0])
        touched += data.ncon > 0
    assert touched > 3
    assert deepest < 0.01


def test_the_tactile_sensor_feels_the_field(files):
    """A plate of taxels that lies in a ball says how deep each of them is."""
    plate = '<mesh name="plate" builtin="plate" params="9 9" scale="0.02 0.02 0.002"/>'
    pad = """<body name="pad" pos="0.3 -0.2 0.345"><freejoint/>
        <geom type="box" size="0.02 0.02 0.002"/>
        <geom name="skin" type="mesh" mesh="plate" contype="0" conaffinity="0"/></body>"""
    field, scale = NativeField(files["sphere"]), 0.25
    side = scale * 0.9 / field.frame.scale
    pad = pad.replace("0.345", repr(0.1 + side - 0.001))
    text = '<sensor><tactile geom="skin" mesh="plate"/></sensor></mujoco>'
    spec = mujoco.MjSpec.from_string(
        xml_of(files["sphere"], scale=scale, more=plate, world=pad).replace("</mujoco>", text)
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    depths = data.sensordata[: len(data.sensordata) // 3]
    skin = model.geom("skin").id
    mesh = model.geom_dataid[skin]
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    turn, at = data.geom_xmat[skin].reshape(3, 3), data.geom_xpos[skin]
    taxels = model.mesh_vert[first : first + count] @ turn.T + at
    wanted = side - np.linalg.norm(taxels - [0.3, -0.2, 0.1], axis=1)
    assert len(depths) == count
    assert depths == pytest.approx(np.maximum(wanted, 0), abs=1e-6)
    assert depths.max() > 5e-4


def test_threads_with_data_of_their_own_get_the_same(files):
    """What a thread has asked last is its own, and a copy of the data has its own instance."""
    model = model_of(files["exact"], scale=0.05, world=BALL.format(at="0.3 -0.2 0.25"))
    first = mujoco.MjData(model)

    def fall(data):
        for _ in range(300):
            mujoco.mj_step(model, data)
        return data.qpos.copy()

    with ThreadPoolExecutor(4) as pool:
        ends = list(pool.map(fall, [copy.copy(first) for _ in range(4)]))
    alone = fall(first)
    assert all(np.array_equal(end, alone) for end in ends)


def plate(thickness, path, more=()):
    """Write the exact field of a plate, askew, and of more meshes; returns the mesh."""
    box = trimesh.creation.box((1, 1, thickness))
    box.apply_translation((0.0012, 0.0034, 0.0056))  # no node of a lattice lies in its middle
    box = trimesh.util.concatenate([box, *more])
    matrix = trimesh.transformations.euler_matrix(0.3, 0.2, 0.1)[:3, :3]
    vertices = np.array(box.vertices) @ matrix
    frame = Frame.of_bounds(vertices.min(axis=0), vertices.max(axis=0))
    made = artifact("mesh", {"vertices": vertices, "faces": np.array(box.faces)},
                    {**frame.attributes(), "shape": None})  # fmt: skip
    body = Body.open(made)
    field = ExactField("exact", body)
    safe = clearance(lambda points: field.query(points)[::2], body.distance)
    path.write_bytes(native_bytes(field, {}, safe=safe))
    box.vertices = vertices
    return box


def test_a_plate_that_mujoco_makes_no_whole_mesh_of(tmp_path, capfd):
    """It says so, or refuses it where there is no mesh at all, and takes a mesh from a file."""
    path, file = tmp_path / "plate.pandis", tmp_path / "plate.obj"
    whole = plate(0.05, path)
    mujoco.MjData(model_of(path))
    assert "ends elsewhere" not in capfd.readouterr().err
    whole = plate(1e-4, path)
    mujoco.MjData(model_of(path))
    assert "mesh b ends elsewhere than the field" in capfd.readouterr().err
    whole.export(file)
    mesh = f'<mesh name="b" file="{file}" scale="0.25 0.25 0.25" inertia="shell"/>'
    mujoco.MjData(model_of(path, mesh))
    assert "ends elsewhere" not in capfd.readouterr().err
    mujoco.MjData(model_of(path, mesh, scale=0.3))
    assert "its scale is another one" in capfd.readouterr().err
    beside = trimesh.creation.box((1e-8, 1e-8, 1e-8))
    beside.apply_translation((0.3, 0.2, 0.37))
    plate(1e-8, path, [beside])
    with pytest.raises(ValueError, match="at least 4 vertices required"):
        model_of(path)


@pytest.mark.parametrize("mesh", [FROM_FIELD, "file"])
@pytest.mark.parametrize(
    ("name", "scale", "said"),
    [
        ("nowhere", 1, "it cannot be read"),
        ("damaged", 1, "damaged"),
        ("text", 1, "this is not a .pandis file"),
        ("nearest", 1, "a grid of forces, which has no distances outside"),
        ("", 1, "no file is named"),
        ("exact", -1, "scale is not a positive number"),
        ("exact", "large", "scale is not a positive number"),
        ("exact", "nan", "scale is not a positive number"),
    ],
)
def test_what_is_wrong_is_said(files, meshes, tmp_path, mesh, name, scale, said):
    """And nothing crashes: neither without a mesh nor with one."""
    path = files.get(name) or (tmp_path / name if name else "")
    if name == "damaged":
        data = bytearray(files["exact"].read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(data)
    if name == "text":
        path.write_text("no field")
    if mesh == "file":
        mesh = f'<mesh name="b" file="{obj_of(meshes["exact"], tmp_path / "b.obj")}"/>'
    with pytest.raises(ValueError, match=f"plugin->init failed(.|\\n)*pandis.sdf: .*{said}"):
        model_of(path, mesh, scale=scale)


def test_geoms_of_one_instance_have_one_mesh(files, meshes, tmp_path):
    path = obj_of(meshes["exact"], tmp_path / "b.obj")
    more = f'<mesh name="c" file="{path}"/>'
    other = '<geom type="sdf" mesh="c"><plugin instance="b"/></geom>'
    with pytest.raises(ValueError, match="give each mesh an instance of its own"):
        model_of(files["exact"], more=more, world=other)
    same = '<geom type="sdf" mesh="b" pos="1 0 0"><plugin instance="b"/></geom>'
    assert model_of(files["exact"], world=same).ngeom == 2


def test_a_file_that_was_written_anew_is_read_anew(files, tmp_path):
    path = tmp_path / "field.pandis"
    found = []
    for name in ("exact", "torus", "exact"):
        shutil.copy(files[name], path)
        found.append(answers(model_of(path), np.array([[0.9, -0.5, 0.1]]))[0][0])
    assert found[0] == found[2] != found[1]


def test_another_version_of_mujoco_is_refused(monkeypatch):
    monkeypatch.setattr(mujoco, "mj_versionString", lambda: "3.17.0")
    plugin.register.cache_clear()
    with pytest.raises(PandisError, match="MuJoCo 4.0.0 and 4.0.1 in float64, not 3.17.0"):
        plugin.register()
    monkeypatch.undo()
    plugin.register()


C_PROGRAM = """
#include <mujoco/mujoco.h>
#include <stdio.h>
int main(int count, char **given) {
    (void)count;
    char error[500] = "";
    mj_loadPluginLibrary(given[1]);
    mjModel *m = mj_loadXML(given[2], NULL, error, sizeof error);
    if (!m) return printf("%s", error), 1;
    mjData *d = mj_makeData(m);
    for (int i = 0; i < 300; i++) mj_step(m, d);
    for (int i = 0; i < 7; i++) printf("%.17g ", d->qpos[i]);
    mj_deleteData(d), mj_deleteModel(m);
    return 0;
}
"""


def test_a_program_in_c_loads_it(files, tmp_path):
    source, program, text = (tmp_path / name for name in ("main.c", "main", "model.xml"))
    source.write_text(C_PROGRAM)
    text.write_text(xml_of(files["compact"], scale=0.05, world=BALL.format(at="0.3 -0.2 0.25")))
    core = next(plugin.package().glob("libmujoco*"))
    subprocess.run([find_compiler(), f"-I{plugin.package() / 'include'}", source, core,
                    f"-Wl,-rpath,{core.parent}", "-o", program], check=True)  # fmt: skip
    done = subprocess.run([program, plugin.library(), text], capture_output=True, text=True,
                          check=False, cwd=tmp_path)  # fmt: skip
    assert not done.returncode, done.stdout
    model = mujoco.MjModel.from_xml_path(str(text))
    data = mujoco.MjData(model)
    for _ in range(300):
        mujoco.mj_step(model, data)
    assert done.stdout.split() == [f"{value:.17g}" for value in data.qpos]


def scene_of(files, tmp_path):
    turned = trimesh.transformations.euler_matrix(0.3, -0.4, 0.5)[:3, :3]
    folder = tmp_path / "results/mesh/export"
    folder.mkdir(parents=True)
    for name in ("exact", "compact", "sphere"):
        shutil.copy(files[name], folder / f"{name}.pandis")
    (tmp_path / "results/ball").mkdir()
    shutil.copy(files["sphere"], tmp_path / "results/ball/exact.pandis")
    (tmp_path / "elsewhere").mkdir()
    shutil.copy(files["spline"], tmp_path / "elsewhere/spline.pandis")
    objects = {
        "left": ("results/mesh/export/exact.pandis", (0, 0, 0), np.eye(3), 0.1),
        "right": ("results/mesh/export/compact.pandis", (0.2, 0, 0), turned, 0.1),
        "again": ("results/mesh/export/exact.pandis", (0, 0.2, 0), turned, 0.1),
        "spline": ("elsewhere/spline.pandis", (0, 0, 0.2), turned.T, 0.07),
        "ball": ("results/ball/exact.pandis", (0, 0, 0.4), np.eye(3), 0.1),
    }
    records = []
    for name, (file, position, rotation, size) in objects.items():
        placed = Placed.at(
            NativeField(tmp_path / file), size, 400.0, position=position, rotation=rotation
        )
        sticking = 0.4 if name == "left" else 0.0
        records.append({"name": name, "file": file, "rotation_matrix": placed.rotation.tolist(),
                        "translation": placed.translation.tolist(), "scale": placed.scale,
                        "stiffness": 400.0,
                        "materials": {"the surface": {"sticking": sticking}}})  # fmt: skip
    path = tmp_path / "results/scenes/table.json"
    path.parent.mkdir()
    path.write_text(json.dumps({"objects": records}))
    return path, records


def test_a_scene_is_written_as_a_model(files, tmp_path, capfd):
    """Objects lie where the scene has them: a ball that is pressed in meets the field's surface."""
    scene, records = scene_of(files, tmp_path)
    assert main(["mjcf", str(scene), "table.xml"]) == 0
    model = mujoco.MjModel.from_xml_path("table.xml")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert "ends elsewhere" not in capfd.readouterr().err
    assert [model.body(i + 1).name for i in range(5)] == [each["name"] for each in records]
    assert sorted(path.name for path in tmp_path.glob("*.obj")) == ["table-0.obj"]
    assert model.geom("left").friction[0] == 0.4
    assert model.geom("right").friction[0] == 0
    for each in records:
        geom = model.geom(each["name"]).id
        field = NativeField(tmp_path / each["file"])
        mesh = model.geom_dataid[geom]
        turn = data.geom_xmat[geom].reshape(3, 3)
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        drawn = model.mesh_vert[first : first + count] @ turn.T + data.geom_xpos[geom]
        back = (drawn - each["translation"]) @ np.array(each["rotation_matrix"]) / each["scale"]
        off = np.abs(field.query(back).distance) * each["scale"]
        assert off.max() < 2e-3 * 0.1, each["name"]


def test_a_scene_takes_meshes_and_says_what_is_wrong(files, meshes, tmp_path, capsys):
    scene, _ = scene_of(files, tmp_path)
    mesh = obj_of(meshes["exact"], tmp_path / "mine.obj")
    objects = {"torus": Placed.at(NativeField(files["spline"]), 0.1, 400.0)}
    mjcf.write_mjcf(objects, "one.xml", {"torus": mesh})
    assert "mine.obj" in Path("one.xml").read_text()
    assert mujoco.MjModel.from_xml_path("one.xml").ngeom == 1
    with pytest.raises(PandisError, match="no object is named ring; the objects are torus"):
        mjcf.write_mjcf(objects, "one.xml", {"ring": mesh})
    scene.write_text("{}")
    assert main(["mjcf", str(scene), "table.xml"]) == 3
    assert "not a scene from results/scenes" in capsys.readouterr().err
    assert main(["mjcf", "nowhere.json", "table.xml"]) == 3
    assert "nowhere.json: it cannot be read" in capsys.readouterr().err


def test_the_program_of_the_page_runs(files, tmp_path):
    """As it stands; its ball falls onto the object."""
    page = (ROOT / "docs/simulators.md").read_text(encoding="utf-8")
    program = re.search(r"```python\n(.*?)```", page, re.S).group(1)
    path = tmp_path / "results/bunny/export/compact-auto.pandis"
    path.parent.mkdir(parents=True)
    shutil.copy(files["compact"], path)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True,
                          check=False, env=os.environ | {"PYTHONPATH": str(ROOT / "workflow")},
                          cwd=tmp_path)  # fmt: skip
    assert not done.returncode, done.stderr
    assert done.stdout.startswith("[")
