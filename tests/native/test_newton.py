"""Files for Newton's cache: found by it, read as it reads, and nearer to the field than its own."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from pandis.base.errors import PandisError
from pandis.base.forces import penalty_force
from pandis.bridges import newton as cooking
from pandis.bridges.newton import cook, hashed
from pandis.bridges.newton.cache import keep
from pandis.bridges.newton.cells import CELLS, EMPTY, LINEAR
from pandis.bridges.newton.reading import sample
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.runtime.field import NativeField
from pandis.runtime.samples import sample as closed_form
from pandis.runtime.samples import sample_bytes
from support import ROOT

#: What Newton may be asked, each another file.
ASKED = (
    {},
    {"max_resolution": 24},
    {"max_resolution": None, "target_voxel_size": 0.01},
    {"margin": 0.02, "narrow_band_range": (-0.02, 0.03), "texture_format": "uint8"},
    {"scale": (2.0, 2.0, 2.0), "sign_method": "winding", "texture_format": "float32"},
)


def mesh_of(shape, *sizes):
    """Return a closed form in metres, and the mesh that stands for it in Newton."""
    field = closed_form(shape, *sizes)
    vertices, faces = SHAPES[shape].tessellation()
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    unit = (vertices - (low + high) / 2) * (1.8 / (high - low).max())
    vertices = field.frame.to_mesh(unit).astype(np.float32)
    return field, SimpleNamespace(
        vertices=vertices, indices=faces.astype(np.int32).ravel(), is_solid=True, is_watertight=True
    )


def cooked(tmp_path, shape="torus", sizes=(0.1, 0.04), **asked):
    field, mesh = mesh_of(shape, *sizes)
    return field, dict(np.load(cook(field, mesh, tmp_path, **asked)))


@pytest.mark.parametrize("asked", ASKED)
def test_newton_finds_the_file_and_takes_it(asked, tmp_path):
    """By the name that it makes itself, and by its own check of what is in it."""
    newton = pytest.importorskip("newton", reason="no Newton here: pip install newton==1.8.0")
    from newton._src.geometry import _sdf_cache

    field, mesh = mesh_of("torus", 0.1, 0.04)
    path = cook(field, mesh, tmp_path, **asked)
    theirs = newton.Mesh(mesh.vertices, mesh.indices, compute_inertia=False)
    told = {
        "narrow_band_range": (-0.1, 0.1),
        "target_voxel_size": None,
        "max_resolution": 64,
        "margin": 0.05,
        "texture_format": "uint16",
        "sign_method": "auto",
        "scale": None,
    } | asked
    method = told.pop("sign_method")
    name = _sdf_cache.hash_inputs(
        vertices=theirs.vertices * np.array(told["scale"] or (1, 1, 1), np.float32),
        indices=theirs.indices,
        is_solid=theirs.is_solid,
        sign_method_resolved="parity" if method == "auto" else method,
        winding_threshold=0.5,
        **told,
    )
    assert theirs.is_watertight
    assert path == _sdf_cache.cache_path(tmp_path, name)
    assert _sdf_cache.try_load_sparse_data(tmp_path, name)["num_subgrids"] > 0


@pytest.mark.parametrize("texture_format", cooking.FORMATS)
def test_nodes_hold_the_distance(texture_format, tmp_path):
    """To half a step of what they are stored in; blocks next to each other agree on theirs."""
    field, held = cooked(tmp_path, texture_format=texture_format, max_resolution=40, fitted=False)
    slots, step = held["subgrid_start_slots"], held["cell_size"]
    near = np.argwhere(slots < LINEAR)
    assert len(near) > 50
    nodes = CELLS * near[:, None] + np.random.default_rng(1).integers(0, 9, (len(near), 40, 3))
    points = held["min_extents"] + nodes.reshape(-1, 3) * step
    distance, _ = sample(held, points)
    kept = {"uint8": 255, "uint16": 65535, "float32": 1 << 23}[texture_format]
    close = 0.51 * held["subgrids_sdf_value_range"] / kept + 1e-7
    assert np.abs(distance - field.query(points).distance).max() <= close


def test_beyond_the_band_the_coarse_grid_answers(tmp_path):
    field, held = cooked(tmp_path, narrow_band_range=(-0.001, 0.001), max_resolution=64)
    slots = held["subgrid_start_slots"]
    assert (slots == EMPTY).sum() > 100
    rng = np.random.default_rng(3)
    points = rng.uniform(held["min_extents"], held["max_extents"], (20_000, 3))
    distance, _ = sample(held, points)
    wanted = field.query(points).distance
    assert np.abs(distance - wanted).max() < 0.03
    assert ((distance < 0) == (wanted < 0)).mean() > 0.999
    points = points[np.abs(points[:, 0]) > 0.1] * (3, 1, 1)
    _, gradient = sample(held, points)
    outside = np.abs(points[:, 0]) > held["max_extents"][0]
    assert outside.sum() > 1000
    assert np.linalg.norm(gradient[outside], axis=1) == pytest.approx(1, abs=1e-12)


def test_flat_walls_are_left_to_the_coarse_grid(tmp_path):
    """Blocks that it is exact for take no room, and are not empty."""
    field, held = cooked(tmp_path, "box", (), max_resolution=64, narrow_band_range=(-1, 1))
    assert (held["subgrid_start_slots"] == LINEAR).sum() > 10
    rng = np.random.default_rng(3)
    points = rng.uniform(held["min_extents"], held["max_extents"], (5000, 3))
    distance, _ = sample(held, points)
    assert np.abs(distance - field.query(points).distance).max() < held["cell_size"].max()


def force_errors(held, field):
    """Return errors of forces at points down to a tenth of the smallest radius."""
    rng = np.random.default_rng(8)
    points = field.frame.to_mesh(rng.uniform(-1, 1, (400_000, 3)))
    wanted = field.query(points)
    low = wanted.distance.min()
    inside = (wanted.distance < 0) & (wanted.distance > 0.4 * low)
    exact = penalty_force(wanted.distance[inside], wanted.normal[inside])
    distance, gradient = sample(held, points[inside])
    normal = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
    return np.linalg.norm(penalty_force(distance, normal) - exact, axis=1), exact


@pytest.mark.parametrize(
    ("shape", "sizes", "share"), [("torus", (0.1, 0.04), 0.85), ("capsule", (), 0.95)]
)
def test_fitted_nodes_err_less_everywhere(shape, sizes, share, tmp_path):
    """In the mean and in the worst place, and by far less than a field without any force."""
    field, plain = cooked(tmp_path, shape, sizes, fitted=False, max_resolution=40)
    _, fitted = cooked(tmp_path, shape, sizes, max_resolution=40)
    assert np.array_equal(plain["subgrid_start_slots"], fitted["subgrid_start_slots"])
    before, exact = force_errors(plain, field)
    after, _ = force_errors(fitted, field)
    assert after.mean() < share * before.mean()
    assert np.percentile(after, 99) < before.max()
    assert after.max() < 0.2 * np.linalg.norm(exact, axis=1).max()


def test_units_are_those_that_are_said(tmp_path):
    """A mesh in millimetres, whose field is in metres; a scale that Newton bakes in."""
    field, mesh = mesh_of("torus", 0.1, 0.04)
    plain = dict(np.load(cook(field, mesh, tmp_path, margin=0.05)))
    mesh.vertices = mesh.vertices * np.float32(2)
    doubled = dict(np.load(cook(field, mesh, tmp_path, length=2.0, margin=0.1,
                                narrow_band_range=(-0.2, 0.2))))  # fmt: skip
    assert doubled["coarse_sdf"] == pytest.approx(2 * plain["coarse_sdf"], abs=1e-6)
    with pytest.raises(PandisError, match="is `length` in metres per unit of the field"):
        cook(field, mesh, tmp_path)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (
            {"texture_format": "uint32"},
            "texture_format: 'uint32' is none of uint8, uint16, float32",
        ),
        ({"scale": (1, 1, 2)}, "a field cannot be stretched"),
        ({"max_resolution": 0}, "max_resolution: 0 is no"),
        ({"max_resolution": None, "target_voxel_size": -1.0}, "target_voxel_size: -1.0 is no"),
    ],
)
def test_what_cannot_be_cooked_is_said(asked, said, tmp_path):
    field, mesh = mesh_of("torus", 0.1, 0.04)
    with pytest.raises(PandisError, match=said):
        cook(field, mesh, tmp_path, **asked)
    assert not list(tmp_path.iterdir())


def test_another_mesh_has_another_name():
    _, mesh = mesh_of("torus", 0.1, 0.04)
    first = hashed(mesh, mesh.vertices, {})
    mesh.vertices[0, 0] += 1e-6
    assert hashed(mesh, mesh.vertices, {}) != first


@pytest.mark.full
def test_newtons_own_bake_has_the_same_blocks(tmp_path):
    """And the same distances, where nodes are not fitted: it runs on Warp's CPU backend."""
    wp = pytest.importorskip("warp", reason="no Warp here: pip install warp-lang")
    pytest.importorskip("newton", reason="no Newton here: pip install newton==1.8.0")
    from newton._src.geometry import sdf_texture

    field, mesh = mesh_of("torus", 0.1, 0.04)
    held = dict(np.load(cook(field, mesh, tmp_path, fitted=False, texture_format="float32")))
    made = {}

    def instead(data, *_):
        made.update(data)
        return SimpleNamespace(), None, None

    with pytest.MonkeyPatch.context() as patch, wp.ScopedDevice("cpu"):
        patch.setattr(sdf_texture, "create_sparse_sdf_textures", instead)
        points = wp.array(mesh.vertices, dtype=wp.vec3), wp.array(mesh.indices, dtype=wp.int32)
        sdf_texture.create_texture_sdf_from_mesh(
            wp.Mesh(*points), max_resolution=64, sign_mode=sdf_texture.SIGN_MODE_PARITY,
            quantization_mode=sdf_texture.QuantizationMode.FLOAT32, device="cpu",
        )  # fmt: skip
    faceted = 1e-4  # the mesh stands for a round torus
    assert held["coarse_sdf"] == pytest.approx(made["coarse_sdf"], abs=faceted)
    assert (held["subgrid_required"] != made["subgrid_required"]).mean() < 0.01
    for name in ("min_extents", "max_extents", "cell_size"):
        assert held[name] == pytest.approx(made[name], rel=1e-6)
    points = np.random.default_rng(2).uniform(-0.15, 0.15, (5000, 3))
    theirs = {name: np.asarray(value) for name, value in made.items()}
    ours, others = sample(held, points), sample(theirs, points)
    assert ours[0] == pytest.approx(others[0], abs=2 * faceted)


@pytest.mark.slow
def test_the_program_of_the_page_runs(tmp_path, monkeypatch):
    """Up to where Newton reads the file, which it does on a GPU alone."""
    newton = pytest.importorskip("newton", reason="no Newton here: pip install newton==1.8.0")
    wp = pytest.importorskip("warp", reason="no Warp here: pip install warp-lang")
    page = (ROOT / "docs/simulators.md").read_text(encoding="utf-8")
    text, kept = re.findall("```python\n(import newton.*?)```", page, re.S)
    _, mesh = mesh_of("torus", 1.0, 0.4)
    path = tmp_path / "field.pandis"
    path.write_bytes(sample_bytes("torus", 1.0, 0.4))
    text = text.replace("results/bunny/export/compact-auto.pandis", str(path))
    monkeypatch.chdir(tmp_path)
    there = {"vertices": 0.1 * mesh.vertices, "indices": mesh.indices}
    options = {"max_resolution": 40, "sign_method": "winding"}
    whole = keep(
        NativeField(path),
        (mesh.vertices, mesh.indices.reshape(-1, 3)),
        0.1,
        options=options,
        provenance={},
    )
    (tmp_path / "newton.npz").write_bytes(whole.packed())
    kept = kept.replace("results/bunny/export/newton.npz", "newton.npz")
    for number, program in enumerate((text, kept)):
        if wp.is_cuda_available():
            exec(program, there)
            assert isinstance(there["mesh"].sdf, newton.SDF)
        else:
            with pytest.raises(RuntimeError, match="CUDA"):
                exec(program, there)
        assert len(list((tmp_path / "cache").glob("*.sdf.npz"))) == number + 1


def test_a_grid_of_forces_is_refused(files, tmp_path):
    _, mesh = mesh_of("torus", 0.1, 0.04)
    with pytest.raises(PandisError, match="a grid of forces"):
        cook(NativeField(files["nearest"]), mesh, tmp_path)
