"""The coarse spline that a network adds to: what it is, and what the network is with it."""

import numpy as np
import pytest

from pandis.base.forces import penalty_force
from pandis.base.frame import UNIT
from pandis.base.progress import Context
from pandis.pipeline.kinds.network.base import fit_base
from pandis.pipeline.kinds.network.reference import SirenField
from pandis.pipeline.kinds.network.spec import TrainTask
from pandis.pipeline.kinds.network.training.trainer import Trainer
from pandis.pipeline.run.ask.recipes import ExactRecipe
from pandis.pipeline.run.job.stage import silent_progress
from support import artifact
from test_training import samples  # noqa: F401  (a fixture)

POINTS = np.random.default_rng(0).uniform(-1, 1, (20_000, 3))


class Cubic:
    """An engine whose distance is a polynomial that the spline can be."""

    def value(self, points):
        x, y, z = points.T
        return 1 + x - 2 * y * z + x**3 - y**2 * z**3 + x**2 * y**3

    def distance_and_normal(self, points):
        return self.value(points), None


def test_it_reproduces_cubic_polynomials():
    base = fit_base(Cubic(), 6)
    value, gradient = base.evaluate(POINTS)
    assert np.abs(value - Cubic().value(POINTS)).max() < 2e-6
    x, y, z = POINTS.T
    wanted = [1 + 3 * x**2 + 2 * x * y**3, -2 * z - 2 * y * z**3 + 3 * x**2 * y**2]
    wanted.append(-2 * y - 3 * y**2 * z**2)
    assert np.abs(gradient - np.stack(wanted, 1)).max() < 2e-5


def test_it_answers_up_to_the_faces_of_the_box():
    base = fit_base(Cubic(), 6)
    corners = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), -1).reshape(-1, 3)
    assert np.abs(base.evaluate(corners)[0] - Cubic().value(corners)).max() < 5e-6


def field(samples, tmp_path, **options):  # noqa: F811
    """Train a small network on the sphere; open it as a field."""
    small = {"width": 32, "depth": 2, "steps": 200, "batch": 1024, "threads": 1}
    own = TrainTask(kind="network", name="r", recipe=ExactRecipe(**small | options), seed=7)
    trainer = Trainer(own, samples, Context(tmp_path / "c.pt", silent_progress, lambda text: None))
    arrays, attributes = trainer.run()
    attributes |= UNIT.attributes()
    return SirenField("r", artifact("model", arrays, attributes))


def contacts(field):
    """Return the forces of a field well outside of the sphere, and its errors inside."""
    radius = np.linalg.norm(POINTS, axis=1)
    free = penalty_force(*field.answer(POINTS[radius > 0.905]))
    inside = POINTS[(radius < 0.9) & (radius > 0.3)]
    depth = 0.9 - np.linalg.norm(inside, axis=1)
    exact = depth[:, None] * inside / np.linalg.norm(inside, axis=1)[:, None]
    off = np.linalg.norm(penalty_force(*field.answer(inside)) - exact, axis=1)
    return np.linalg.norm(free, axis=1), off.mean() / depth.mean()


@pytest.mark.parametrize("direction", ["gradient", "output"])
def test_no_contact_in_free_space_and_a_force_deep_inside(samples, tmp_path, direction):  # noqa: F811
    ghosts, core = contacts(field(samples, tmp_path, direction=direction))
    assert ghosts.max() == 0
    assert core < 0.05


def test_the_network_alone_makes_contacts_in_free_space(samples, tmp_path):  # noqa: F811
    ghosts, core = contacts(field(samples, tmp_path, base=None))
    assert (ghosts > 0).mean() > 0.02
    assert core > 0.3


def test_bytes_count_the_base(samples, tmp_path):  # noqa: F811
    with_base, alone = (field(samples, tmp_path, steps=1, base=cells) for cells in (8, None))
    assert with_base.bytes - alone.bytes == 11**3 * 4


def test_default_network_and_base_are_as_large_as_the_papers():
    options = ExactRecipe()
    width, cells = options.width, options.base
    weights = 3 * width + (options.depth - 1) * width**2 + width
    assert 770_000 < 4 * (weights + options.depth * width + 1 + (cells + 3) ** 3) < 797_712
