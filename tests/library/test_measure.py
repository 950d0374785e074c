"""The contact measure and its controls: against closed forms, and on fields that lack something."""

import numpy as np
import pytest

from pandis.base.errors import PandisError
from pandis.base.forces import penalty_force
from pandis.base.frame import Frame
from pandis.base.physical import Scale
from pandis.pipeline.geometry.distance import MeshDistance
from pandis.pipeline.geometry.measure import (
    OF_RADIUS,
    contact_errors,
    draw_contacts,
    promise,
    too_thin,
)
from pandis.pipeline.geometry.places import stratify
from pandis.pipeline.geometry.sampling import Surface
from pandis.pipeline.geometry.shares import (
    JUDGED,
    MISSING_LIMIT,
    Probes,
    felt,
    largest_patch,
    missing,
    shares,
    strongly_felt,
)
from pandis.pipeline.geometry.thickness import are_walls, inscribed_radius
from pandis.pipeline.judge.controls import GAP, controls, demand_failure
from pandis.pipeline.kinds.field import ExactField, Field
from pandis.pipeline.run.ask.budget import Limits, amount
from pandis.pipeline.run.ask.targets import BudgetOptions
from shapes import SHAPES, open_shape

SCALE = Scale(0.1, 400.0)


def forces(field):
    return lambda points: penalty_force(*field.answer(points))


@pytest.fixture(scope="module", params=SHAPES)
def shape(request):
    return open_shape(request.param)


def test_points_lie_as_deep_as_the_exact_force_reaches(shape):
    contacts = draw_contacts(shape.body, SCALE, 4000, rng=np.random.default_rng(1))
    for probes, deepest in zip(contacts.sets.values(), (0.01, 0.04), strict=True):
        assert (probes.distance < 1e-9).all()
        assert probes.distance.min() >= -deepest - 1e-9
    # the way back up is the exact normal: the probe has not come out on the other side
    feet = contacts.pressed.points - contacts.pressed.distance[:, None] * contacts.pressed.normal
    assert np.abs(shape.engine.distance_and_normal(feet)[0]).max() < 1e-6


def test_no_control_passes_anything_and_the_exact_field_lacks_nothing(shape):
    contacts = draw_contacts(shape.body, SCALE, 20_000, rng=np.random.default_rng(2))
    exact = ExactField("exact", shape.body)
    found = contact_errors(forces(exact), contacts)["contact-deep"]
    assert found["mean"] == found["missing"] == found["felt"] == 0
    assert found["judged"] > 0.5
    for control in controls(exact, SCALE):
        errors = contact_errors(forces(control), contacts)
        for row in errors.values():
            assert row["missing"] > MISSING_LIMIT
        lacks = errors["contact-deep"]["missing"]
        if control.name == "control-zero":
            assert lacks == 1
            assert errors["contact-deep"]["relative"] == pytest.approx(1)
        elif control.name == "control-gap":
            assert lacks == pytest.approx(GAP, rel=0.25)
        else:  # of all area, while what is missing is a share of what is judged and not left out
            assert lacks * found["judged"] > 0.6 * min(GAP, control.counts)


def test_a_plate_without_force_is_not_called_right_by_a_mean():
    """What the old sets said of a plate of 0.56 mm: most probes came out on the other side."""
    plate = open_shape("plate-0.6")
    zero, *_ = controls(ExactField("exact", plate.body), SCALE)
    points, normals, _, _ = plate.surface.draw(20_000, np.random.default_rng(0))
    deep = points - np.random.default_rng(1).uniform(0, 0.04, 20_000)[:, None] * normals
    old = np.linalg.norm(penalty_force(*plate.engine.distance_and_normal(deep)), axis=1).mean()
    assert old < 1e-3  # the README's own budget, met by nothing at all
    contacts = draw_contacts(plate.body, SCALE, 5000, rng=np.random.default_rng(2))
    assert contact_errors(forces(zero), contacts)["contact-deep"]["relative"] == pytest.approx(1)


def test_the_radius_of_a_ball_through_the_nearest_point_is_that_by_halving(shape):
    points, normals, _, _ = shape.surface.draw(300, np.random.default_rng(3))
    found = inscribed_radius(shape.engine, points, normals)

    def own(radius):
        centre = points - radius[:, None] * normals
        return np.abs(shape.engine.distance_and_normal(centre)[0] + radius)

    assert (own(found) < 1.01e-6).all()  # it touches its point, and nothing is nearer
    larger = np.minimum(1.02 * found + 2e-5, 0.9)
    assert (own(larger)[larger < 0.9] > 1e-9).all()  # a larger one is cut by another wall


def probes_of(force, wall=False):
    """Probes with these exact forces (n, 3), newtons, whose exact field is the same beside them."""
    size = np.linalg.norm(force, axis=1)
    distance, normal = -size / SCALE.newtons, force / size[:, None]
    points = np.random.default_rng(0).uniform(-1, 1, force.shape)

    class Same:
        def distance_and_normal(self, points, check):
            times = len(points) // len(force)
            return np.repeat(distance, times), np.repeat(normal, times, axis=0)

    return Probes(points, distance, normal, np.full(len(force), wall), SCALE, Same())


def test_missing_and_felt_by_hand():
    newtons, thick, walls = SCALE.newtons, np.zeros(6, bool), np.ones(6, bool)
    exact = np.array([[0, 0, 1.0]] * 6) / newtons  # one newton each
    force = (
        np.array([[0, 0, 1], [0, 0, 0.49], [0, 0, 0.51], [0, 0, -1], [0.3, 0, 1], [np.nan, 0, 0]])
        / newtons
    )
    for wall in (thick, walls):
        lacks = missing(force, exact, wall, newtons=newtons)
        assert lacks.tolist() == [False, True, False, True, False, True]
    assert felt(force, exact, newtons).tolist() == [False, True, True, True, True, True]
    assert felt(force, exact, newtons, share=0.4).tolist() == [False, True, True, True, False, True]
    # away from walls what falls short by less than 0.05 N is felt by nobody
    weak = exact * 0.06
    assert missing(0.3 * weak, weak, thick, newtons=newtons).tolist() == [False] * 6
    assert missing(0.1 * weak, weak, thick, newtons=newtons).tolist() == [True] * 6
    assert felt(0.8 * weak, weak, newtons).tolist() == [False] * 6
    # a wall that pushes with a hundredth of that is judged all the same
    assert missing(0.003 * weak, 0.01 * weak, walls, newtons=newtons).tolist() == [True] * 6
    assert missing(0.006 * weak, 0.01 * weak, walls, newtons=newtons).tolist() == [False] * 6
    # nothing judged is nothing known: no verdict rests on it
    nothing = {"judged": 0.0, "missing": 1.0, "felt": 1.0}
    assert shares(weak, probes_of(0.1 * weak * newtons)) == nothing
    assert JUDGED * SCALE.metre / SCALE.stiffness == pytest.approx(0.05 / newtons)


def test_what_lies_between_forces_nearby_is_not_strongly_felt():
    """At the edge of two walls a smooth field turns from one to the other; a third is a fault."""
    exact = probes_of(np.array([[0.0, 0, 1]] * 4))
    exact.__dict__["around"] = np.tile([1.0, 0, 0], (4, 8, 1)) / SCALE.newtons
    force = np.array([[0.7, 0, 0.7], [0.2, 0, 0.8], [0, 0.7, 0.7], [0, 0, 0.3]]) / SCALE.newtons
    assert felt(force, exact.force, SCALE.newtons, share=0.4).tolist() == [True, False, True, True]
    assert strongly_felt(force, exact).tolist() == [False, False, True, True]


def test_a_patch_is_what_hangs_together():
    torus = open_shape("finned-ball")
    drawn = draw_contacts(torus.body, SCALE, 10_000, rng=np.random.default_rng(4))
    probes = drawn.sets["contact-deep"]
    near = np.linalg.norm(probes.points - probes.points[0], axis=1)
    near += probes.normal @ probes.normal[0] < 0  # the other side of the fin is another place
    inside = near < np.sort(near)[200]
    assert largest_patch(probes, inside) == pytest.approx(0.02, abs=0.008)
    alone = np.random.default_rng(0).random(10_000)[: len(inside)] < 0.02
    assert largest_patch(probes, alone) < 0.001
    assert largest_patch(probes, np.ones(len(inside), bool)) > 0.3


def test_stratified_points_count_the_area_of_a_fin_they_press_on():
    """Two fins on a ball: a third of the surface, and half of the points."""
    ball = open_shape("finned-ball")
    places = stratify(ball.body, SCALE, 400, rng=np.random.default_rng(4))
    assert places.weight.sum() == pytest.approx(1)
    thin = places.radius < 0.02
    contacts = draw_contacts(ball.body, SCALE, 20_000, rng=np.random.default_rng(5))
    uniform = -contacts.pressed.distance < OF_RADIUS * 0.02
    assert places.weight[thin].sum() == pytest.approx(uniform.mean(), abs=0.1)
    assert thin.mean() > 0.5
    assert (places.depth(0.04) <= 0.04).all()


class Lucky(Field):
    """Right but for a patch of the surface."""

    def __init__(self, exact, below):
        super().__init__("lucky", exact.frame, 0)
        self.exact, self.below = exact, below

    def answer(self, points):
        distance, normal = self.exact.answer(points)
        return np.where(points[:, 2] < self.below, 0.0, distance), normal


def test_a_promise_is_kept_on_other_points():
    sheet = open_shape("bent-sheet")
    field = Lucky(ExactField("exact", sheet.body), np.quantile(sheet.engine.vertices[:, 2], 0.02))
    first, second = (
        draw_contacts(sheet.body, SCALE, 20_000, rng=np.random.default_rng(seed)) for seed in (6, 7)
    )
    _, upper = promise(forces(field), first)
    found, _ = promise(forces(field), second)
    assert all(found[key] <= upper[key] for key in found)


def test_amounts_and_limits():
    assert amount("20 mN") == (20, "mN")
    assert amount("0.02N") == (0.02, "N")
    assert amount("5 %") == (5, "%")
    assert amount(1e-3) == (1e-3, "")
    for bad in ("20 kN", "-3 mN", "mN", 0, -1, "", float("nan"), True):
        with pytest.raises(ValueError, match="an amount of force is"):
            amount(bad)
    newtons = SCALE.newtons  # 22.2 N per unit of force
    target = BudgetOptions(force_error="20 mN", tail="50 %")
    limits = Limits.of(target, newtons, 0.02)
    assert limits.mean == pytest.approx(0.02 / newtons)
    assert limits.tail == pytest.approx(0.01)
    assert Limits.of(BudgetOptions(force_error=1e-3), newtons, 0.02).tail == 0.01
    assert limits.excess({"mean": limits.mean / 2, "p99": 0.0, "missing": 0.01}) == 2
    assert limits.excess({"mean": float("nan"), "p99": 0.0, "missing": 0.0}) == float("inf")


def test_a_judgement_that_passes_a_control_says_so():
    demand_failure("the choice", [])
    with pytest.raises(PandisError, match="the choice is blind on this mesh: it passes a and b"):
        demand_failure("the choice", ["a", "b"])


def test_a_gap_is_where_the_wall_is_thinnest_and_has_the_same_place_again():
    blade = open_shape("blade")
    exact = ExactField("exact", blade.body)
    one, other = (controls(exact, SCALE)[1] for _ in range(2))
    points, normals, _, _ = blade.surface.draw(4000, np.random.default_rng(8))
    radius = inscribed_radius(blade.engine, points, normals)
    pressed = points - 0.9 * radius[:, None] * normals
    lacks = one.answer(pressed)[0] == 0
    assert np.array_equal(lacks, other.answer(pressed)[0] == 0)
    wall = are_walls(blade.engine, points, normals, radius=radius)
    pushing = OF_RADIUS * radius * SCALE.newtons >= JUDGED
    judged = (wall | pushing) & ~too_thin(radius, wall, SCALE)
    assert radius[lacks & judged].max() <= np.quantile(radius[judged], 0.06)
    assert isinstance(blade.engine, MeshDistance)
    assert isinstance(blade.frame, Frame)
    assert isinstance(blade.surface, Surface)
