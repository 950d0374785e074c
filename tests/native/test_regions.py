"""Materials by region: named in the file, carried through repair, kept in files for pandis.h."""

import gzip
import zipfile

import igl
import numpy as np
import pytest
import trimesh
from test_header import resealed, section

from pandis.base.errors import ArtifactError, PandisError
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.compact.packing import build_compact
from pandis.pipeline.kinds.compact.reference import CompactField
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.kinds.native import export_native
from pandis.pipeline.mesh.build import build
from pandis.pipeline.mesh.regions import carry
from pandis.pipeline.run.ask.options import NativeOptions
from pandis.pipeline.run.ask.sourcing import SourceDigests, source_digest, source_files
from pandis.pipeline.run.ask.tasks import MeshTask
from pandis.runtime.contact import Material, NativeContact
from pandis.runtime.field import NativeField
from pandis.runtime.scene import Placed
from support import artifact

#: Takes long: `make test-slow`.
pytestmark = pytest.mark.slow

#: Two balls that overlap, each with a hole: what a repair cuts and fills.
BALLS = {"rubber": (-0.6, 0, 0), "steel": (0.6, 0, 0)}


def balls():
    """Return the balls by their materials, each without some faces far from the other."""
    parts = {}
    for name, centre in BALLS.items():
        ball = trimesh.creation.icosphere(3, 1.0)
        far = ball.triangles_center @ np.sign(centre)
        ball.update_faces(far < np.sort(far)[-7])
        ball.apply_translation(centre)
        parts[name] = ball
    return parts


def write_gltf(path):
    scene = trimesh.Scene()
    for name, ball in balls().items():
        look = trimesh.visual.material.PBRMaterial(name=name)
        ball.visual = trimesh.visual.TextureVisuals(material=look)
        turn = trimesh.transformations.rotation_matrix(0.3, [0, 0, 1])
        ball.apply_transform(np.linalg.inv(turn))
        scene.add_geometry(ball, transform=turn)
    path.write_bytes(scene.export(file_type="glb"))


def write_obj(path):
    lines, start = ["mtllib nowhere.mtl"], 1
    for name, ball in balls().items():
        lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in ball.vertices.tolist()]
        lines += [f"usemtl {name}"]
        lines += ["f " + " ".join(str(k + start) for k in face) for face in ball.faces]
        start += len(ball.vertices)
    path.write_bytes(gzip.compress("\n".join(lines).encode()))


def write_3mf(path):
    """Write a package in which one ball is an object and the other a component, moved."""
    objects = []
    for index, (name, ball) in enumerate(balls().items()):
        away = np.array(BALLS[name]) if index else np.zeros(3)
        vertices = "".join(f'<vertex x="{x!r}" y="{y!r}" z="{z!r}"/>'
                           for x, y, z in (ball.vertices - away).tolist())  # fmt: skip
        which = 'pid="9" p1="1"' if index else ""
        faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}" {which}/>' for a, b, c in ball.faces)
        objects.append(
            f'<object id="{index + 1}" type="model" pid="9" pindex="0"><mesh><vertices>{vertices}'
            f"</vertices><triangles>{faces}</triangles></mesh></object>"
        )
    moved = " ".join(map(str, (1, 0, 0, 0, 1, 0, 0, 0, 1, *BALLS["steel"])))
    text = (
        '<?xml version="1.0"?><model unit="millimeter" '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>'
        '<basematerials id="9"><base name="rubber" displaycolor="#101010"/>'
        '<base name="steel" displaycolor="#a0a0a0"/></basematerials>' + "".join(objects) +
        f'<object id="3" type="model"><components><component objectid="2" transform="{moved}"/>'
        '</components></object></resources><build><item objectid="1"/><item objectid="3"/></build>'
        "</model>"
    )  # fmt: skip
    kinds = (
        '<?xml version="1.0"?><Types xmlns="http://schemas.openxmlformats.org/package/2006/'
        'content-types"><Default Extension="rels" ContentType="application/vnd.openxmlformats-'
        'package.relationships+xml"/><Default Extension="model" ContentType="application/vnd.ms-'
        'package.3dmanufacturing-3dmodel+xml"/></Types>'
    )
    rels = (
        '<?xml version="1.0"?><Relationships xmlns="http://schemas.openxmlformats.org/package/2006'
        '/relationships"><Relationship Target="/3D/3dmodel.model" Id="r" Type="http://schemas.'
        'microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
    )
    with zipfile.ZipFile(path, "w") as package:
        package.writestr("[Content_Types].xml", kinds)
        package.writestr("_rels/.rels", rels)
        package.writestr("3D/3dmodel.model", text)


WRITERS = {"balls.glb": write_gltf, "balls.obj.gz": write_obj, "balls.3mf": write_3mf}


@pytest.fixture(scope="module")
def mesh(request, tmp_path_factory):
    """Return what the mesh stage makes of the balls in a format."""
    path = tmp_path_factory.mktemp("regions") / request.param
    WRITERS[request.param](path)
    task = MeshTask(source=str(path), sha256=None, seed=0)
    arrays, attributes = build(task, path, lambda text: None)
    return artifact("mesh", arrays, attributes)


def surface_points(mesh, count):
    """Return points on a repaired mesh, and whose they are; -1 near the border."""
    vertices, faces = mesh.arrays["vertices"], mesh.arrays["faces"]
    whole = trimesh.Trimesh(vertices, faces, process=False)
    points = np.asarray(trimesh.sample.sample_surface(whole, count, seed=1)[0])
    away = np.sqrt([igl.point_mesh_squared_distance(points, ball.vertices, ball.faces)[0]
                    for ball in balls().values()])  # fmt: skip
    moved = mesh.attributes["deviation"]["to_source"]["max"]
    whose = np.argmin(away, axis=0)
    whose[np.abs(away[0] - away[1]) <= moved + 1e-9] = -1
    return points, whose


def exported(mesh, kind):
    """Return a file of a mesh's field, opened."""
    return NativeField(file_of(mesh, kind))


def file_of(mesh, kind):
    """Return what a file of a mesh's field holds."""
    body = Body.open(mesh)
    field = ExactField("exact", body)
    if kind == "compact":
        arrays, record = build_compact(body, 16, 0, log=lambda text: None)
        packed = artifact("compact", arrays, record.attributes() | body.frame.attributes())
        field = CompactField("compact-16", packed)
    return export_native(field, body, NativeOptions(), provenance={}, log=lambda text: None)


@pytest.mark.parametrize(
    ("mesh", "kind"),
    [*((name, "exact") for name in WRITERS), ("balls.glb", "compact")],
    indirect=["mesh"],
)
def test_a_material_is_carried_through_a_repair_that_cuts_and_fills(mesh, kind):
    assert len(set(mesh.arrays["origin"].tolist())) > 1
    assert mesh.attributes["regions"] == ["rubber", "steel"]
    file = exported(mesh, kind)
    assert file.region_names == ("rubber", "steel")
    points, whose = surface_points(mesh, 100_000)
    told = whose >= 0
    assert told.mean() > 0.95
    assert set(whose[told]) == {0, 1}
    assert (file.regions(points) == whose)[told].mean() >= 0.999


@pytest.mark.parametrize("mesh", ["balls.glb"], indirect=True)
def test_a_proxy_rubs_as_the_region_does_in_which_it_lies(mesh):
    """Steel is smooth, rubber holds; a field without regions asks a mesh that lies beside it."""
    rough, smooth = Material(2.0, 2.0, 0.0, 0.0), Material()
    shape = Body.open(mesh)
    bare = Body(shape.vertices, shape.faces, shape.frame)
    plain = export_native(
        ExactField("exact", bare), bare, NativeOptions(), provenance={}, log=lambda text: None
    )
    beside, plain = exported(mesh, "compact"), NativeField(plain)
    assert plain.region_names == ()
    for field, regions in ((exported(mesh, "exact"), None), (beside, None), (plain, beside)):
        slips = {}
        for side, name in ((-1, "rubber"), (1, "steel")):
            placed = Placed(field, np.eye(3), np.zeros(3), 1.0, 100.0)
            contact = NativeContact(placed, 0.0, [rough, smooth], regions=regions)
            down = np.linspace(1.1, 0.9, 40)
            along = np.linspace(0, 0.05, 60) * side
            path = [*((0.8 * side, 0, z) for z in down), *((0.8 * side + x, 0, 0.9) for x in along)]
            touches = contact.follow(path)
            assert touches.region[-1] == ("rubber", "steel").index(name)
            slips[name] = touches.slip[45:].sum()
        assert slips["rubber"] == 0
        assert slips["steel"] > 0.04
        rests = contact.follow(np.tile(path[-1], (50, 1)))
        assert rests.queries[-1] == 0  # at rest nobody is asked, nor is a mesh beside
        assert rests.region[-1] == 1


@pytest.mark.parametrize("form", ["stl", "ply", "off", "obj"])
def test_an_array_beside_the_file_says_what_its_faces_are_made_of(form, tmp_path):
    """Through a repair that joins two balls and fills their holes, in the order of the file."""
    parts = [balls()[name] for name in ("steel", "rubber")]
    mesh = trimesh.util.concatenate(parts)
    path, said = tmp_path / f"balls.{form}", []
    mesh.export(path)
    names = np.repeat(["steel", "rubber"], [len(part.faces) for part in parts])
    np.save(tmp_path / f"balls.{form}.regions.npy", names)
    task = MeshTask(source=str(path), sha256=None, seed=0)
    arrays, attributes = build(task, path, said.append)
    assert attributes["regions"] == ["rubber", "steel"]
    middle = arrays["vertices"][arrays["faces"]].mean(axis=1)
    away = [np.abs(np.linalg.norm(middle - BALLS[name], axis=1) - 1) for name in BALLS]
    whose, clear = np.argmin(away, axis=0), np.abs(np.subtract(*away)) > 0.05
    assert clear.sum() > 1000
    assert (arrays["region"] == whose)[clear].all()
    assert any(line.startswith("materials: rubber (") for line in said)
    numbers = np.repeat([7, 3], [len(part.faces) for part in parts])
    np.save(tmp_path / f"balls.{form}.regions.npy", numbers)
    assert build(task, path, said.append)[1]["regions"] == ["3", "7"]


def test_an_array_beside_the_file_that_does_not_fit_it_is_refused(tmp_path):
    path, ball = tmp_path / "ball.stl", trimesh.creation.icosphere(1)
    ball.export(path)
    beside = tmp_path / "ball.stl.regions.npy"
    task = MeshTask(source=str(path), sha256=None, seed=0)
    for wrong in (np.zeros(79, int), np.zeros((80, 1), int), np.zeros(80), np.arange(80) * 1j):
        np.save(beside, wrong)
        with pytest.raises(PandisError, match="the mesh has 80 triangles: store as many"):
            build(task, path, str)
    np.save(beside, np.array([{}] * 80), allow_pickle=True)
    with pytest.raises(PandisError, match="not an array that NumPy can load"):
        build(task, path, str)
    beside.write_bytes(b"\x93NUMPY")
    with pytest.raises(PandisError, match="not an array that NumPy can load"):
        build(task, path, str)
    scene = tmp_path / "ball.glb"
    ball.export(scene)
    np.save(tmp_path / "ball.glb.regions.npy", np.zeros(80, int))
    with pytest.raises(PandisError, match="Name the materials in the scene itself"):
        build(MeshTask(source=str(scene), sha256=None, seed=0), scene, str)


def test_an_array_beside_the_file_is_a_part_of_the_source(tmp_path):
    path, digests = tmp_path / "ball.stl", SourceDigests(tmp_path / "memory.json")
    trimesh.creation.icosphere(1).export(path)
    alone = digests.of(str(path))
    beside = tmp_path / "ball.stl.regions.npy"
    seen = {alone}
    for number in (1, 2):
        np.save(beside, np.full(80, number))
        assert source_files(path) == digests.files(path) == [path, beside]
        assert digests.of(str(path)) == source_digest(source_files(path))
        seen.add(digests.of(str(path)))
    assert len(seen) == 3
    beside.unlink()
    assert digests.of(str(path)) == alone


def test_one_material_or_none_makes_no_regions(tmp_path):
    path = tmp_path / "one.obj"
    ball = trimesh.creation.icosphere(1)
    path.write_text("usemtl skin\n" + trimesh.exchange.obj.export_obj(ball))
    arrays, attributes = build(MeshTask(source=str(path), sha256=None, seed=0), path, str)
    assert "region" not in arrays
    assert "regions" not in attributes


def test_a_face_asks_at_several_places_and_most_of_them_count():
    """The middle of a large face lies by a narrow strip of another material."""
    corners = np.array([[-9, -9, 0], [9, -9, 0], [0, 9, 0.0]])
    strip = np.array([[-0.2, -9, 0], [0.2, -9, 0], [0, 0, 0.0]])
    vertices = np.concatenate([corners + [0, 0, 1e-2], strip])
    faces = np.arange(6).reshape(2, 3)
    onto = corners, np.arange(3)[None]
    assert carry((vertices, faces), np.array([7, 3]), onto).tolist() == [7]


def test_a_file_with_too_many_materials_is_told_so(tmp_path):
    path, said = tmp_path / "many.obj", []
    ball = trimesh.creation.icosphere(2)
    lines = [f"v {x} {y} {z}" for x, y, z in ball.vertices.tolist()]
    for index, face in enumerate(ball.faces):
        lines += [f"usemtl m{index}", "f " + " ".join(str(k + 1) for k in face)]
    path.write_text("\n".join(lines))
    task = MeshTask(source=str(path), sha256=None, seed=0)
    arrays, _ = build(task, path, said.append)
    assert "region" not in arrays
    assert any("320 materials, too many for regions (at most 255)" in line for line in said)


@pytest.mark.parametrize("mesh", ["balls.glb"], indirect=True)
def test_a_file_whose_regions_have_no_name_is_refused(mesh):
    body = Body.open(mesh)
    data = export_native(
        ExactField("exact", body), body, NativeOptions(), provenance={}, log=lambda text: None
    )
    assert NativeField(data).region_names == ("rubber", "steel")
    names = section(data, b"RNAM")
    for damaged in (
        resealed(data, section(data, b"REGN"), "<B", 2),
        resealed(data, names + 12, "<B", 65),  # the last name has no end
        resealed(data, data.index(b"REGN", 256) + 16, "<Q", 8),
    ):
        with pytest.raises(ArtifactError, match="are inconsistent"):
            NativeField(damaged)
