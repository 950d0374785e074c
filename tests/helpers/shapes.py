"""Thin shapes that a mean error is fooled by, generated: plates, fins, blades, sheets, rods."""

from functools import cache

import numpy as np
import trimesh

from pandis.base.frame import Frame
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.mesh import tools
from support import artifact


class Shape:
    """A mesh with everything that is measured on it."""

    def __init__(self, mesh):
        self.mesh, self.body = mesh, Body.open(mesh)
        self.engine, self.surface = self.body.distance, self.body.surface
        self.frame = self.body.frame


def box(sides, cuts):
    """Return a box of given sides (mm), each face cut into cells of about ``cuts`` mm."""
    counts = np.maximum(np.rint(np.asarray(sides) / cuts).astype(int), 1)
    axes = [np.linspace(-s / 2, s / 2, n + 1) for s, n in zip(sides, counts, strict=True)]
    parts = []
    for axis in range(3):
        u, v = (axes[(axis + k) % 3] for k in (1, 2))
        for side in (-1, 1):
            points = np.zeros((len(u), len(v), 3))
            points[..., axis] = side * sides[axis] / 2
            points[..., (axis + 1) % 3] = u[:, None]
            points[..., (axis + 2) % 3] = v
            grid = np.arange(len(u) * len(v)).reshape(len(u), len(v))
            a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
            quads = np.stack([a, b, c, d], axis=-1).reshape(-1, 4)
            faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
            faces = faces if side > 0 else faces[:, ::-1]
            parts.append(trimesh.Trimesh(points.reshape(-1, 3), faces, process=False))
    whole = trimesh.util.concatenate(parts)
    whole.merge_vertices()
    return whole


def cone(sectors):
    """Return vertices and faces of a cone (unit frame), both of whose ends are fans.

    The boxes around the narrow faces of its side all hold the middle of its base.
    """
    mesh = trimesh.creation.cone(0.5, 1.8, sections=sectors)
    return np.asarray(mesh.vertices) - (0, 0, 0.9), np.asarray(mesh.faces, np.int32)


def union(parts):
    """Return the exact union of closed meshes, as the repair makes it."""
    whole = trimesh.util.concatenate(parts)
    arrays = np.asarray(whole.vertices, float), np.asarray(whole.faces, np.int64)
    found = tools.call("union", *arrays, seconds=120, memory_gb=3)
    return trimesh.Trimesh(*found, process=False)


def plate(thickness, cuts=4.0):
    """A plate of 100 mm."""
    return box((100.0, 100.0, thickness), cuts)


def finned_ball(thickness=0.4, cuts=2.0):
    """A ball of 50 mm with two fins of 0.40 mm: a third of its surface."""
    ball = trimesh.creation.icosphere(4, 25.0)
    fins = [box((thickness, 100.0, 30.0), cuts), box((thickness, 30.0, 100.0), cuts)]
    fins[1].apply_translation([9.0, 0, 0])
    return union([ball, *fins])


def blade():
    """A sword's blade: a rhombus of 0.25 mm to 3 mm, tapering over its length of 100 mm."""
    along = np.linspace(-50, 50, 81)
    share = 0.08 + 0.92 * (50 - along) / 100
    ring = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]], float)
    points = [np.column_stack([5 * s * ring[:, 0], 1.5 * s * ring[:, 1], np.full(4, z)])
              for s, z in zip(share, along, strict=True)]  # fmt: skip
    faces = []
    for k in range(len(along) - 1):
        for i in range(4):
            a, b = 4 * k + i, 4 * k + (i + 1) % 4
            faces += [[a, b, b + 4], [a, b + 4, a + 4]]
    end = 4 * (len(along) - 1)
    faces += [[0, 2, 1], [0, 3, 2], [end, end + 1, end + 2], [end, end + 2, end + 3]]
    return trimesh.Trimesh(np.concatenate(points), faces, process=False)


def bent_sheet(thickness=1.5):
    """A sheet of 100 mm, bent to a quarter of a circle."""
    sheet = box((100.0, 60.0, thickness), 2.0)
    x, y, z = sheet.vertices.T
    radius = 100 / (np.pi / 2)
    angle = x / radius
    sheet.vertices = np.column_stack(
        [(radius + z) * np.sin(angle), y, (radius + z) * np.cos(angle)]
    )
    return sheet


def cage(rod=2.0):
    """A cage of rods: the edges of a cube, 100 mm."""
    rods, half = [], 50 - rod / 2
    for axis in range(3):
        for one in (-half, half):
            for other in (-half, half):
                sides = np.full(3, rod)
                sides[axis] = 100.0
                own = box(sides, 2.0)
                move = np.zeros(3)
                move[(axis + 1) % 3], move[(axis + 2) % 3] = one, other
                rods.append(own.apply_translation(move))
    return union(rods)


MADE = {
    "plate-0.3": lambda: plate(0.3),
    "plate-0.6": lambda: plate(0.6),
    "plate-1": lambda: plate(1.0),
    "plate-2": lambda: plate(2.0),
    "finned-ball": finned_ball,
    "blade": blade,
    "bent-sheet": bent_sheet,
    "cage": cage,
}
SHAPES = tuple(MADE)


@cache
def open_shape(name):
    """Return one of the shapes by its name."""
    return opened(MADE[name]())


def opened(mesh):
    """Return a mesh of trimesh with everything that is measured on it."""
    vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int32)
    assert mesh.is_watertight
    assert mesh.volume > 0
    frame = Frame.of_bounds(vertices.min(axis=0), vertices.max(axis=0))
    arrays = {"vertices": vertices, "faces": faces}
    return Shape(artifact("mesh", arrays, {"shape": None, **frame.attributes()}))
