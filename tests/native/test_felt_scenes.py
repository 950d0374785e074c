"""What objects of a scene feel like: materials and textures by region, asked of a mesh beside."""

import shutil

import numpy as np
import pytest
from test_regions import exported, file_of, mesh  # noqa: F401
from test_scenes import both_forces, compiled
from test_textures import heights

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.judge.scenes import try_scene
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.kinds.native import export_native
from pandis.pipeline.run.ask.contacts import SurfaceOptions, TextureOptions
from pandis.pipeline.run.ask.options import NativeOptions
from pandis.pipeline.run.ask.tasks import SceneTask
from pandis.pipeline.run.job.stage import silent_progress
from pandis.runtime.contact import NativeContact
from pandis.runtime.contact.surfaces import Texture, materials_for, texture_for, textures_for
from pandis.runtime.field import NativeField
from pandis.runtime.scene import Placed

#: Takes long: `make test-slow`.
pytestmark = pytest.mark.slow

GRAIN = {"kind": "noise", "height": 1e-3, "length": 5e-3}
ROUGH = {"sticking": 0.9, "texture": GRAIN}
NAMES = "rubber", "steel"


def plain(shape):
    """Return the file of a mesh that has lost its regions."""
    body = Body.open(shape)
    bare = Body(body.vertices, body.faces, body.frame)
    return export_native(
        ExactField("exact", bare), bare, NativeOptions(), provenance={}, log=lambda text: None
    )


def test_every_region_has_its_own_texture_and_one_beyond_them_the_first():
    waves, noise = Texture.waves(0.2, 2.0, (1, 0, 0)), Texture.noise(0.3, 1.5)
    points = np.random.default_rng(0).uniform(-5, 5, (40, 3))
    made = Texture.by_region([waves, None, noise])
    assert (made.most, made.steepest) == (0.3, max(waves.steepest, noise.steepest))
    for region, part in ((-1, waves), (0, waves), (2, noise), (3, waves)):
        for got, own in zip(heights(made, points, region), heights(part, points), strict=True):
            assert np.array_equal(got, own)
    for got in heights(made, points, 1):
        assert not got.any()


@pytest.mark.parametrize(
    ("asked", "kinds"),
    [
        ({}, []),
        ({"texture": GRAIN}, ["noise", "noise"]),
        ({"materials": {"rubber": {"texture": GRAIN}}}, ["noise", None]),
        ({"texture": GRAIN, "materials": {"steel": {"texture": {"kind": "smooth"}}}},
         ["noise", None]),
        ({"texture": GRAIN, "materials": {"steel": {"texture": {"kind": "waves"}}}},
         ["noise", "waves"]),
        ({"texture": {"kind": "smooth"}}, []),
    ],
)  # fmt: skip
def test_a_material_has_its_own_texture_or_that_of_the_whole(asked, kinds):
    textures = textures_for(SurfaceOptions.model_validate(asked), NAMES)
    assert [texture and texture.kind for texture in textures.values()] == kinds
    assert (texture_for(textures, 0.01) is None) == (not kinds)


@pytest.mark.parametrize("mesh", ["balls.glb"], indirect=True)
def test_a_texture_is_felt_where_its_region_is(mesh):  # noqa: F811
    """On rubber alone: on steel the force is that without it, wherever it has come to rest."""
    field = exported(mesh, "exact")
    asked = SurfaceOptions(materials={"rubber": {"texture": GRAIN}})
    texture = texture_for(textures_for(asked, field.region_names), 0.05)
    placed = Placed(field, np.eye(3), np.zeros(3), 1.0, 100.0)
    for side, same in ((-1, False), (1, True)):
        along = np.linspace(0.8, 0.9, 200) * side
        path = [(0.8 * side, 0, 1.2), *((x, 0, 0.9) for x in along)]
        felt, smooth = (NativeContact(placed, texture=t).follow(path) for t in (texture, None))
        differs = np.median(np.linalg.norm(felt.force - smooth.force, axis=1))
        assert (differs < 1e-6) if same else (differs > 0.01)
        assert felt.force.any()


@pytest.fixture
def tried(mesh, tmp_path):  # noqa: F811
    """Return the attributes and arrays of a scene of one object that has no regions, and so on."""

    def attempt(contact, beside):
        folder = tmp_path / "balls" / "export"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "plain.pandis").write_bytes(plain(mesh))
        (folder / "exact.pandis").write_bytes(file_of(mesh, "exact"))
        placed = {"name": "balls", "mesh": "balls", "field": "plain", "position": (0, 0, 0),
                  "rotation": (0, 0, 0), "size": 0.1, "stiffness": 400.0,
                  "contact": contact, "beside": beside}  # fmt: skip
        options = SceneTask(objects=[placed], ticks=4000, speed=0.2, radius=1e-3)
        files = [folder / "plain.pandis", folder / "exact.pandis"]
        return try_scene("my-table", files, options, progress=silent_progress, log=print)[:2]

    return attempt


@pytest.mark.full
@pytest.mark.parametrize("mesh", ["balls.glb"], indirect=True)
@pytest.mark.skipif(not shutil.which("gcc"), reason="no gcc here")
def test_an_object_without_regions_asks_the_mesh_beside_it(tried, tmp_path):
    """Its header gives a C program the same forces, friction and textures by region included."""
    contact = {"materials": {"rubber": ROUGH, "steel": {"texture": {"kind": "waves"}}}}
    arrays, attributes = tried(contact, "exact")
    (record,) = attributes["objects"]
    assert tuple(record["materials"]) == tuple(record["textures"]) == NAMES
    assert attributes["proxies"]["different"] == 0
    assert attributes["proxies"]["touched_share"] > 0.1
    assert compiled(tmp_path, attributes["header"], arrays["points"]) == both_forces(arrays)
    others, without = tried(contact, None)
    assert tuple(without["objects"][0]["materials"]) == ("the surface",)
    assert not np.array_equal(arrays["proxy_force"], others["proxy_force"])
    assert np.array_equal(arrays["force"], others["force"])
    assert "pandis_by_region" not in without["header"]
    whole, one = tried({"texture": GRAIN}, None)
    assert "static const pandis_texture my_table_texture_0 = {pandis_noise" in one["header"]
    assert compiled(tmp_path, one["header"], whole["points"]) == both_forces(whole)


@pytest.mark.parametrize("mesh", ["balls.glb"], indirect=True)
def test_a_material_that_nothing_is_made_of_is_told(tried, capsys):
    tried({"materials": {"rubber": ROUGH, "fur": ROUGH}}, "exact")
    lines = [line for line in capsys.readouterr().out.splitlines() if "contact.materials" in line]
    assert lines == ["contact.materials.fur: no object of the scene is made of it: they name "
                     + ", ".join(sorted(NAMES))]  # fmt: skip
    tried({"materials": {"rubber": ROUGH}}, None)
    assert "contact.materials.rubber: no object" in capsys.readouterr().out


def test_a_texture_too_steep_to_follow_is_refused():
    with pytest.raises(ValueError, match="height must be at most length / 5"):
        TextureOptions(height=1e-3, length=4e-3)


def test_a_material_that_no_region_has_changes_nothing():
    asked = SurfaceOptions(sticking=0.3, materials={"fur": {"sticking": 0.9, "texture": GRAIN}})
    assert materials_for(asked, NAMES)["steel"]["sticking"] == 0.3
    assert textures_for(asked, NAMES) == {}


@pytest.mark.parametrize("mesh", ["balls.glb"], indirect=True)
def test_a_file_of_the_fixture_is_whole(mesh):  # noqa: F811
    """What stands in for a field without regions has none, and the one beside it has two."""
    assert NativeField(plain(mesh)).region_names == ()
    assert exported(mesh, "exact").region_names == NAMES
