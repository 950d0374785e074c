"""Places the sides of sheets and caps, has the surface simplified, and says what was invented."""

from typing import NamedTuple

import numpy as np

from pandis.engine.faces import crossings
from pandis.engine.solid import AT_CORNER, FINENESS, NO_ROOM, ON_CAP, ON_DOOR, ON_SHEET
from pandis.pipeline.mesh.solid.simplification import near, simplify, touching
from pandis.pipeline.mesh.topology import used_vertices
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
#: Twice the area from which a face's vertices stay at their targets, square cells: see areas.h.
_LEAST_AREA = 1e-6
#: Rounds in which vertices of crossing faces go back, and the width of the surroundings that are
#: looked at meanwhile: see `pandis.pipeline.mesh.solid.simplification.near`.
_ROUNDS, _RINGS = 12, 3
#: What is left of their way after the first time: the two sides of a thin part end at its rim, and
#: a small part of the way back parts them.
_FIRST_BACK = 0.83
#: Faces that are judged at once, so that memory stays small.
_AT_ONCE = 1 << 20
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
    mesh = simplify(boundary, places, frame, tolerance=rules.tolerance, volume=parts.volume)
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
    moves = (distance > _OFF * corner) & (distance < _REACH)
    side, distance, closest = side[moves], distance[moves], closest[moves]
    outward = (places[side] - closest) / distance[:, None]
    offset = np.where(corner[moves], 0, thickness / 2)
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
    places, faces = boundary.places.copy(), boundary.faces
    moving = np.flatnonzero((target != places).any(axis=1))
    places[moving] = _rounded(target[moving])
    back = np.flatnonzero(_meeting(places, faces, moving))
    if not len(back):
        return places
    # only these and their surroundings can go back; `simplify` finds what crosses elsewhere
    around = back
    for _ in range(_RINGS):
        around = near(places, around)
    faces = faces[touching(around, faces)]
    around = used_vertices(faces)
    index = np.full(len(places), -1, np.int32)
    index[around] = np.arange(len(around))
    places[around] = _gone_back(
        boundary.places[around], _rounded(target[around]), faces=index[faces], back=index[back]
    )
    return places


def _gone_back(base, target, *, faces, back):
    """Return places (V, 3) between those of the lattice and the targets, where no faces cross.

    ``back`` has the vertices of faces that cross if all are at their targets.
    """
    share, places = (target != base).any(axis=1).astype(float), target.copy()
    for turn in range(_ROUNDS):
        back = back[share[back] > 0]
        if not len(back):
            break
        slower = np.where(share[back] == 1, _FIRST_BACK, share[back] / 2)
        stays = (share[back] > 0.2) & (turn < _ROUNDS // 2)
        share[back] = np.where(stays, slower, 0.0)
        way = share[back, None] * (target[back] - base[back])
        places[back] = _rounded(base[back] + way)
        meeting = _meeting(places, faces, back)
        if turn >= _ROUNDS // 3:
            meeting[faces[touching(meeting, faces)]] = True
        back = np.flatnonzero(meeting)
    places[back] = base[back]
    return places


def _rounded(places):
    return np.round(places * FINENESS) / FINENESS


def _meeting(places, faces, moved):
    """Return a mask of the vertices of faces that cross, or lack area, beside moved vertices."""
    marks, back = np.zeros((2, len(places)), bool)
    marks[moved] = True
    chosen = np.flatnonzero(touching(marks, faces))
    for start in range(0, len(chosen), _AT_ONCE):
        part = chosen[start : start + _AT_ONCE]
        question = np.zeros(len(faces), bool)
        question[part] = True
        around = near(places, used_vertices(faces[part]))
        rows = np.flatnonzero(touching(around, faces))
        pairs = crossings(places, faces[rows], question[rows])
        back[faces[rows[pairs.reshape(-1)]]] = True
        back[faces[part][_without_area(places[faces[part]])]] = True
    return back


def _without_area(corners):
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.einsum("ij,ij->i", normal, normal) < _LEAST_AREA**2
