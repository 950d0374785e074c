"""A field's surface as a mesh for display: surface nets on a lattice, moved onto the zero set."""

from itertools import product

import numpy as np

from pandis.base.frame import UNIT_SIDE
from pandis.engine.packing.unpacking import unpack
from pandis.runtime.field import NativeField
from pandis.runtime.field.constants import COMPACT, MESH
from pandis.runtime.field.files import read_contents

#: Cells along each axis of the box, and along a block.
CELLS, BLOCK = 96, 8
#: Largest number of faces of an exact mesh that a page can rotate smoothly.
FACES = 100_000
_CORNERS = np.array(list(product((0, 1), repeat=3)))
_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8)
          if abs(_CORNERS[a] - _CORNERS[b]).sum() == 1]  # fmt: skip


def surface_of(field: NativeField) -> tuple[np.ndarray, np.ndarray]:
    """Return corners (V, 3), unit frame, and faces (F, 3) of a field's surface.

    For an exact or a compact field with at most `FACES` faces this is its mesh. For all others the
    corners are on the zero set of the distance.
    """
    if field.kind in (MESH, COMPACT) and field.path.is_file():
        corners, faces = _mesh_of(field)
        if len(faces) <= FACES:
            return corners, faces
    corners, faces = _nets(_values(field))
    return _onto(field, corners), faces


def _mesh_of(field):
    """Return corners (V, 3), unit frame, and faces (F, 3) of the mesh in a field's file."""
    contents = read_contents(field.path)
    sections = contents.sections
    if field.kind == MESH:
        faces = np.frombuffer(sections["FACE"], "<i4").reshape(-1, 3)
        return np.frombuffer(sections["VERT"], "<f8").reshape(-1, 3), faces
    arrays = {"blocks": sections["BLCK"], "packed": sections["PACK"]}
    steps, faces = unpack({name: np.frombuffer(part, np.uint8) for name, part in arrays.items()})
    return steps * (UNIT_SIDE / ((1 << contents.wholes[0]) - 1)) - UNIT_SIDE / 2, faces


def _values(field):
    """Return distances (CELLS + 1)³ at lattice nodes; far from the surface only signs are right."""
    at = np.linspace(-1, 1, CELLS + 1)
    values = np.empty((CELLS + 1,) * 3)
    step = 2 / CELLS
    middle = at[:-1].reshape(-1, BLOCK).mean(axis=1) + step / 2
    grid = np.stack(np.meshgrid(middle, middle, middle, indexing="ij"), axis=-1)
    distance = _distance(field, grid.reshape(-1, 3)).reshape(grid.shape[:3])
    # an exact distance has slope 1 at most; those of networks and splines are a little steeper
    near = np.abs(distance) < 1.25 * (0.5 * BLOCK + 1) * step * np.sqrt(3)
    known = np.zeros(values.shape, bool)
    for i, j, k in np.ndindex(distance.shape):
        block = tuple(slice(BLOCK * n, BLOCK * n + BLOCK + 1) for n in (i, j, k))
        if near[i, j, k]:
            known[block] = True
        else:
            values[block] = distance[i, j, k]
    where = np.argwhere(known)
    values[known] = _distance(field, at[where])
    return values


def _distance(field, points):
    answer = field.query(field.frame.to_mesh(points))
    return np.where(answer.flag == 2, 1.0, answer.distance * field.frame.scale)


def _nets(values):
    """Return a corner for each cell that the surface crosses, and two faces per crossed edge."""
    inside = values < 0
    cells = tuple(n - 1 for n in values.shape)
    parts = [inside[tuple(slice(c, c + n) for c, n in zip(corner, cells, strict=True))]
             for corner in _CORNERS]  # fmt: skip
    passed = np.logical_or.reduce(parts) & ~np.logical_and.reduce(parts)
    where = np.argwhere(passed)
    number = np.full(cells, -1)
    number[tuple(where.T)] = np.arange(len(where))
    at = np.stack([values[tuple((where + corner).T)] for corner in _CORNERS], axis=1)
    total, count = np.zeros((len(where), 3)), np.zeros(len(where))
    for a, b in _EDGES:
        crossed = (at[:, a] < 0) != (at[:, b] < 0)
        share = at[crossed, a] / (at[crossed, a] - at[crossed, b])
        total[crossed] += _CORNERS[a] + share[:, None] * (_CORNERS[b] - _CORNERS[a])
        count[crossed] += 1
    corners = (where + total / count[:, None]) * 2 / CELLS - 1
    faces = []
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        low, high = np.take(inside, range(CELLS), axis), np.take(inside, range(1, CELLS + 1), axis)
        edges = np.argwhere(low != high)
        edges = edges[
            (edges[:, [one, two]] > 0).all(axis=1) & (edges[:, [one, two]] < CELLS).all(1)
        ]
        around = []
        for back in ((1, 1), (0, 1), (0, 0), (1, 0)):
            cell = edges.copy()
            cell[:, one] -= back[0]
            cell[:, two] -= back[1]
            around.append(number[tuple(cell.T)])
        quad = np.stack(around, axis=1)
        outward = low[tuple(edges.T)]
        quad[~outward] = quad[~outward, ::-1]
        faces += [quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]
    return corners, np.concatenate(faces)


def _onto(field, corners):
    """Move corners onto the zero set of a field, by at most half a cell in each of two rounds."""
    for _ in range(2):
        answer = field.query(field.frame.to_mesh(corners))
        way = -answer.distance[:, None] * answer.normal * field.frame.scale
        way[~np.isfinite(way)] = 0
        length = np.linalg.norm(way, axis=1, keepdims=True)
        corners = corners + way * np.minimum(1, 1 / CELLS / np.maximum(length, 1e-12))
    return corners
