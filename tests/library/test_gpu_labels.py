"""Labels from a device of Warp, its CPU or CUDA, are those of the host's tree."""

import sys

import numpy as np
import pytest

from pandis.pipeline.geometry.distance import SURFACE_DISTANCE, MeshDistance, ShapeDistance
from pandis.pipeline.kinds.network.training import labels
from shapes import bent_sheet, blade, box, cage, finned_ball, plate

warp = pytest.importorskip("warp", reason="no Warp: pip install warp-lang")
from pandis.engine.cuda import meshes  # noqa: E402 (needs Warp)

DEVICES = ["cpu", *(["cuda"] if warp.is_cuda_available() else [])]


def engine_of(mesh):
    middle = mesh.bounds.mean(axis=0)
    vertices = (mesh.vertices - middle) * (1.8 / np.ptp(mesh.bounds, axis=0).max())
    return MeshDistance(vertices, mesh.faces)


def places(engine, rng):
    """Return points in the box, near the surface, on it, on edges and far away."""
    corners = engine.vertices[engine.faces]
    weights = rng.dirichlet((1, 1, 1), len(corners))[:, :, None]
    surface = (corners * weights).sum(axis=1)
    beside = np.repeat(surface, 3, axis=0)[:20_000]
    return np.concatenate([
        rng.uniform(-1, 1, (20_000, 3)),
        beside + rng.normal(0, 0.003, beside.shape),
        surface[:5000],
        engine.vertices[:5000],
        corners[:5000, :2].mean(axis=1),
        rng.uniform(-5, 5, (2000, 3)),
    ])  # fmt: skip


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("shape", [
    lambda: box((30, 20, 10), 4), finned_ball, blade, bent_sheet, cage, lambda: plate(0.05),
])  # fmt: skip
def test_labels_are_those_of_the_host(shape, device):
    """Signs all the same; distances and directions but for rounding."""
    engine = engine_of(shape())
    points = places(engine, np.random.default_rng(0)).astype(np.float32).astype(np.float64)
    wanted = engine.label(points, ties=False)
    seen = labels.GpuDistance(engine, device).label(points, ties=False)
    assert (np.signbit(seen.distance) == np.signbit(wanted.distance)).all()
    assert np.abs(seen.distance - wanted.distance).max() < 1e-14
    assert np.abs(np.linalg.norm(seen.normal, axis=1) - 1).max() < 1e-12
    # of two points equally near one or the other, but a point of the surface
    away = np.abs(wanted.distance) > SURFACE_DISTANCE
    feet = points[away] - seen.distance[away, None] * seen.normal[away]
    assert np.abs(engine.label(feet, ties=False).distance).max() < 1e-13
    other = np.abs(seen.normal - wanted.normal).max(axis=1) > 1e-6
    assert other.mean() < 1e-2


def test_a_wrong_tree_would_be_seen():
    """A vertex that lies elsewhere on the device gives other distances."""
    engine = engine_of(box((30, 20, 10), 4))
    own = labels.GpuDistance(engine, "cpu")
    parts = engine.tree_parts()
    moved = np.frombuffer(parts["VERT"], "<f8").copy()
    moved[0] += 1e-3
    own._labels = meshes.MeshLabels(parts | {"VERT": moved.tobytes()}, engine.reach, "cpu")
    points = places(engine, np.random.default_rng(0))
    wanted = engine.label(points, ties=False).distance
    assert np.abs(own.label(points, ties=False).distance - wanted).max() > 1e-5


def test_a_tree_that_is_too_deep_is_left_to_the_host(monkeypatch):
    """A point would write beyond its room, and the answers would be anybody's."""
    engine = engine_of(finned_ball())
    monkeypatch.setattr(meshes, "ROOM", 14)
    with pytest.raises(RuntimeError, match="tree is too deep"):
        meshes.MeshLabels(engine.tree_parts(), engine.reach, "cpu")


def test_what_has_no_mesh_or_no_gpu_is_labelled_by_the_host(monkeypatch):
    engine, said = engine_of(box((30, 20, 10), 4)), []
    assert labels.on_device(engine, "cpu", said.append) is engine
    shape = ShapeDistance(None, None)
    assert labels.on_device(shape, "cuda", said.append) is shape
    assert said == []
    monkeypatch.setitem(sys.modules, "pandis.engine.cuda.meshes", None)
    assert labels.on_device(engine, "cuda", said.append) is engine
    assert "labels come from the host" in said[0]
