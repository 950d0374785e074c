"""The stress suite: known figures, and for every question a field that must fail it."""

import numpy as np
import pytest

from pandis.base.errors import PandisError
from pandis.base.forces import penalty_force
from pandis.base.frame import Frame
from pandis.base.physical import Scale
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.distance import MeshDistance, ShapeDistance
from pandis.pipeline.geometry.places import Stratified
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.judge.controls import controls
from pandis.pipeline.judge.stress.contact import holding, wanted_force
from pandis.pipeline.judge.stress.coupled import LADDER, Loop, simulate, stable_stiffness
from pandis.pipeline.judge.stress.ghosts import ghosts
from pandis.pipeline.judge.stress.jumps import jumps
from pandis.pipeline.judge.stress.physical import Device
from pandis.pipeline.judge.stress.probes import Shell
from pandis.pipeline.judge.stress.robust import CHUNK, walk
from pandis.pipeline.judge.stress.stiffness import jacobians
from pandis.pipeline.judge.stress.suite import QUESTIONS, Suite, stress
from pandis.pipeline.judge.stress.work import DEPTHS, loop_work, loops
from pandis.pipeline.kinds.field import OK, Answer, Field
from pandis.pipeline.kinds.grid.dense import DenseGrid
from pandis.pipeline.run.ask.options import StressOptions
from pandis.pipeline.run.job.stage import silent_progress
from support import artifact, box_mesh, open_as

R = 0.9
FRAME = Frame((0.0, 0.0, 0.0), R)
ENGINE = ShapeDistance(SHAPES["sphere"], FRAME)
TOUCH = {
    "mass": 0.045, "damping": 0.1, "friction": 0.26, "encoder": 55e-6, "delay": 0,
    "force_limit": 3.3, "hand_stiffness": 20.0, "hand_damping": 3.0, "press": 0.5,
}  # fmt: skip
OPTIONS = StressOptions(**TOUCH, loops=20, ticks=60_000)
SCALE = Scale(0.1, 400.0)


class Exact(Field):
    """The sphere, and what the controls below are made of."""

    def __init__(self, name="exact"):
        super().__init__(name, FRAME, 0)

    def answer(self, points):
        return self.spoil(points, *ENGINE.distance_and_normal(points))

    def spoil(self, points, distance, normal):
        return distance, normal


class Seam(Exact):
    """Half of it is a millimetre larger."""

    def spoil(self, points, distance, normal):
        return distance - 0.018 * (points[:, 0] > 0), normal


class Kink(Exact):
    """Four times as stiff below a depth."""

    def spoil(self, points, distance, normal):
        return np.where(distance < -0.02, 4 * distance + 0.06, distance), normal


class SignError(Exact):
    """Inside out at one end."""

    def spoil(self, points, distance, normal):
        return np.where(points[:, 2] > 0.8, -distance, distance), normal


class Turned(Exact):
    """The direction is ten degrees off: no gradient of anything."""

    def spoil(self, points, distance, normal):
        c, s = np.cos(np.radians(10)), np.sin(np.radians(10))
        return distance, normal @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


class Weak(Exact):
    """It gives way below a few millimetres."""

    def spoil(self, points, distance, normal):
        return distance, np.where(distance[:, None] < -0.1, -normal, normal)


class Hard(Exact):
    """Three hundred times as stiff as it should be."""

    def spoil(self, points, distance, normal):
        return 300 * distance, normal


class Tired(Exact):
    """Every call answers a little less."""

    calls = 0

    def spoil(self, points, distance, normal):
        self.calls += 1
        return distance * (1 - 1e-9 * self.calls), normal


class Gap(Exact):
    """No number next to an axis."""

    def spoil(self, points, distance, normal):
        return np.where(np.abs(points[:, 0]) < 1e-4, np.nan, distance), normal


class SinglePrecision(Exact):
    """Mesh units are rounded to float32 before the centre is taken off."""

    def distance_and_normal(self, points):
        return super().distance_and_normal(points.astype(np.float32).astype(np.float64))


class Nervous(Exact):
    """The eighth digit of a coordinate matters."""

    def spoil(self, points, distance, normal):
        return distance + 1e-3 * np.sin(1e9 * np.clip(points[:, 0], -2, 2)), normal


class Confident(Exact):
    """NaN is at the origin, and no flag says so."""

    def query(self, points):
        distance, normal = self.answer(np.nan_to_num(points, posinf=0, neginf=0))
        return Answer(distance, normal, np.full(len(points), OK, np.uint8))


class Capless(Exact):
    """A hundredth of the surface is not there: a cap of a ball has its share of the height."""

    def spoil(self, points, distance, normal):
        return np.where(normal[:, 2] > 0.98, 0.0, distance), normal


class Askew(Exact):
    """The direction is 45 degrees off on a twentieth of the surface, behind a smooth border."""

    def spoil(self, points, distance, normal):
        turn = np.radians(45) * np.clip((normal[:, 2] - 0.9) / 0.03, 0, 1)
        side = np.cross(normal, [0.0, 1.0, 0.0])
        return distance, np.cos(turn)[:, None] * normal + np.sin(turn)[:, None] * side


CONTROLS = {
    "missing": Capless,
    "other": Askew,
    "work": Turned,
    "stiffness": Kink,
    "jumps": Seam,
    "contacts": SignError,
    "hold": Weak,
    "closed_loop": Hard,
    "endurance": Tired,
    "invariance": SinglePrecision,
    "precision": Nervous,
    "special": Confident,
}


@pytest.fixture(scope="module")
def sphere():
    vertices, faces = SHAPES["sphere"].tessellation()
    return Suite(Body(vertices, faces, FRAME, shape="sphere"), SCALE, OPTIONS, seed=0)


@pytest.fixture(scope="module")
def tried(sphere):
    exact = Exact()
    exact.body, exact.engine = sphere.body, ENGINE
    return controls(exact, SCALE)


def test_the_exact_sphere_passes_everything(sphere, tried):
    arrays, attributes = stress([Exact()], tried, sphere, count=1, progress=silent_progress)
    assert attributes["failed"] == {"exact": []}
    # a ball has no walls, and so no control-thin
    assert attributes["controls"] == {"control-zero": ["missing"], "control-gap": ["missing"]}
    assert list(attributes["fields"]["exact"]) == list(QUESTIONS)
    assert arrays["holding_newtons"] == pytest.approx(400 * 0.05, rel=0.03)


def test_a_suite_that_passes_a_control_ends_its_stage(sphere):
    blind = Exact("control-blind")
    with pytest.raises(PandisError, match="the stress suite is blind.*control-blind"):
        stress([Exact()], [blind], sphere, count=1, progress=silent_progress)


@pytest.mark.slow
def test_two_at_a_time_find_what_one_does(sphere):
    fields = [Exact(), grid("tricubic", "distance", 24), Exact("again")]
    alone, beside = (
        stress(fields, [], sphere, count=count, progress=silent_progress)[1] for count in (1, 2)
    )
    assert alone == beside
    assert alone["fields"]["exact"] == alone["fields"]["again"] != alone["fields"]["tricubic-24"]


def test_questions_end_at_the_first_that_is_failed(sphere, tried):
    assert list(sphere.ask(tried[0], silent_progress, first=True)) == ["missing"]


@pytest.mark.parametrize("question", QUESTIONS)
def test_every_question_catches_its_control(sphere, question):
    found = sphere.ask(CONTROLS[question](), silent_progress)
    assert not found[question]["passed"], found[question]
    assert QUESTIONS[question].says(found[question])
    assert QUESTIONS[question].figure in found[question]


def test_what_is_no_number_is_caught(sphere):
    found = sphere.ask(Gap(), silent_progress)
    assert found["endurance"]["bad"] > 0
    assert not found["special"]["passed"]


def test_fields_that_need_a_path_are_skipped_with_a_reason(sphere):
    field = Exact("salisbury")
    field.ordered = True
    attributes = stress([field], [], sphere, count=1, progress=silent_progress)[1]
    assert attributes["fields"] == {}
    assert "path" in attributes["skipped"]["salisbury"]


# --- known figures ----------------------------------------------------------------------


def grid(kind, content, size):
    made = DenseGrid(ENGINE, content, size, band=(0.09, 0.02), progress=silent_progress)
    values = np.concatenate(list(made.slabs(8)))
    held = artifact("grid", {"values": values}, made.attributes() | FRAME.attributes())
    return open_as(kind, held, f"{kind}-{size}")


def test_loop_work_is_that_of_the_literature_notes(sphere):
    """0.75, 0.021 and 4e-16 at 32³, 0.36 and 0.0033 at 64³; how loops are drawn is left open."""
    rng = np.random.default_rng(3)
    feet, outward = sphere.body.surface.draw(100, rng)[:2]
    places = Stratified(feet, outward, np.full(100, R), np.full(100, 0.01), np.ones(100, bool))
    paths = loops(places, ENGINE, rng)

    def share(field):
        found = loop_work(field.answer, paths)[0]
        return np.sqrt((found**2).mean()) / (np.mean(DEPTHS) ** 2 / 2)

    assert share(Exact()) < 2e-15
    assert 0.75 / 2 < share(grid("nearest", "force", 32)) < 0.75 * 2
    assert 0.36 / 2 < share(grid("nearest", "force", 64)) < 0.36 * 2
    assert 0.021 < share(grid("trilinear", "force", 32)) < 0.021 * 6
    assert 0.0033 / 2 < share(grid("trilinear", "force", 64)) < 0.0033 * 3


@pytest.mark.parametrize(("late", "wanted"), [(0, 200), (1, 67), (2, 40)])
def test_largest_stable_stiffness_is_that_of_the_theory(late, wanted):
    """b / (T/2 + n·T) at b = 0.1 Ns/m, T = 1 ms."""
    bare = {"friction": 0.0, "encoder": 0.0, "hand_stiffness": 0.0, "hand_damping": 0.0}
    device = Device(**TOUCH | bare | {"delay": late, "force_limit": 1e9})

    def wall(points):
        normal = np.zeros_like(points)
        normal[:, 2] = 1
        return points[:, 2], normal

    stiffness = wanted * np.array([0.93, 1.07])
    point, normal = np.zeros((2, 3)), np.tile([0.0, 0, 1], (2, 1))
    start = -0.9 * device.press / stiffness[:, None]  # in contact: theory knows no leaving
    press = np.full(2, device.press)
    loop = Loop(wall, SCALE, device)
    found = simulate(loop, (point, normal), stiffness, press=press, ticks=12_000, start=start)
    assert found.swing[0] < 1e-4
    assert found.swing[1] > 1e-4
    assert found.share[0] == pytest.approx(1, abs=1e-2)
    assert found.energy[1] < 0  # the wall gives what damping takes


def test_friction_lets_a_wall_be_stiffer():
    device = Device(**TOUCH | {"hand_damping": 0.0})
    places = Stratified(
        R * np.eye(3), np.eye(3), np.full(3, R), np.full(3, 1 / 3), np.ones(3, bool)
    )
    found = []
    for friction in (0.0, 0.26):
        one = device._replace(friction=friction)
        exact = ENGINE.distance_and_normal
        wanted = wanted_force(exact, places, SCALE, device=one)
        found.append(stable_stiffness(Loop(exact, SCALE, one), places, wanted))
    assert found[0] < 300
    assert found[1] >= 1000
    assert set(found) <= {0.0, *(LADDER * 400)}


def test_stiffness_of_a_sphere_is_known():
    """Normal k; tangential k·d/(R − d), a push to the side."""
    depth = np.array([0.01, 0.1, 0.3])
    points = (R - depth)[:, None] * np.array([0.6, 0.0, 0.8])
    found = np.linalg.eigvalsh(jacobians(ENGINE.distance_and_normal, points, 1e-5))
    assert found[:, 0] == pytest.approx(-1, abs=1e-6)
    assert found[:, 1:] == pytest.approx(np.repeat((depth / (R - depth))[:, None], 2, 1), rel=1e-6)


def test_a_plate_holds_half_its_thickness():
    vertices, faces = box_mesh()
    plate = (vertices - vertices.mean(axis=0)) / np.ptp(vertices, axis=0) * [1.8, 1.8, 0.1]
    engine = MeshDistance(plate, faces)
    places = Stratified(
        np.array([[0.1, 0.2, 0.05]]), np.eye(3)[2:], np.array([0.05]), np.ones(1), np.ones(1, bool)
    )
    found = holding(engine.distance_and_normal, places, SCALE, device=Device(**TOUCH))
    assert found == pytest.approx(400 * 0.05 / SCALE.metre, rel=0.05)  # to a step of the ray
    assert found <= 400 * 0.05 / SCALE.metre


def test_a_walk_stays_in_the_box_and_goes_at_its_pace():
    chunks = list(walk(CHUNK + 500, np.random.default_rng(0)))
    assert [len(chunk) for chunk in chunks] == [CHUNK, 500]
    path = np.concatenate(chunks)
    assert np.abs(path).max() <= 1
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert np.sqrt((steps**2).mean()) == pytest.approx(0.018, rel=0.02)
    assert (path.min(axis=0) < -0.5).all()
    assert (path.max(axis=0) > 0.5).all()


@pytest.mark.slow
def test_same_seed_same_figures(sphere):
    again = Suite(sphere.body, SCALE, OPTIONS, seed=0)
    field = grid("tricubic", "distance", 24)
    assert again.ask(field, silent_progress) == sphere.ask(field, silent_progress)
    assert np.abs(penalty_force(*field.answer(again.shell.points))).max() > 0


def test_contacts_tell_what_is_hollow_and_what_is_wrong_deep_inside(sphere):
    class Hollow(Exact):
        def spoil(self, points, distance, normal):
            return np.where((points[:, 1] > 0.5) & (distance < 0), 0.0, distance), normal

    class Shallow(Exact):
        def spoil(self, points, distance, normal):
            return np.maximum(distance, -0.3), normal

    def told(field):
        rng = np.random.default_rng(0)
        return ghosts(field.answer, sphere.body, 200_000, scale=SCALE, rng=rng)

    assert (told(Exact())["hollow"], told(Exact())["core"]) == (0, 0)
    cap, ball = 0.4**2 * (3 * R - 0.4) / 4, R**3  # the volumes, over 4 pi / 3
    assert told(Hollow())["hollow"] == pytest.approx(cap / ball, rel=0.03)
    # no force beyond that at 0.3: the mean of what is missing, over that of the depth below 0.04
    missing, depth = 0.6**4 / 12, R * 0.86**3 / 3 - 0.86**4 / 4
    assert told(Shallow())["core"] == pytest.approx(missing / depth, rel=0.03)


def test_the_exact_forces_own_changes_are_told():
    """Across the crease between two walls of a cube: the depth, times the root of two."""

    def cube(points):
        axis = np.abs(points).argmax(axis=1)
        normal = np.zeros_like(points)
        normal[np.arange(len(points)), axis] = np.sign(points[np.arange(len(points)), axis])
        return np.abs(points).max(axis=1) - R, normal

    points = np.tile([R - 0.02, R - 0.02 - 1e-4, 0.1], (20, 1))
    along = np.tile(np.array([-1.0, 1.0, 0.0]) / np.sqrt(2), (20, 1))
    shell = Shell(points, np.full(20, 1 / 20))
    found = jumps(cube, cube, shell, along=along, scale=SCALE, device=Device(**TOUCH))
    wanted = 0.02 * np.sqrt(2) * SCALE.newtons
    assert found["exact_max"] == pytest.approx(wanted, rel=0.1)
    assert found["exact_max"] == found["mm01_max"]
    assert (found["jumps"], found["worst_n"]) == (0, pytest.approx(0, abs=1e-9))
