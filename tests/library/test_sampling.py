import numpy as np
import pytest
from scipy.spatial import cKDTree

from pandis.base.forces import penalty_force
from pandis.base.frame import UNIT, Frame
from pandis.engine.bvh import TIED
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.distance import ShapeDistance
from pandis.pipeline.geometry.sampling import PROBE_DEPTHS, Surface, bending, blue_noise, probes
from pandis.pipeline.geometry.shapes import SHAPES as CLOSED_FORMS
from pandis.pipeline.geometry.strata import STRATA
from pandis.pipeline.geometry.thickness import inscribed_radius
from pandis.pipeline.geometry.trajectories import trace
from pandis.pipeline.run.ask.options import SampleOptions, TrajectoryOptions
from pandis.pipeline.run.job.stage import silent_progress
from shapes import SHAPES, open_shape
from support import artifact, box_mesh, sample

SMALL = SampleOptions(
    surface=3000,
    offsets=3000,
    shallow=1000,
    penetration=2000,
    bent=1000,
    core=1000,
    box=2000,
    held_out=1000,
)


def test_frame():
    frame = Frame.of_bounds([1e6, 0, 0], [1e6 + 4, 2, 1])
    points = np.array([[1e6, 0, 0], [1e6 + 4, 2, 1]])
    assert np.abs(frame.to_unit(points)).max() == pytest.approx(0.9)
    assert np.abs(frame.to_mesh(frame.to_unit(points)) - points).max() < 1e-9
    assert Frame.of(artifact("mesh", {}, frame.attributes())) == frame


def test_penalty_force_pushes_out_and_never_pulls():
    normal = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])
    force = penalty_force(np.array([-0.5, 0.5, 0.0]), normal, stiffness=2.0)
    assert force.tolist() == [[0, 0, 1.0], [0, 0, 0], [0, 0, 0]]


@pytest.fixture(scope="module")
def torus():
    return Body(*CLOSED_FORMS["torus"].tessellation())


def test_samples_are_labelled_exactly_where_they_lie(torus):
    engine = torus.distance
    arrays, attributes = sample(torus, SMALL, 5, silent_progress)
    assert list(attributes["strata"]) == list(STRATA)
    assert all(len(a) == 14_000 for a in arrays.values())
    on_surface = slice(*attributes["strata"]["surface"])
    rest = slice(on_surface.stop, None)
    distance, normal = engine.distance_and_normal(arrays["points"][rest].astype(float))
    assert np.array_equal(arrays["distance"][rest], distance.astype(np.float32))
    assert np.array_equal(arrays["normal"][rest], normal.astype(np.float32))
    assert (arrays["distance"][on_surface] == 0).all()
    assert (arrays["stratum"][on_surface] == 0).all()
    deep = slice(*attributes["strata"]["penetration"])
    assert (
        -SMALL.depth * 1.001
        < arrays["distance"][deep].min()
        < arrays["distance"][deep].max()
        < 1e-6
    )
    core = slice(*attributes["strata"]["core"])
    assert (arrays["offset"][core] < -SMALL.depth * 0.999).all()
    assert -1 <= arrays["offset"][core].min() < -0.9
    assert np.abs(arrays["points"][core]).max() <= 1
    box = slice(*attributes["strata"]["box"])
    assert np.abs(arrays["points"][box]).max() <= 1


def test_points_can_be_made_again_from_face_barycentrics_and_offset(torus):
    surface = torus.surface
    arrays, attributes = sample(torus, SMALL, 5, silent_progress)
    start = attributes["strata"]["box"][0]
    points, normals = surface.at(arrays["face"][:start], arrays["barycentrics"][:start])
    again = points + arrays["offset"][:start, None].astype(float) * normals
    assert np.abs(again - arrays["points"][:start]).max() < 1e-7


def test_same_seed_same_samples(torus):
    def draw(seed):
        return sample(torus, SMALL, seed, silent_progress)[0]["points"]

    assert np.array_equal(draw(5), draw(5))
    assert not np.array_equal(draw(5), draw(6))


def test_shards_do_not_show(torus, monkeypatch):
    """Fewer points at once: other random numbers, but strata of the same law, in one order."""
    monkeypatch.setattr("pandis.pipeline.geometry.strata.SHARD", 256)
    arrays, attributes = sample(torus, SMALL, 5, silent_progress)
    assert all(len(a) == 14_000 for a in arrays.values())
    start, stop = attributes["strata"]["surface"]
    rank = np.empty(len(torus.surface.order), int)
    rank[torus.surface.order] = np.arange(len(rank))
    assert (np.diff(rank[arrays["face"][start:stop]]) >= 0).all()


def test_threads_do_not_show(torus, monkeypatch):
    def draw(threads):
        monkeypatch.setenv("IGL_NUM_THREADS", threads)
        return sample(torus, SMALL, 5, silent_progress)[0]

    one, three = draw("1"), draw("3")
    assert all(np.array_equal(one[name], three[name]) for name in one)


def test_points_with_two_closest_points_are_marked():
    vertices, faces = box_mesh()
    body = Body(vertices * [0.9, 0.9, 0.06], faces, UNIT)
    arrays, _ = sample(body, SMALL, 5, silent_progress)
    flags = body.distance.label(arrays["points"].astype(float)).flags
    assert np.array_equal(arrays["tied"], (flags & TIED) > 0)
    assert 0 < arrays["tied"].mean() < 0.2


def test_bent_places_get_more_points():
    """A box of fine squares: all bends are at its edges."""
    vertices, faces = CLOSED_FORMS["box"].tessellation()
    surface = Surface(vertices, faces)
    weight = bending(surface)
    assert weight.min() == 1
    assert weight.max() > 2
    middle = np.sort(np.abs(surface.corners.mean(axis=1)) / CLOSED_FORMS["box"].half, axis=1)[:, 1]
    assert (weight[middle < 0.9] == 1).all()
    points, _, face, _ = surface.draw(20_000, np.random.default_rng(0), bent=True)
    share = (surface.areas * weight)[weight > 1].sum() / (surface.areas * weight).sum()
    assert (weight[face] > 1).mean() == pytest.approx(share, abs=0.01)
    assert len(points) == 20_000


def test_blue_noise_keeps_its_distance_and_stays_uniform(torus):
    surface = torus.surface
    count = 3000
    points, _, face, _ = blue_noise(surface, count, np.random.default_rng(0))
    again = blue_noise(surface, count, np.random.default_rng(0))[0]
    assert np.array_equal(points, again)
    assert len(points) == count
    largest = np.sqrt(2 * surface.areas.sum() / (np.sqrt(3) * count))  # of a hexagonal packing
    apart = cKDTree(points).query(points, 2)[0][:, 1]
    assert apart.min() > 0.5 * largest
    random = surface.draw(count, np.random.default_rng(0))[0]
    assert cKDTree(random).query(random, 2)[0][:, 1].min() < 0.1 * largest
    centre = surface.corners.mean(axis=1)
    for direction in np.random.default_rng(1).normal(size=(10, 3)):
        share = surface.areas[centre @ direction > 0.1].sum() / surface.areas.sum()
        assert (centre[face] @ direction > 0.1).mean() == pytest.approx(share, abs=9e-3)


def test_blue_noise_on_a_wall_has_points_on_both_sides():
    vertices, faces = box_mesh()
    surface = Surface(vertices * [0.9, 0.9, 0.002], faces)
    _, normals, _, _ = blue_noise(surface, 2000, np.random.default_rng(0))
    top, bottom = (normals[:, 2] > 0.5).sum(), (normals[:, 2] < -0.5).sum()
    assert top == pytest.approx(bottom, rel=0.02)
    assert top + bottom > 1900


def test_surface_points_are_uniform_by_area(torus):
    """More so than independent ones: compare the counts on the two halves of many cuts."""
    surface = torus.surface
    points, normals, face, _ = surface.draw(20_000, np.random.default_rng(0))
    assert np.abs(np.linalg.norm(normals, axis=1) - 1).max() < 1e-12
    area = np.linalg.norm(np.cross(
        surface.corners[:, 1] - surface.corners[:, 0], surface.corners[:, 2] - surface.corners[:, 0]
    ), axis=1)  # fmt: skip
    centre = surface.corners.mean(axis=1)
    for direction in np.random.default_rng(1).normal(size=(20, 3)):
        share = area[centre @ direction > 0.1].sum() / area.sum()
        found = (centre[face] @ direction > 0.1).mean()
        # one standard deviation of independent points would be 3.5e-3
        assert found == pytest.approx(share, abs=3.5e-3)
    assert len(points) == 20_000


def test_closed_form_is_sampled_on_itself():
    frame = Frame((0.0, 0.0, 0.0), 0.9)
    engine = ShapeDistance(CLOSED_FORMS["sphere"], frame)
    vertices, faces = CLOSED_FORMS["sphere"].tessellation()
    surface = Surface(frame.to_unit(vertices), faces, engine)
    points, normals, _, _ = surface.draw(2000, np.random.default_rng(0))
    assert np.abs(np.linalg.norm(points, axis=1) - 0.9).max() < 1e-14
    assert np.abs(normals - points / 0.9).max() < 1e-12


def test_probe_sets_follow_the_contract(torus):
    engine = torus.distance
    sets = probes(torus, 5000, seed=1)
    assert set(sets) == set(PROBE_DEPTHS)
    for name, deepest in PROBE_DEPTHS.items():
        points, distance, normal = sets[name]
        exact = engine.distance_and_normal(points)
        assert np.array_equal(distance, exact[0])
        assert np.array_equal(normal, exact[1])
        assert -deepest <= distance.min() < -0.98 * deepest
        assert distance.mean() == pytest.approx(-deepest / 2, rel=0.03)


# --- trajectories ---------------------------------------------------------------------


def path_of(body, **options):
    return trace(body, TrajectoryOptions(**options), 3, progress=silent_progress)[0]


@pytest.mark.slow
def test_trajectory_is_exact_smooth_and_of_the_depth_asked_for(torus):
    found = path_of(torus)
    points, distance, normal = (found[k] for k in ("points", "distance", "normal"))
    exact = torus.distance.distance_and_normal(points)
    assert np.array_equal(distance, exact[0])
    assert np.array_equal(normal, exact[1])
    assert len(points) == 2000
    assert -0.0205 < distance.min() < -0.019
    assert -0.0012 < distance.max() < -0.00095
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert np.median(steps) == pytest.approx(0.004, rel=0.05)
    assert (steps > 0.008).sum() <= 5  # but for a new start after a dead end
    assert np.abs(np.diff(distance)).max() < 0.002


def test_trajectory_is_seeded(torus):
    one, other = path_of(torus, samples=200), path_of(torus, samples=200)
    assert np.array_equal(one["points"], other["points"])


@pytest.mark.slow
@pytest.mark.parametrize("name", SHAPES)
def test_a_path_follows_the_thickness_of_what_is_too_thin_for_it(name):
    """A sheet-metal part got no report at all: its walls are thinner than the usual depth."""
    shape = open_shape(name)
    options = TrajectoryOptions(samples=200)
    found, attributes = trace(shape.body, options, 1, progress=silent_progress)
    distance, normal = shape.engine.distance_and_normal(found["points"])
    assert (distance < 0).all()
    assert np.array_equal(distance, found["distance"])
    foot = found["points"] - distance[:, None] * normal
    radius = inscribed_radius(shape.engine, foot, normal)
    if attributes["followed"]:
        assert "too thin for the depths of 0.001 to 0.02" in attributes["followed"]
        assert (-distance <= 0.85 * radius + 1e-6).mean() > 0.99
    else:
        assert -distance.min() > 0.015
    if name.startswith("plate"):
        assert attributes["followed"]


@pytest.mark.slow
def test_depths_that_no_part_has_room_for_follow_it_too():
    vertices, faces = box_mesh()
    thin = Body(vertices * [0.9, 0.9, 0.005], faces, UNIT)
    found = path_of(thin, samples=50, shallow=0.4, deep=0.5)
    assert (found["distance"] < 0).all()
    assert found["distance"].min() > -0.005
