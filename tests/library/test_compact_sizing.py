"""`compact-auto`: bits and faces for the bytes or the error that are asked for; its bound."""

import numpy as np
import pytest

from pandis.base.errors import PandisError
from pandis.base.frame import Frame
from pandis.base.physical import Scale
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.distance import MeshDistance
from pandis.pipeline.geometry.hausdorff import distance_to_triangles, farthest
from pandis.pipeline.geometry.points import Points
from pandis.pipeline.geometry.sampling import Surface
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.kinds.compact.packing import size_of
from pandis.pipeline.kinds.compact.search import ENOUGH_BITS, CompactSizing, Packer
from pandis.pipeline.kinds.sizing import Candidate
from pandis.pipeline.run.ask.catalogue import parse_field
from pandis.pipeline.run.ask.kind import SearchTask
from pandis.pipeline.run.ask.targets import GridTarget
from support import box_mesh
from test_compact import UNIT, crown, fitted, hull

#: Takes long: `make test-slow`.
pytestmark = pytest.mark.slow


def silent(text):
    """Take a line of a log, and say nothing."""


def wavy(count=4000):
    """Return a ball with waves on it: what is left out of it is missed."""
    vertices, faces = hull(count, 3)
    turn = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    waves = 1 + 0.05 * np.prod(np.sin(9 * turn + 0.3), axis=1)
    return fitted(vertices * waves[:, None]), faces


def body_and_points(mesh):
    """Return a body, and the points that its fields are chosen by."""
    body = Body(*mesh, UNIT)
    return body, Points(body, Scale(0.1, 400.0), 1)


@pytest.fixture(autouse=True)
def _fewer_sides(monkeypatch):
    """Sides at a million points take longer than all else here."""
    monkeypatch.setattr("pandis.pipeline.kinds.compact.packing.SIDES", 50_000)


@pytest.fixture(scope="module")
def waves():
    """Return a body with waves, and its points."""
    return body_and_points(wavy())


def test_the_bound_of_a_shifted_box_is_the_shift():
    """Its corners are farthest: by the shift's length outside, and by no more than that inside."""
    vertices, faces = box_mesh()
    vertices = fitted(vertices) * 0.5
    shift = np.array([0.02, 0.01, 0.03])
    engine = MeshDistance(vertices, faces)
    found = farthest(vertices + shift, faces, engine)
    assert np.linalg.norm(shift) * (1 - 1e-12) <= found <= 1.1 * np.linalg.norm(shift)
    assert farthest(vertices, faces, engine) <= 1e-7


def test_a_spike_is_seen_from_its_own_side_alone():
    """Where surfaces differ in one place only the bound says by how much; the two ways differ."""
    vertices, faces = hull(2000, 1)
    spiked = vertices.copy()
    spiked[7] *= 1.5
    height = np.linalg.norm(spiked[7] - vertices[7])
    one, other = MeshDistance(vertices, faces), MeshDistance(spiked, faces)
    there, back = farthest(spiked, faces, one), farthest(vertices, faces, other)
    assert height * 0.99 <= there <= 1.1 * height
    assert back < 0.3 * height
    for mesh, bound in ((spiked, there), (vertices, back)):
        engine = one if mesh is spiked else other
        points = Surface(mesh, faces).draw(200_000, np.random.default_rng(0))[0]
        assert np.abs(engine.distance_and_normal(points, check=False)[0]).max() <= bound


def test_a_plane_of_many_small_faces_has_a_bound_that_says_something(monkeypatch):
    """None of them is near all corners of a large face: each is cut along what lies below it."""
    vertices, faces = SHAPES["box"].tessellation()
    vertices = fitted(vertices)
    few = fitted(box_mesh()[0]) * np.ptp(vertices, axis=0) / np.ptp(fitted(box_mesh()[0]), axis=0)
    engine, small = MeshDistance(vertices, faces), box_mesh()[1]
    inside = 0.001 * np.abs(few).max()
    bound = farthest(few * 0.999, small, engine)
    assert inside * (1 - 1e-9) <= bound <= 2 * inside
    outside = 0.001 * np.linalg.norm(np.abs(few).max(axis=0))  # of a corner
    assert outside * (1 - 1e-9) <= farthest(few * 1.001, small, engine) <= 2 * outside
    monkeypatch.setattr("pandis.pipeline.geometry.hausdorff._MOST", 10_000)
    assert farthest(few * 0.999, small, engine) >= inside * (1 - 1e-9)  # ended early, it holds


def test_distances_to_triangles_are_those_of_the_tree():
    vertices, faces = crown(200)
    engine = MeshDistance(vertices, faces)
    points = np.random.default_rng(1).uniform(-1, 1, (2000, 3))
    labels = engine.label(points, ties=False, check=False)
    near = distance_to_triangles(points, vertices[faces[labels.face]])
    assert near == pytest.approx(np.abs(labels.distance), abs=1e-12)
    for face in faces[:50]:
        assert (distance_to_triangles(points, np.tile(vertices[face], (2000, 1, 1)))
                >= near - 1e-12).all()  # fmt: skip


def test_more_bytes_err_less_and_every_bound_holds(waves):
    body, points = waves
    packer, errors = Packer(points, 1, silent), []
    for budget in (7000, 20_000, 60_000, 150_000):
        made = packer.within(budget)
        record = made.field.record
        assert size_of(made.arrays) <= budget
        errors.append(points.measure(made.force).figures["mean"])
        probes = np.random.default_rng(2).uniform(-1, 1, (100_000, 3))
        probes[::2] = 0.99 * body.corners[np.arange(50_000) % len(body.corners)]
        exact = np.abs(body.distance.distance_and_normal(probes, check=False)[0])
        distance, _ = made.field.answer(probes)
        assert np.abs(np.abs(distance) - exact).max() <= record.deviation + record.rounding
        fewer = record.faces < len(body.faces)
        assert fewer == (budget < 60_000)
        assert record.faces_before == len(body.faces)
        assert fewer or record.bits >= ENOUGH_BITS
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.1 * errors[0]


def test_the_same_mesh_gives_the_same_bytes(waves):
    _, points = waves
    one, other = (Packer(points, 1, silent).within(15_000) for _ in range(2))
    assert all(np.array_equal(one.arrays[key], other.arrays[key]) for key in one.arrays)


def sized(waves, **target):
    """Return attributes of a compact mesh that was asked for by a target."""
    _, points = waves
    task = SearchTask(
        kind="compact", form="compact", target=target, device={}, band=(0.045, 0.02), seed=1
    )
    return CompactSizing(points, task, silent).find()


def test_an_error_takes_the_first_bytes_that_meet_it(waves):
    arrays, attributes = sized(waves, force_error="10 mN")
    tried = attributes["sizing"]["tried"]
    assert [one["size"] for one in tried] == sorted(one["size"] for one in tried)
    assert tried[-1]["size"] == size_of(arrays)
    assert len(tried) > 1
    limits = waves[1].limits(GridTarget(force_error="10 mN"))
    assert tried[-1]["force_error"] <= limits.mean < tried[-2]["force_error"]


@pytest.mark.full
def test_what_cannot_be_met_is_said(waves):
    with pytest.raises(
        PandisError, match=r"bake\.auto\.compact.*no compact mesh that fits into 300"
    ):
        sized(waves, bytes=300)
    with pytest.raises(PandisError, match=r"bake\.auto\.compact.*the nearest, .* bytes"):
        sized(waves, force_error=1e-9)


def test_a_candidate_on_the_wrong_side_gives_way_to_the_next(waves, monkeypatch):
    """Sides are compared at a million points before a candidate is taken."""
    _, points = waves
    best = Packer(points, 1, silent).within(15_000)
    seen, told = [], []

    def refused_once(body, arrays, record, seed):
        seen.append(record.bits)
        if len(seen) == 1:
            raise PandisError("one of them on the wrong side")

    monkeypatch.setattr("pandis.pipeline.kinds.compact.search.compare_sides", refused_once)
    second = Packer(points, 1, told.append).within(15_000)
    assert isinstance(second, Candidate)
    assert second.field.record.bits != best.field.record.bits
    assert any("turned down: one of them on the wrong side" in line for line in told)


def test_its_name_stands_for_one_artifact():
    spec = parse_field("compact-auto", ())
    assert (spec.kind, spec.artifact, spec.size, spec.native) == (
        *("compact", "compact-auto", "auto"),
        True,
    )
    assert Frame.of_bounds(np.zeros(3), np.ones(3)).scale == 1.8


def test_a_lattice_too_fine_for_its_sides_gives_way_to_a_coarser_one(waves, monkeypatch):
    """Where all faces fit: the next of fewer bits, not none at all."""
    body, points = waves

    def refused_beyond_17(body, arrays, record, seed):
        if record.bits > 17:
            raise PandisError("one of them on the wrong side")

    monkeypatch.setattr("pandis.pipeline.kinds.compact.search.compare_sides", refused_beyond_17)
    made = Packer(points, 1, silent).within(None)
    assert made.field.record.bits == 17
    assert made.field.record.faces == len(body.faces)
