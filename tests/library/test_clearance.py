"""The margins of a file: what a search from the worst points finds between those looked at."""

import numpy as np

from pandis.base.frame import Frame
from pandis.pipeline.geometry.distance import ShapeDistance
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.kinds.clearance import MORE, clearance
from pandis.pipeline.kinds.field import BOUND, OK
from support import artifact

FRAME = Frame((0.0, 0.0, 0.0), 0.9)
ENGINE = ShapeDistance(SHAPES["sphere"], FRAME)
MESH = artifact("mesh", {}, {"shape": "sphere", **FRAME.attributes()})


def margins(error, flag=OK):
    """Return both margins of a field that errs by ``error`` at points, in free space."""

    def answer(points):
        distance = ENGINE.distance_and_normal(points)[0]
        return distance + error(points), np.full(len(points), flag, np.uint8)

    return clearance(answer, ENGINE)[6:8]


def test_a_narrow_peak_between_the_points_is_climbed():
    """A bump of 0.02, as wide as the points are apart: its top is what a probe may meet."""
    top = np.array([0.0, 0.0, 0.97])

    def bump(points):
        return 0.02 * np.exp(-(((points - top) / 0.012) ** 2).sum(axis=1))

    measured, bound = margins(bump)
    assert measured >= 0.99 * MORE * 0.02
    assert bound < 1e-8
    measured, bound = margins(bump, BOUND)
    assert bound >= 0.99 * MORE * 0.02
    assert measured < 1e-8


def test_a_ghost_contact_counts_in_both():
    """Where the field says inside though points are up to 0.1 outside."""

    def ghost(points):
        near = np.linalg.norm(points - [0.95, 0, 0], axis=1) < 0.06
        return np.where(near, -0.2, 0.0)

    measured, bound = margins(ghost)
    assert measured >= MORE * 0.05
    assert bound >= MORE * 0.05


def test_bounds_tell_how_near_a_surface_is():
    """A field that is flagged from 0.02 above its surface on, and knows no more than that."""

    def answer(points):
        distance = ENGINE.distance_and_normal(points)[0]
        flag = np.where(distance > 0.02, BOUND, OK).astype(np.uint8)
        return np.where(distance > 0.02, 0.02 + 0.2 * (distance - 0.02), distance), flag

    height = clearance(answer, ENGINE)[8]
    assert 0.95 * 0.02 < height <= 0.02
