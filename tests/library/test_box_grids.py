"""The paper's grids on the box around the surface, against their definition."""

from pathlib import Path

import numpy as np
import pytest

from pandis.base.forces import penalty_force
from pandis.base.frame import UNIT, Frame
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.distance import MeshDistance, ShapeDistance
from pandis.pipeline.geometry.sampling import probes
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.kinds.field import BOUND, OK
from pandis.pipeline.kinds.grid.dense import DenseGrid
from pandis.pipeline.kinds.grid.graph import grid_graph
from pandis.pipeline.kinds.native import native_bytes
from pandis.pipeline.kinds.session import Session
from pandis.pipeline.mesh.build import build
from pandis.pipeline.run.ask.tasks import MeshTask
from pandis.pipeline.run.job.artifact import Artifact
from pandis.pipeline.run.job.stage import silent_progress
from pandis.runtime.field import NativeField
from support import box_mesh, open_as

FRAME = Frame((3.0, -2.0, 0.5), 0.6)
BAND = (0.045, 0.02)
EVERYTHING = (4.0, 4.0)
SCANS = {
    "bunny": "stanford/bunny_35947v_69451f_binary.ply",
    "armadillo": "stanford/armadillo_49990v_99976f_ngp.obj",
    "dragon": "stanford/dragon_closed_39994v_79988f.obj",
}


def mesh(name):
    """Return a mesh in the unit frame: one with its walls on the box, one thin, one round."""
    if name == "torus":
        vertices, faces = SHAPES["torus"].tessellation(40, 20)
    elif name == "plate":
        vertices, faces = box_mesh()
        vertices = vertices * [1.0, 0.6, 0.013]
    else:
        vertices, faces = box_mesh()
        vertices = vertices * [1.0, 0.7, 0.4]
    frame = Frame.of_bounds(vertices.min(0), vertices.max(0))
    return frame.to_unit(vertices), faces


def baked(kind, engine, size, band):
    grid = DenseGrid(engine, "force-box", size, band=band, progress=silent_progress)
    values = np.concatenate(list(grid.slabs(16)))
    attributes = grid.attributes() | FRAME.attributes()
    return open_as(kind, Artifact("grid", {"values": values}, attributes))


def naive(kind, engine, vertices, size, points):
    """Return the force (n, 3): exact at nodes of the vertices' bounds, nothing beyond them."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    axes = [np.linspace(*ends, size) for ends in zip(low, high, strict=True)]
    within = ((points >= low) & (points <= high)).all(axis=1)
    place = np.clip((points - low) / (high - low) * (size - 1), 0, size - 1)
    force = np.zeros((len(points), 3))
    if kind == "nearest-box":
        corners, weights = [np.floor(place + 0.5).astype(int)], [np.ones(len(points))]
    else:
        base = np.minimum(np.floor(place).astype(int), size - 2)
        t = place - base
        corners = [base + offset for offset in np.ndindex(2, 2, 2)]
        weights = [np.where(o, t, 1 - t).prod(axis=1) for o in np.ndindex(2, 2, 2)]
    for corner, weight in zip(corners, weights, strict=True):
        node = np.column_stack([axes[k][corner[:, k]] for k in range(3)])
        force += weight[:, None] * penalty_force(*engine.distance_and_normal(node))
    return np.where(within[:, None], force, 0.0)


def places(vertices, count, size, seed=0):
    """Return points in the box of the surface, around it, and on its faces, but for ties."""
    rng = np.random.default_rng(seed)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    near = rng.uniform(low - 0.05, high + 0.05, (count // 2, 3))
    anywhere = rng.uniform(-1.5, 1.5, (count // 4, 3))
    inside = rng.uniform(low, high, (count - len(near) - len(anywhere), 3))
    face = np.arange(len(inside) // 8)
    inside[face, face % 3] = np.where(face % 2, low[face % 3], high[face % 3])
    points = np.concatenate([near, anywhere, inside])
    # halfway between two nodes either is the nearest
    half = (points - low) / (high - low) * (size - 1) + 0.5
    return points[(np.abs(half - np.round(half)) > 1e-9).all(axis=1)]


def compare(kind, engine, vertices, size, count):
    """Hold library, pandis.h and ONNX against the definition; return how many points have a force.

    Everywhere for a grid of which all nodes are exact, and where its flag says so for one that is
    exact in a band.
    """
    points = places(vertices, count, size)
    wanted = naive(kind, engine, vertices, size, points)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    outside = ((points < low) | (points > high)).any(axis=1)
    for band in (EVERYTHING, BAND):
        field = baked(kind, engine, size, band)
        answer = field.query(points)
        sure = answer.flag == OK if band is BAND else np.ones(len(points), bool)
        ours = penalty_force(answer.distance, answer.normal)
        assert np.abs(ours - wanted)[sure | outside].max() < 1e-6
        assert (answer.flag[outside] == BOUND).all()
        assert not ours[outside].any()
        assert (answer.distance[outside] == 0).all()
        if band is BAND:
            deep = ~outside & ~sure & (engine.distance_and_normal(points)[0] < 0)
            assert (ours[deep] != 0).any(axis=1).mean() > 0.99 if deep.any() else True
        native = NativeField(native_bytes(field, {}))
        found = native.query(FRAME.to_mesh(points))
        force = penalty_force(found.distance * FRAME.scale, found.normal)
        assert np.abs(force - ours).max() < 1e-6
        on_face = (np.abs(np.stack([points - low, points - high])) < 1e-12).any(axis=(0, 2))
        assert (found.flag == answer.flag)[~on_face].all()  # there a rounding decides
        model = grid_graph(field).model(kind, {})
        distance, normal = Session(model).distance_and_normal(FRAME.to_mesh(points))
        force = penalty_force(distance * FRAME.scale, normal)
        assert np.abs(force - ours).max() < 1e-6
    return int((np.abs(wanted).max(axis=1) > 0).sum())


@pytest.mark.parametrize("name", ["torus", "plate", "box"])
@pytest.mark.parametrize("kind", ["nearest-box", "trilinear-box"])
def test_answers_are_those_of_the_definition(kind, name):
    vertices, faces = mesh(name)
    assert compare(kind, MeshDistance(vertices, faces), vertices, 24, 20_000) > 500


def test_outside_there_is_no_force_whatever_rounding_left_on_the_box():
    """A wall of the mesh lies on the box, and a node on it may have come out just inside."""
    vertices, faces = mesh("box")
    field = baked("trilinear-box", MeshDistance(vertices, faces), 8, BAND)
    field.values[-1] = [0.0, 1e-3, 0.0]
    point = np.array([[1.0, 0.0, 0.0], [0.9, 0.0, 0.0]])
    assert np.linalg.norm(penalty_force(*field.answer(point)), axis=1) == pytest.approx([0, 1e-3])
    native = NativeField(native_bytes(field, {})).query(FRAME.to_mesh(point))
    model = Session(grid_graph(field).model("g", {}))
    for distance in (native.distance, model.distance_and_normal(FRAME.to_mesh(point))[0]):
        assert distance[0] == 0
    assert native.flag[0] == BOUND


@pytest.mark.parametrize("name", ["box", "torus"])
def test_deep_nodes_are_completed_along_cells_that_are_no_cubes(name):
    """What is below the band is known to a cell's diagonal, in every direction."""
    vertices, faces = mesh(name)
    engine = MeshDistance(vertices, faces)
    field = baked("trilinear-box", engine, 40, BAND)
    index = np.argwhere(np.ones((40,) * 3, bool))
    distance, _ = engine.distance_and_normal(field.axes.nodes(index))
    deep = distance < -BAND[0] - np.linalg.norm(field.axes.step)
    depth = np.linalg.norm(field.values.reshape(-1, 3).astype(float), axis=1)
    assert deep.sum() > 1000
    assert np.abs(depth + distance)[deep].max() < np.linalg.norm(field.axes.step)


@pytest.mark.full
@pytest.mark.parametrize("name", SCANS)
def test_answers_on_scans_are_those_of_the_definition(name, meshes):
    path = Path(meshes) / SCANS[name]
    task = MeshTask(source=str(path), sha256=None, seed=0)
    arrays, _ = build(task, path, lambda text: None)
    vertices = arrays["vertices"]
    vertices = Frame.of_bounds(vertices.min(0), vertices.max(0)).to_unit(vertices)
    engine = MeshDistance(vertices, arrays["faces"])
    for kind in ("nearest-box", "trilinear-box"):
        assert compare(kind, engine, vertices, 64, 20_000) > 1000


def test_box_of_a_closed_form_is_its_own_not_that_of_its_tessellation():
    shape = SHAPES["sphere"]
    frame = Frame.of_bounds(-np.array(shape.half_extent), np.array(shape.half_extent))
    grid = DenseGrid(
        ShapeDistance(shape, frame), "force-box", 8, band=BAND, progress=silent_progress
    )
    np.testing.assert_allclose(grid.axes.low, -0.9, atol=1e-12)
    np.testing.assert_allclose(grid.axes.high, 0.9, atol=1e-12)


def test_the_same_bytes_err_less_on_the_box_than_on_the_cube():
    """Why the paper's comparison depends on it: the cells are smaller."""
    vertices, faces = mesh("torus")
    engine = MeshDistance(vertices, faces)
    points, distance, normal = probes(Body(vertices, faces, UNIT), 5000, seed=1)["deep"]
    exact = penalty_force(distance, normal)
    cube = DenseGrid(engine, "force", 48, band=BAND, progress=silent_progress)
    values = np.concatenate(list(cube.slabs(48)))
    attributes = cube.attributes() | FRAME.attributes()
    held = Artifact("grid", {"values": values}, attributes)
    errors = {}
    for name, field in {
        "cube": open_as("trilinear", held),
        "box": baked("trilinear-box", engine, 48, BAND),
    }.items():
        off = penalty_force(*field.answer(points)) - exact
        errors[name] = np.linalg.norm(off, axis=1).mean()
    assert errors["box"] < 0.8 * errors["cube"], errors


def test_older_readers_still_take_grids_on_the_cube():
    """A file says the first version that knows what it holds."""
    vertices, faces = mesh("torus")
    engine = MeshDistance(vertices, faces)
    own = native_bytes(baked("trilinear-box", engine, 8, BAND), {})
    cube = DenseGrid(engine, "force", 8, band=BAND, progress=silent_progress)
    values = np.concatenate(list(cube.slabs(8)))
    attributes = cube.attributes() | FRAME.attributes()
    held = Artifact("grid", {"values": values}, attributes)
    plain = native_bytes(open_as("trilinear", held), {})
    assert (plain[12], own[12]) == (1, 2)
