"""Which rooms of a lattice are solid: the rules by which a person would call them so."""

from typing import NamedTuple

import numpy as np

from pandis.pipeline.mesh.tree import MeshTree

#: Shares of a room's wall that are noise: caps and doors up to the first never open it.
_NOISE = 0.002
#: A room that caps or doors part from the outside is outside if its winding number is below the
#: first and more than the second share of its walls face into it: it is air around a sheet.
_AIR_WINDING, _AIR_WALLS = 0.4, 0.6
#: A cavity has a winding number below the first; more than the second share of its walls face in.
_CAVITY_WINDING, _CAVITY_WALLS = 0.1, 0.95
#: A room stays open if, shut, it would bury more than the first share of its walls, of which more
#: than the second can be seen from outside through its caps and doors.
_BURIED_WALLS, _BURIED_SEEN = 0.1, 0.5
#: Number of buried walls of a room from which rays are traced, and of rays from each. A room with
#: fewer stays shut.
_LOOKS, _WAYS = 150, 48
#: Largest shares of a cavity's single walls with the outside behind them: in a closed source, else.
_SKIN_CLOSED, _SKIN_OPEN = 0.5, 0.02


class Rooms(NamedTuple):
    """The rooms of a lattice.

    Attributes
    ----------
    solid : ndarray, shape (R,), bool
    opened : int
        Number of rooms that are air because too much of their wall would be invented.
    cavities : int
        Number of hollow rooms.
    buried : ndarray, shape (R,), bool
        Solid rooms with a wall of the source in or between them.
    doors : list of float
        Widths of the doors that part solid from air, cells, widest first.
    caps : ndarray
        Triangles of caps that do.
    """

    solid: np.ndarray
    opened: int
    cavities: int
    buried: np.ndarray
    doors: list
    caps: np.ndarray


def solid_rooms(lattice, middles, source, *, share, keep_cavities):
    """Decide which rooms are solid.

    All are but the outside, rooms of which caps and doors to the outside are more than ``share`` of
    the walls, rooms that would bury what is seen through them, and cavities: rooms that the
    source's closed shells exclude by their orientation.

    Parameters
    ----------
    lattice : pandis.engine.solid.Lattice
    middles : ndarray, shape (R, 3)
        A place in each room, in the frame of the mesh.
    source : pandis.pipeline.mesh.solid.source.Source
    share : float
    keep_cavities : bool

    Returns
    -------
    Rooms
    """
    count = len(middles)
    solid = np.arange(count) > 0
    if count == 1:
        return Rooms(solid, 0, 0, np.zeros(count, bool), [], np.arange(0))
    winding, single = np.zeros(count), source.faces[~source.doubled]
    if len(single):  # the two orientations of a face cancel
        winding = np.abs(MeshTree(source.vertices, single).windings(middles))
    walls = lattice.walls()
    between = walls.rooms[:, 0] != walls.rooms[:, 1]
    real = between & ~walls.cap
    rooms, doubled = walls.rooms[real], source.doubled[walls.triangle[real]]
    second = walls.faces[real] > 0
    # doubled walls face both ways: they bound air, and say nothing of what a cavity holds
    inward = _share_inward(rooms, second | doubled, ~second | doubled, count=count)
    alone = _share_inward(rooms, second & ~doubled, ~second & ~doubled, count=count)
    air = (winding < _AIR_WINDING) & (inward > _AIR_WALLS)
    outside = np.arange(count) == 0
    wall_count = np.bincount(rooms.reshape(-1), minlength=count)
    doors, distance = lattice.doors()
    invented = _both_ways(np.concatenate([walls.rooms[between & walls.cap], doors]))
    while True:
        one, other = invented
        unreal = np.bincount(one[outside[other]], minlength=count)
        part = unreal / np.maximum(wall_count + unreal, 1)
        ajar = ~outside & (part > _NOISE)
        opened = ajar & ((part > share) | air)
        if not opened.any():
            opened = _burying(walls, source, solid=~outside, rooms=ajar)
        if not opened.any():
            break
        outside |= opened
    solid = ~outside
    hollow = np.zeros(count, bool)
    if keep_cavities:
        hollow = solid & (winding < _CAVITY_WINDING) & (alone > _CAVITY_WALLS)
        hollow &= _behind_walls(walls, between, count, closed=source.closed)
    solid &= ~hollow
    return Rooms(
        solid,
        int(outside.sum()) - 1,
        int(hollow.sum()),
        _buried(walls, solid),
        _door_widths(doors, 2 * distance, solid),
        np.unique(walls.triangle[walls.cap & (solid[walls.rooms].sum(axis=1) == 1)]),
    )


def _burying(walls, source, *, solid, rooms):
    """Return a mask of those of some rooms that would bury what is seen through them.

    Parameters
    ----------
    walls : pandis.engine.solid.Walls
    source : pandis.pipeline.mesh.solid.source.Source
    solid, rooms : ndarray, shape (R,), bool
    """
    count, real = len(solid), walls.single & ~walls.cap
    inside = np.flatnonzero(real & solid[walls.rooms].all(axis=1))
    total = np.bincount(walls.rooms[real].reshape(-1), minlength=count)
    buried = np.bincount(walls.rooms[inside].reshape(-1), minlength=count)
    burying = rooms & (buried > np.maximum(_BURIED_WALLS * total, _LOOKS))
    if not burying.any():
        return burying
    tree = MeshTree(source.vertices, source.faces)
    for room in np.flatnonzero(burying):
        wall, end = np.nonzero(walls.rooms[inside] == room)
        chosen = np.linspace(0, len(wall) - 1, _LOOKS).astype(int)
        places = walls.beside[inside[wall[chosen]], end[chosen]].astype(float)
        burying[room] = _seen(tree, source.frame.to_mesh(places)).mean() > _BURIED_SEEN
    return burying


def _seen(tree, points):
    """Return a mask (n,) of the points (n, 3) from which a ray meets nothing."""
    height = 1 - (2 * np.arange(_WAYS) + 1) / _WAYS
    turn, level = np.pi * (1 + 5**0.5) * np.arange(_WAYS), np.sqrt(1 - height**2)
    seen = np.zeros(len(points), bool)
    for way in np.stack([level * np.cos(turn), level * np.sin(turn), height], axis=1):
        hidden = np.flatnonzero(~seen)
        ways, skipped = np.tile(way, (len(hidden), 1)), np.full(len(hidden), -1)
        seen[hidden] = np.isinf(tree.first_hits(points[hidden], ways, skipped))
    return seen


def _buried(walls, solid):
    """Return a mask of the solid rooms with a wall of the source inside, more than noise."""
    count = len(solid)
    inside = walls.rooms[walls.single & ~walls.cap & solid[walls.rooms].all(axis=1)]
    total = np.bincount(walls.rooms.reshape(-1), minlength=count)
    return np.bincount(inside.reshape(-1), minlength=count) > _NOISE * total


def _both_ways(pairs):
    """Return the two columns of pairs (n, 2), each followed by the other."""
    return np.concatenate([pairs[:, 0], pairs[:, 1]]), np.concatenate([pairs[:, 1], pairs[:, 0]])


def _share_inward(rooms, second, first, *, count):
    """Return the share of each room's walls that face into it.

    Parameters
    ----------
    rooms : ndarray, shape (n, 2)
        Rooms on both sides of each wall.
    second, first : ndarray, shape (n,), bool
        Whether it faces the second, and the first.
    count : int
        Number of rooms.
    """
    inward = np.bincount(rooms[:, 1], second, count) + np.bincount(rooms[:, 0], first, count)
    return inward / np.maximum(np.bincount(rooms.reshape(-1), minlength=count), 1)


def _behind_walls(walls, between, count, *, closed):
    """Return a mask of rooms that more than one layer parts from the outside."""
    one, other = _both_ways(walls.rooms[between & walls.single & ~walls.cap])
    total = np.bincount(one, minlength=count)
    skin = np.bincount(one[other == 0], minlength=count)
    return (total > 0) & (skin <= (_SKIN_CLOSED if closed else _SKIN_OPEN) * total)


def _door_widths(doors, width, solid):
    """Return the greatest width between each two rooms of which one is solid, widest first."""
    shut = solid[doors].sum(axis=1) == 1
    pairs, index = np.unique(np.sort(doors[shut], axis=1), axis=0, return_inverse=True)
    widths = np.zeros(len(pairs))
    np.maximum.at(widths, index.reshape(-1), width[shut])
    return sorted(widths.tolist(), reverse=True)
