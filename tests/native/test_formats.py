"""Files for other programs: what is wrong in one place is refused, and what is whole is read."""

import numpy as np
import pytest

from pandis.base.errors import ArtifactError, PandisError
from pandis.bridges import mujoco as mujoco_plugin
from pandis.bridges.newton import cache
from pandis.bridges.vdb.reading import read_vdb
from pandis.pipeline.export import mjcf, newton, volumes
from pandis.pipeline.export.drawn import export_mesh
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.report.seal import SEALED, read_seal, seal
from pandis.pipeline.run.job.artifact import check_seal
from pandis.pipeline.run.job.stage import silent_progress
from pandis.runtime.field import NativeField

SIZE = 0.1


def said():
    lines = []
    return lines, lines.append


@pytest.fixture
def body(meshes):
    return Body.open(meshes["exact"])


@pytest.fixture
def cooked(body, monkeypatch):
    """Return what makes a file for Newton, of few voxels, with or without a fault in it."""
    monkeypatch.setattr(newton, "_RESOLUTION", 40)
    keep = cache.keep

    def made(fault=lambda held: None):
        def keep_with_fault(*asked, **options):
            whole = keep(*asked, **options)
            fault(whole.content)
            return whole

        monkeypatch.setattr(newton, "keep", keep_with_fault)
        lines, log = said()
        return newton.export_newton(
            body, SIZE, {"stage": "a"}, log=log, progress=silent_progress
        ), lines

    return made


@pytest.mark.slow
def test_a_file_for_newton_holds_mesh_options_and_provenance(cooked, body, tmp_path):
    """Newton finds the distances by the name that it makes of the mesh that is in the file."""
    data, lines = cooked()
    assert "µm on average" in lines[0]
    path = tmp_path / "newton.npz"
    path.write_bytes(data)
    check_seal(path)
    read = cache.unpack(path, tmp_path / "cache")
    assert read.provenance == {"stage": "a"}
    assert np.ptp(read.vertices, axis=0).max() == pytest.approx(SIZE)
    assert np.array_equal(read.indices.reshape(-1, 3), body.faces)
    (held,) = (tmp_path / "cache").iterdir()
    assert held.name == f"{read.name}.sdf.npz"
    again, _ = cooked()
    assert again == data
    theirs = pytest.importorskip("newton", reason="no Newton here: pip install newton==1.8.0")
    from newton._src.geometry import _sdf_cache

    mesh = theirs.Mesh(read.vertices, read.indices, compute_inertia=False)
    asked = dict(read.options)
    name = _sdf_cache.hash_inputs(
        vertices=mesh.vertices,
        indices=mesh.indices,
        is_solid=mesh.is_solid,
        sign_method_resolved=asked.pop("sign_method"),
        winding_threshold=0.5,
        target_voxel_size=None,
        scale=None,
        **asked,
    )
    assert _sdf_cache.try_load_sparse_data(tmp_path / "cache", name)["num_subgrids"] > 0


def one_block(held):
    """Make a single block of voxels say that it lies far outside."""
    side = int(held["subgrid_size"]) + 1
    held["subgrid_data"][:side, :side, :side] = 65535


def everywhere_zero(held):
    held["subgrids_min_sdf_value"] = held["subgrids_sdf_value_range"] = np.float32(0)
    held["coarse_sdf"][:] = 0


def turned(held):
    held["subgrid_data"] = np.ascontiguousarray(held["subgrid_data"].transpose(2, 1, 0))


def shifted(held):
    """Move everything by one voxel."""
    for name in ("min_extents", "max_extents"):
        held[name] = held[name] + held["cell_size"] * (1, 0, 0)


def smaller(held):
    """Make all distances near the surface a tenth too small."""
    for name in ("subgrids_min_sdf_value", "subgrids_sdf_value_range"):
        held[name] = np.float32(0.9 * held[name])


@pytest.mark.parametrize("fault", [one_block, everywhere_zero, turned, shifted, smaller])
def test_distances_that_newton_would_have_wrong_are_refused(fault, cooked):
    with pytest.raises(PandisError, match="interpolated distances are off"):
        cooked(fault)


def test_what_is_no_file_for_newton_is_said(tmp_path):
    path = tmp_path / "newton.npz"
    for content in (b"", b"no zip"):
        path.write_bytes(content)
        with pytest.raises(ArtifactError, match="not a Newton file that the workflow wrote"):
            cache.unpack(path, tmp_path / "cache")
    np.savez(path, vertices=np.zeros(3))
    with pytest.raises(ArtifactError, match="not a Newton file that the workflow wrote"):
        cache.unpack(path, tmp_path / "cache")
    assert not (tmp_path / "cache").exists()


@pytest.mark.slow
def test_a_volume_has_a_grid_for_each_field(files):
    lines, log = said()
    paths = [files[name] for name in ("exact", "nearest", "spline", "tricubic")]
    read = read_vdb(volumes.export_volumes(paths, log))
    assert list(read) == ["exact", "spline", "tricubic"]
    assert any("nearest: left out: a grid of forces" in line for line in lines)
    for name, grid in read.items():
        points = grid.origins * grid.voxel
        wanted = NativeField(files[name]).query(points).distance
        assert grid.values[:, 0, 0, 0] == pytest.approx(
            np.clip(wanted, -grid.background, grid.background), abs=1e-6
        )
    with pytest.raises(PandisError, match="add another field"):
        volumes.export_volumes([files["nearest"]], log)


@pytest.mark.slow
def test_a_volume_whose_deep_inside_is_outside_is_refused(files, monkeypatch):
    """Where it holds no voxels, and only a side is said."""
    monkeypatch.setattr(volumes, "ALONG", 400)
    leaves = volumes.leaves

    def without_inside(*asked, **options):
        return leaves(*asked, **options)._replace(inside=lambda voxels: np.zeros(len(voxels), bool))

    monkeypatch.setattr(volumes, "leaves", without_inside)
    with pytest.raises(PandisError, match="disagrees with the field about inside"):
        volumes.export_volumes([files["exact"]], lambda text: None)


def test_what_is_too_thin_for_voxels_is_left_out(files, monkeypatch):
    monkeypatch.setattr(volumes, "ALONG", 0.1)
    lines, log = said()
    with pytest.raises(PandisError, match="remove vdb from export.also"):
        volumes.export_volumes([files["exact"], files["spline"]], log)
    assert sum("left out" in line for line in lines) == 2


@pytest.mark.parametrize("fault", ["value", "leaf"])
def test_a_volume_that_is_wrong_in_one_place_is_refused(fault, files, monkeypatch):
    leaves = volumes.leaves

    def wrong(*asked, **options):
        made = leaves(*asked, **options)
        if fault == "value":
            at = np.argwhere(made.active)[len(made.values)]
            made.values[tuple(at)] *= -1
            return made
        kept = np.arange(len(made.origins)) != len(made.origins) // 2
        return made._replace(origins=made.origins[kept], values=made.values[kept])

    monkeypatch.setattr(volumes, "leaves", wrong)
    with pytest.raises(PandisError, match="distances differ|omits part of the surface"):
        volumes.export_volumes([files["exact"]], lambda text: None)


def test_other_bytes_are_no_volume_of_ours(files):
    data = volumes.export_volumes([files["exact"]], lambda text: None)
    for wrong in (b"", data[:100], data[: len(data) // 2], b"\0" + data[1:]):
        with pytest.raises(PandisError, match="not a volume that pandis wrote"):
            read_vdb(wrong)


def model(files, body, folder):
    drawn = folder / "mesh.obj"
    drawn.write_bytes(seal(export_mesh(body), {}, ".obj"))
    lines, log = said()
    paths = [files[name] for name in ("exact", "nearest", "compact", "spline")]
    return mjcf.export_mjcf("torus", paths, drawn, size=SIZE, log=log), lines


def test_a_model_has_a_body_for_each_field(files, body, tmp_path, monkeypatch):
    """In a row, with the mesh of all; MuJoCo reads the sealed file, and warns of nothing."""
    mujoco = pytest.importorskip("mujoco", reason="no MuJoCo here: pip install mujoco==4.0.1")
    monkeypatch.chdir(tmp_path)
    text, lines = model(files, body, tmp_path)
    assert "nearest: left out" in lines[0]
    assert "match the library's" in lines[-1]
    path = tmp_path / "mujoco.xml"
    path.write_bytes(seal(text.encode(), {"of": "--"}, ".xml"))
    made = mujoco.MjModel.from_xml_path(str(path))
    assert [made.body(i).name for i in range(made.nbody)] == ["world", "exact", "compact", "spline"]
    data = mujoco.MjData(made)
    mujoco.mj_forward(made, data)
    assert np.diff(data.xipos[1:, 0]) == pytest.approx(1.5 * SIZE, abs=1e-3)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mesh.obj", "mujoco.xml"]


def test_a_model_without_mujoco_is_written_and_that_is_said(files, body, tmp_path, monkeypatch):
    monkeypatch.setattr(mujoco_plugin, "find_spec", lambda name: None)
    mujoco_plugin.register.cache_clear()
    text, lines = model(files, body, tmp_path)
    assert text.count("<body") == 3
    assert text.count("<mesh") == 1
    assert "not compared with MuJoCo: MuJoCo is not installed" in lines[-1]


def test_a_model_of_another_size_than_the_library_has_is_refused(
    files, body, tmp_path, monkeypatch
):
    pytest.importorskip("mujoco", reason="no MuJoCo here: pip install mujoco==4.0.1")
    write = mjcf.mjcf_text

    def wrong(*asked, **options):
        scale = repr(float(asked[1]["compact"].scale))
        head, mark, rest = write(*asked, **options).partition('<instance name="compact">')
        return head + mark + rest.replace(f'value="{scale}"', 'value="0.03"', 1)

    monkeypatch.setattr(mjcf, "mjcf_text", wrong)
    with pytest.raises(PandisError, match="compact: MuJoCo's distances differ"):
        model(files, body, tmp_path)


@pytest.mark.parametrize("ending", sorted(SEALED))
def test_a_seal_tells_every_change(ending, tmp_path):
    path, why = tmp_path / f"a{ending}", {"stage": "a -- b"}
    sealed = seal(b"a page\nof bytes", why, ending)
    path.write_bytes(sealed)
    assert read_seal(path) == why
    for at in range(len(sealed)):
        path.write_bytes(sealed[:at] + bytes([sealed[at] ^ 1]) + sealed[at + 1 :])
        try:
            assert read_seal(path) != why, at
        except ArtifactError:
            continue
    for wrong in (sealed[:-1], sealed + b" ", b"", sealed[:15]):
        path.write_bytes(wrong)
        with pytest.raises(ArtifactError):
            read_seal(path)
