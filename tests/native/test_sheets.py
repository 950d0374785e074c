"""A creased sheet lets no proxy through: 0.05 % of its size as thickness or as radius suffice."""

import itertools
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

from bodies import UNIT, field_of

from pandis.base.frame import UNIT_SIDE
from pandis.pipeline.geometry.body import Body
from pandis.runtime.contact import Material, NativeContact
from pandis.runtime.scene import Placed

#: Folds of the sheet, presses on each, and the share of its size that holds.
FOLDS, PRESSES, HOLDS = 14, 60, 5e-4 * UNIT_SIDE
#: How near each press comes to the sheet, unit frame.
NEAR = 1e-3
#: The sheet spans the unit frame; farther out a proxy may slide around its rim.
RIM = 0.87


def profile(rng):
    """Return the corners (n, 2) of a folded line, x and z."""
    z = np.where(np.arange(FOLDS) % 2, 0.12, -0.05) + rng.uniform(-0.03, 0.03, FOLDS)
    return np.column_stack([np.linspace(-0.9, 0.9, FOLDS), z])


def sheet(line, thickness):
    """Return a sheet (`trimesh.Trimesh`) along y below a folded line; it rises by 0.1 y."""
    ring = np.concatenate([line, (line - [0, thickness])[::-1]])
    count, (x, z) = len(ring), ring.T
    ends = [np.column_stack([x, np.full(count, y), z + 0.1 * y]) for y in (-0.9, 0.9)]
    i = np.arange(count)
    j = (i + 1) % count
    sides = np.concatenate(
        [np.column_stack([i, j, count + j]), np.column_stack([i, count + j, count + i])]
    )
    a = np.arange(FOLDS - 1)
    b, c, d = a + 1, count - 2 - a, count - 1 - a
    cap = np.concatenate([np.column_stack([a, c, b]), np.column_stack([a, d, c])])
    faces = np.concatenate([sides, cap, cap[:, ::-1] + count])
    mesh = trimesh.Trimesh(np.concatenate(ends), faces, process=False)
    mesh.fix_normals()
    assert mesh.is_watertight
    return mesh


def path(rng):
    """Return the positions (n, 3) of a probe that is pressed below the sheet, slides, and rests."""
    places = np.array([*rng.uniform(-0.6, 0.6, 2), 0.5]) + np.zeros((5, 1))
    places[1:] += rng.uniform(-0.25, 0.25, (4, 3)) - [0, 0, 0.5]
    places[1:, 2] -= rng.uniform(0.05, 0.25, 4)
    parts = [places[:1]]
    for begin, end in itertools.pairwise(places):
        count = int(np.linalg.norm(end - begin) / 0.004) + 1
        parts += [np.linspace(begin, end, count + 1)[1:], np.repeat(end[None], 150, 0)]
    return np.concatenate(parts)


@pytest.mark.parametrize("kind", ["exact", "compact-16"])
@pytest.mark.parametrize(("thickness", "radius"), [(HOLDS, 0.0), (1e-5, HOLDS)])
def test_a_creased_sheet_lets_nothing_through(kind, thickness, radius):
    rng = np.random.default_rng(0)
    line = profile(rng)
    mesh = sheet(line, thickness)
    body = Body(np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32), UNIT)
    placed = Placed(field_of(body, kind), np.eye(3), np.zeros(3), 1.0, 400.0)
    for _ in range(PRESSES):
        friction = rng.choice([0, 0.3])
        contact = NativeContact(placed, radius, material=Material(friction, friction, 0, 0))
        contact.set(budget=int(rng.choice([8, 24])))
        proxy = contact.follow(path(rng)).proxy
        beyond = (np.abs(proxy[:, :2]) > RIM).any(1)
        proxy = proxy[: beyond.argmax() if beyond.any() else None]
        above = proxy[:, 2] - np.interp(proxy[:, 0], *line.T) - 0.1 * proxy[:, 1]
        assert -thickness / 2 < above.min() < 2 * radius + NEAR  # it came there, and no farther
