"""Fields in Warp, on its CPU backend: the answers of pandis.h, and what kernels do with them."""

import re
import runpy

import numpy as np
import pytest
from test_header import points_for

from pandis.base.errors import PandisError
from pandis.runtime.field import NativeField
from support import ROOT

wp = pytest.importorskip("warp", reason="no Warp here: pip install warp-lang")

from pandis.bridges.warp import WarpField  # noqa: E402
from pandis.bridges.warp.data import ROOM  # noqa: E402

#: What Warp is given: networks of one output and of four; each of another width compiles anew.
KINDS = (
    *("spline", "compact", "gradient"),
    pytest.param("network", marks=pytest.mark.full),
    pytest.param("shallow", marks=pytest.mark.full),
)


@pytest.fixture(scope="module", autouse=True)
def _cpu():
    wp.config.quiet = True
    with wp.ScopedDevice("cpu"):
        yield


@pytest.mark.parametrize("name", KINDS)
def test_warp_answers_as_the_library_does(name, files):
    """Within 1e-6 of the unit frame; in the box, around it, far away, and where no place is."""
    native, field = NativeField(files[name]), WarpField(files[name])
    points = np.concatenate([
        points_for(native, 20_000),
        native.frame.to_mesh(np.random.default_rng(2).normal(0, 1e4, (100, 3))),
        [[np.nan, 0, 0], [0, np.inf, 0], [1e200, 0, 0]],
    ])  # fmt: skip
    wanted, slopes = native.query_slopes(points)
    distance, normal, flag = (out.numpy() for out in field.query(points))
    whole = wanted.flag != 3  # where pandis.h cuts a query
    assert np.array_equal(flag[whole], wanted.flag[whole])
    answered = whole & (wanted.flag != 2)
    assert answered.sum() > 20_000
    assert np.isnan(distance[wanted.flag == 2]).all()
    assert np.isnan(normal[wanted.flag == 2]).all()
    close = 1e-6 / native.frame.scale * np.maximum(1, np.abs(wanted.distance))
    assert (np.abs(distance - wanted.distance) <= close)[answered].all()
    # of the gradient, before it is made a unit vector: where it vanishes there is no direction
    off = (np.linalg.norm(normal - wanted.normal, axis=1) * slopes)[answered]
    assert off.max() < 1e-6 * max(1, slopes[answered].max())


def test_what_warp_is_not_given_is_refused(files):
    with pytest.raises(PandisError, match="splines, compact meshes and networks only"):
        WarpField(files["tricubic"])


def test_a_tree_that_is_too_deep_is_refused(files, monkeypatch):
    """Whose boxes would not fit into what a point has room for."""
    monkeypatch.setattr("pandis.bridges.warp.ROOM", 7)
    with pytest.raises(PandisError, match=r"room for \d+ boxes, and there is room for 7"):
        WarpField(files["compact"])
    assert ROOM > 7 * 30


@pytest.fixture
def simulator():
    """Return the adapter of MuJoCo Warp, with its plugin registered in MuJoCo."""
    pytest.importorskip("mujoco_warp", reason="no MuJoCo Warp here: pip install mujoco-warp")
    from pandis.bridges import mujoco as plugin
    from pandis.bridges.warp import mujoco as adapter

    plugin.register()
    return adapter


def ball_and_object(path, mesh, scale=0.25):
    from test_mujoco import model_of

    ball = '<body pos="0.3 -0.2 0.4"><freejoint/><geom size="0.03"/></body>'
    return model_of(path, mesh, scale=scale, world=ball)


@pytest.mark.parametrize(
    ("name", "mesh"), [pytest.param("spline", None, marks=pytest.mark.full), ("compact", "file")]
)
def test_mujoco_warp_gets_what_mujoco_gets(name, mesh, simulator, files, meshes, tmp_path):
    """At points of the geom's frame, whether MuJoCo has moved the mesh's origin or not."""
    from mujoco_warp._src import collision_sdf
    from mujoco_warp._src.types import vec_pluginattr
    from test_mujoco import FROM_FIELD, answers, obj_of

    from pandis.bridges.mujoco.instances import instances

    text = FROM_FIELD
    if mesh == "file":
        path = obj_of(meshes[name], tmp_path / "b.obj")
        text = f'<mesh name="b" file="{path}" scale="0.25 0.25 0.25"/>'
    model = ball_and_object(files[name], text)
    put = simulator.put_model(model, instances(model))
    user_sdf, user_sdf_grad = collision_sdf.user_sdf, collision_sdf.user_sdf_grad

    @wp.kernel(module="unique", enable_backward=False)
    def ask(
        attributes: wp.array(dtype=vec_pluginattr),
        points: wp.array(dtype=wp.vec3),
        distances: wp.array(dtype=float),
        gradients: wp.array(dtype=wp.vec3),
    ):
        i = wp.tid()
        distances[i] = user_sdf(points[i], attributes[0], 0)
        gradients[i] = user_sdf_grad(points[i], attributes[0], 0)

    points = np.random.default_rng(6).uniform(-0.3, 0.3, (500, 3)).astype(np.float32)
    out = wp.empty(500, dtype=float), wp.empty(500, dtype=wp.vec3)
    wp.launch(ask, 500, [put.plugin_attr, wp.array(points, dtype=wp.vec3)], list(out))
    distance, gradient = answers(model, points.astype(float))
    assert np.abs(distance).max() > 0.05
    assert out[0].numpy() == pytest.approx(distance, abs=1e-6)
    off = np.linalg.norm(out[1].numpy() - gradient, axis=1)
    assert np.percentile(off, 95) < 1e-4  # where it turns, single precision decides otherwise


@pytest.mark.full
@pytest.mark.parametrize("name", ["compact", "spline"])
def test_a_ball_comes_to_lie_where_it_does_in_mujoco(name, simulator, files):
    import mujoco
    import mujoco_warp
    from test_mujoco import FROM_FIELD

    from pandis.bridges.mujoco.instances import instances

    model = ball_and_object(files[name], FROM_FIELD)
    data = mujoco.MjData(model)
    put, state = (
        simulator.put_model(model, instances(model)),
        mujoco_warp.put_data(model, data, nconmax=64, njmax=256),
    )
    apart = []
    for _ in range(300):
        mujoco_warp.step(put, state)
        mujoco.mj_step(model, data)
        apart.append(np.linalg.norm(state.qpos.numpy()[0, :3] - data.qpos[:3]))
    assert max(apart[:100]) < 1e-4


def programs():
    """Return the programs of docs/simulators.md, in their order."""
    page = (ROOT / "docs/simulators.md").read_text(encoding="utf-8")
    return re.findall("```python\n(.*?)```", page, re.S)


def run(text, folder, **files):
    """Run a program of the page from a file, where Warp finds its kernels; fields are replaced."""
    for name, path in files.items():
        text = text.replace(f"results/bunny/export/{name.replace('_', '-')}.pandis", str(path))
    source = folder / "program.py"
    source.write_text(text)
    return runpy.run_path(str(source))


def test_the_program_of_the_page_runs(files, tmp_path, capsys):
    text = next(text for text in programs() if "bridges.warp import" in text)
    ran = run(text, tmp_path, spline_auto=files["spline"])
    assert "N" in capsys.readouterr().out
    assert np.isfinite(ran["forces"].numpy()).all()


@pytest.mark.full
def test_the_page_goes_on_in_mujoco_warp(simulator, files, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    first = next(text for text in programs() if "mujoco import register" in text)
    second = next(text for text in programs() if "warp.mujoco import" in text)
    ran = run(first + second, tmp_path, compact_auto=files["compact"])
    assert np.isfinite(ran["state"].qpos.numpy()).all()
