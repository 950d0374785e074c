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
#: Of two rooms that caps and doors part from the outside, with a wall between them that is seen,
#: one stays open: the wall is more than the first share of its walls; more than the second share of
#: the wall is seen; and the mean winding number beside its walls is below the third.
_SHARED_WALLS, _SEEN, _ENCLOSED = 0.1, 0.5, 0.75
#: Number of places beside walls that are looked at, and of rays from each. A room with a smaller
#: wall stays shut.
_LOOKS, _WAYS = 150, 48
#: Largest shares of a cavity's single walls with the outside behind them: in a closed source, else.
_SKIN_CLOSED, _SKIN_OPEN = 0.5, 0.02


class Rooms(NamedTuple):
    """The rooms of a lattice.

    Attributes
    ----------
    solid : ndarray, shape (R,), bool
    opened : int
        Number of rooms that are air although caps or doors part them from the outside.
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
    the walls, rooms that would bury a wall which is seen through them (see `_Views`), and cavities:
    rooms that the source's closed shells exclude by their orientation.

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
    turns = _turns(source)
    winding = turns(middles)
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
    views = _Views(walls, source, turns)
    while True:
        one, other = invented
        unreal = np.bincount(one[outside[other]], minlength=count)
        part = unreal / np.maximum(wall_count + unreal, 1)
        ajar = ~outside & (part > _NOISE)
        opened = ajar & ((part > share) | air)
        if not opened.any():
            opened = views.burying(ajar)
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


class _Views:
    """Which rooms would bury a wall that can be seen.

    The basin of a bathtub and the box below it are two rooms with a lid each. If both were solid,
    the tub between them would be lost. A room that its walls clearly enclose is solid all the same.
    """

    def __init__(self, walls, source, turns):
        self._walls, self._source, self._turns = walls, source, turns
        self._real = walls.single & ~walls.cap
        self._tree, self._known = None, {}

    def burying(self, ajar):
        """Return a mask of the room to open, the least enclosed one; nothing is set if none is.

        Parameters
        ----------
        ajar : ndarray, shape (R,), bool
            Solid rooms that caps and doors part from the outside.
        """
        rooms, chosen = self._walls.rooms, np.zeros(len(ajar), bool)
        shared = self._real & ajar[rooms].all(axis=1) & (rooms[:, 0] != rooms[:, 1])
        total, part = (np.bincount(rooms[which].reshape(-1), minlength=len(ajar))
                       for which in (self._real, shared))  # fmt: skip
        enclosed = {}
        for room in np.flatnonzero(part > np.maximum(_SHARED_WALLS * total, _LOOKS)):
            if room not in self._known:  # how far it is enclosed, and the share that is seen
                self._known[room] = self._enclosed(room), self._share_seen(room, shared)
            turns, seen = self._known[room]
            if turns < _ENCLOSED and seen > _SEEN:
                enclosed[room] = turns
        if enclosed:
            chosen[min(enclosed, key=enclosed.get)] = True
        return chosen

    def _enclosed(self, room):
        """Return the mean winding number beside a room's walls."""
        return self._turns(self._beside(room, self._real)).mean()

    def _share_seen(self, room, walls):
        """Return the share of a room's side of some walls from which a ray meets nothing."""
        if self._tree is None:
            self._tree = MeshTree(self._source.vertices, self._source.faces)
        return _seen(self._tree, self._beside(room, walls)).mean()

    def _beside(self, room, walls):
        """Return places in a room beside some walls, mesh units."""
        walls = np.flatnonzero(walls)
        wall, end = np.nonzero(self._walls.rooms[walls] == room)
        some = np.linspace(0, len(wall) - 1, _LOOKS).astype(int)
        places = self._walls.beside[walls[wall[some]], end[some]].astype(float)
        return self._source.frame.to_mesh(places)


def _turns(source):
    """Return a function for the winding number (n,), without its sign, at points (n, 3)."""
    single = source.faces[~source.doubled]  # the two orientations of a face cancel
    if not len(single):
        return lambda points: np.zeros(len(points))
    tree = MeshTree(source.vertices, single)
    return lambda points: np.abs(tree.windings(points))


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
