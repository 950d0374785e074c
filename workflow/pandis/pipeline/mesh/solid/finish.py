"""Places the sides of sheets and caps, simplifies the surface, and says what was invented."""

from typing import NamedTuple

import numpy as np

from pandis.engine.faces import crossings
from pandis.engine.solid import (
    AT_CORNER,
    FINENESS,
    NO_ROOM,
    ON_CAP,
    ON_DOOR,
    ON_SHEET,
    simplified,
)
from pandis.pipeline.mesh.diagnosis import FLAT, altitudes
from pandis.pipeline.mesh.nesting import signed_volumes
from pandis.pipeline.mesh.topology import compact, crossing_faces
from pandis.pipeline.mesh.tree import MeshTree
from pandis.pipeline.run.records.mesh import SolidFacts

#: Kinds of components: the source's own surface; closed by caps or doors; several surfaces as one;
#: a sheet that was given a thickness.
KINDS = ("closed", "filled", "solid", "sheet")
#: Rounds of smoothing for doors, which are steps at first.
_SMOOTHING = 10
#: Sides of sheets farther than this from the source stay where they are, cells.
_REACH = 1.6
#: Corners farther than this from the source go back to it, cells: in a thin part, planes of both
#: sides meet beside it.
_OFF = 0.05
#: The mean distance of merged vertices, as a share of the tolerance: some are farther.
_MEAN = 0.5
#: Attempts at a surface without crossing faces, and the width of the surroundings that are locked.
_ATTEMPTS, _NEAR = 12, 2.0
#: Twice the area from which a face's vertices stay at their targets, square cells: see areas.h.
_LEAST_AREA = 1e-6
#: Volume of the smallest component, cubic cells: rounding could turn a flatter one inside out.
_LEAST_VOLUME = 1e-6
#: Rounds in which vertices of crossing faces go back.
_ROUNDS = 12
#: What is left of their way after the first time: the two sides of a thin part end at its rim, and
#: a small part of the way back parts them.
_FIRST_BACK = 0.83
#: Maximum numbers of caps, doors and components listed, the largest first.
LISTED = 20
#: Thickness from which a thin solid of a closed source is drawn as it is, cells.
_THIN = 0.02
#: A component is a sheet if more than this share of its vertices belong to sheets.
_MOSTLY = 0.5


class Solid(NamedTuple):
    """A solid, and what was invented for it.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3), float64, mesh units
    faces : ndarray, shape (F, 3), int64
    facts : pandis.pipeline.run.records.mesh.SolidFacts
    """

    vertices: np.ndarray
    faces: np.ndarray
    facts: SolidFacts


def finish(boundary, source, rules, *, parts, rooms, caps):
    """Return the `Solid` of a boundary.

    Parameters
    ----------
    boundary : pandis.engine.solid.Boundary
    source : pandis.pipeline.mesh.solid.source.Source
    rules : pandis.pipeline.mesh.solid.SolidRules
    parts : pandis.engine.solid.Parts
    rooms : pandis.pipeline.mesh.solid.rooms.Rooms
    caps : list of float
        Widths of the rims that caps close, mesh units.
    """
    frame = source.frame
    small = (parts.volume > 0) & (parts.volume < rules.debris * parts.volume.clip(0).sum())
    facts = SolidFacts(
        cells=rules.cells,
        cell=frame.cell,
        rooms=len(rooms.solid) - 1,
        opened=rooms.opened,
        cavities=rooms.cavities,
        caps=sorted(caps, reverse=True)[:LISTED],
        doors=[width * frame.cell for width in rooms.doors[:LISTED]],
        invented=parts.invented,
        sheets=parts.sheets,
        thickness=rules.thickness * frame.cell,
        simplified=rules.tolerance,
        **_components(
            boundary, parts, np.float64(frame.cell) ** 3, small=small, buried=rooms.buried
        ),
    )
    if small.any():
        boundary = boundary._replace(
            faces=boundary.faces[~small[boundary.part[boundary.faces[:, 0]]]]
        )
    places = _sound(boundary, _placed(boundary, source, rules.thickness))
    mesh = _without_crossings(
        boundary, places, frame, tolerance=rules.tolerance, volume=parts.volume
    )
    return Solid(*mesh, facts)


def _components(boundary, parts, scale, *, small, buried):
    """Return the number of components of each kind, the largest, and those dropped."""
    count = len(parts.faces)

    def vertices_of(chosen):
        return np.bincount(boundary.part[chosen], minlength=count)

    in_sheet = boundary.room == NO_ROOM
    sheet = vertices_of(in_sheet) > _MOSTLY * np.bincount(boundary.part, minlength=count)
    filled = vertices_of(np.isin(boundary.origin, (ON_CAP, ON_DOOR))) > 0
    several = vertices_of(~in_sheet & buried[boundary.room]) > 0
    which = np.select([sheet, filled, several], [3, 1, 2], 0)
    order = np.argsort(-np.abs(parts.volume), kind="stable")

    def listed(chosen):
        return [
            {
                "kind": KINDS[which[k]],
                "faces": int(parts.faces[k]),
                "volume": float(parts.volume[k] * scale),
            }
            for k in order[chosen[order]][:LISTED]
        ]

    kinds = np.bincount(which[~small], minlength=len(KINDS)).tolist()
    return {
        "kinds": {kind: n for kind, n in zip(KINDS, kinds, strict=True) if n},
        "components": listed(~small),
        "dropped": listed(small),
    }


def _placed(boundary, source, thickness):
    """Return places (V, 3) of the vertices, with sides, corners and doors where they belong."""
    places = boundary.places.copy()
    door = np.flatnonzero(boundary.origin == ON_DOOR)
    if len(door):
        places = _smoothed(places, boundary.faces, door)
    side = np.flatnonzero(np.isin(boundary.origin, (ON_SHEET, AT_CORNER)))
    if not len(side):
        return places
    tree = MeshTree(source.frame.to_cells(source.vertices), source.faces)
    closest, _ = tree.closest(places[side])
    distance = np.linalg.norm(places[side] - closest, axis=1)
    corner = boundary.origin[side] == AT_CORNER
    near = (distance > _OFF * corner) & (distance < _REACH)
    side, distance, closest = side[near], distance[near], closest[near]
    outward = (places[side] - closest) / distance[:, None]
    offset = np.where(corner[near], 0, thickness / 2)
    if source.closed:  # between two layers of the source, a thin solid is as thick as it is
        depth = closest - _THIN * outward
        offset[offset > 0] *= tree.windings(depth[offset > 0]) <= 0.75
    places[side] = closest + np.minimum(offset, distance)[:, None] * outward
    return places


def _smoothed(places, faces, chosen):
    """Move chosen vertices halfway to the mean of their neighbours, several times."""
    from scipy.sparse import coo_array  # slow to import, and few solids have doors

    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    row = np.full(len(places), -1)
    row[chosen] = np.arange(len(chosen))
    edges = edges[row[edges[:, 0]] >= 0]
    shape = (len(chosen), len(places))
    mean = coo_array((np.ones(len(edges)), (row[edges[:, 0]], edges[:, 1])), shape=shape).tocsr()
    count = mean.sum(axis=1)[:, None]
    places = places.copy()
    for _ in range(_SMOOTHING):
        places[chosen] = (places[chosen] + mean @ places / count) / 2
    return places


def _sound(boundary, target):
    """Return places (V, 3) near the targets, where no faces cross.

    Vertices of crossing faces go back towards the lattice, where no faces cross: a small part of
    the way, then by halves; with their neighbours after some rounds.
    """
    moved = (target != boundary.places).any(axis=1)
    share, faces = moved.astype(float), boundary.faces
    question, places = moved[faces].any(axis=1), target
    if not moved.any():
        return target
    for turn in range(_ROUNDS):
        places = boundary.places + share[:, None] * (target - boundary.places)
        places = np.round(places * FINENESS) / FINENESS
        around = _near(places, faces[question].reshape(-1))[faces].any(axis=1)
        back = np.zeros(len(places), bool)
        pairs = crossings(places, faces[around], question[around])
        back[faces[around][pairs.reshape(-1)]] = True
        back[faces[question][_without_area(places[faces[question]])]] = True
        if turn > _ROUNDS // 3:
            back[faces[back[faces].any(axis=1)]] = True
        back &= share > 0
        if not back.any():
            break
        slower = np.where(share[back] == 1, _FIRST_BACK, share[back] / 2)
        share[back] = np.where((share[back] > 0.2) & (turn < _ROUNDS // 2), slower, 0.0)
        question = back[faces].any(axis=1)
    return places


def _without_area(corners):
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.einsum("ij,ij->i", normal, normal) < _LEAST_AREA**2


def _without_crossings(boundary, places, frame, *, tolerance, volume):
    """Return vertices (mesh units) and faces without self-intersections, simplified.

    Where simplified faces cross, the vertices around them are locked, and it starts again. What
    still crosses in exact arithmetic goes back to the lattice.
    """
    locked, vertices = np.zeros(len(places), bool), frame.to_mesh(places)
    for attempt in range(_ATTEMPTS):
        faces = boundary.faces
        if tolerance:
            faces = simplified(places, faces, locked=locked, tolerance=tolerance * _MEAN)
        faces = faces.astype(np.int64)
        mesh = compact(vertices, faces)
        pairs = crossing_faces(*mesh)
        flat = altitudes(places[faces])[0] <= FLAT  # in cells, where nothing underflows
        turned = _turned(boundary.part, places, faces, volume=volume)
        bad = np.concatenate([pairs.reshape(-1), np.flatnonzero(flat), np.flatnonzero(turned)])
        bad = faces[bad].reshape(-1)
        if not len(bad):
            return mesh
        near = _near(places, bad)
        if attempt >= _ATTEMPTS // 3:
            near = _near(places, near)
        back = near & locked & (places != boundary.places).any(axis=1)
        places[back] = boundary.places[back]
        vertices[back] = frame.to_mesh(places[back])
        locked |= near
    return compact(frame.to_mesh(boundary.places), boundary.faces.astype(np.int64))


def _turned(part, places, faces, *, volume):
    """Return a mask of the faces of components that are flat or inside out, and were not before."""
    label = part[faces[:, 0]]
    now = signed_volumes(places, faces, label, count=len(volume))
    least = np.minimum(_LEAST_VOLUME, np.abs(volume) / 2)  # some are tiny from the beginning
    return (now * np.sign(volume) < least)[label]


def _near(places, chosen):
    """Return a mask of the vertices in and around the cells of chosen ones, `_NEAR` cells wide."""
    cells = (places / _NEAR).astype(np.int64) + 1
    marks = np.zeros(cells.max(axis=0) + 2, bool)
    marks[tuple(cells[chosen].T)] = True
    for axis in range(3):
        rows = np.moveaxis(marks, axis, 0)
        rows[1:-1] |= rows[:-2] | rows[2:]
    return marks[tuple(cells.T)]
