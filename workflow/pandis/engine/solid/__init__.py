"""One closed surface for any triangles: the binding of ``solid.c``."""

import ctypes
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pandis.base.errors import PandisError
from pandis.engine.compiler import load

#: Where a vertex comes from: a cut of the source, a cap over a rim, a door, the side of a sheet, a
#: sharp edge or corner.
ORIGINS = ON_SURFACE, ON_CAP, ON_DOOR, ON_SHEET, AT_CORNER = range(5)
#: Vertices lie at multiples of this fraction of a cell.
FINENESS = 2**28
#: Room of a vertex of a sheet.
NO_ROOM = -1


class Walls(NamedTuple):
    """The places where triangles cut edges of the lattice.

    Attributes
    ----------
    rooms : ndarray, shape (n, 2), int32
        Rooms of the edge's ends.
    triangle : ndarray, shape (n,), int32
    cap : ndarray, shape (n,), bool
        Whether that is a cap and not of the source.
    single : ndarray, shape (n,), bool
        Whether it is the only cut of its edge.
    faces : ndarray, shape (n,), int8
        1 if the triangle's normal points to the second end, -1 if to the first.
    beside : ndarray, shape (n, 2, 3), float32, cells
        Half-way from the cut to both ends.
    """

    rooms: np.ndarray
    triangle: np.ndarray
    cap: np.ndarray
    single: np.ndarray
    faces: np.ndarray
    beside: np.ndarray


class Boundary(NamedTuple):
    """The boundary of the solid nodes: closed, oriented outward, without self-intersections.

    Attributes
    ----------
    places : ndarray, shape (V, 3), float64
        Vertices, in cells.
    origin : ndarray, shape (V,), uint8
        An index into `ORIGINS`.
    room : ndarray, shape (V,), int32
        The room inside, or `NO_ROOM`.
    part : ndarray, shape (V,), int32
        The component.
    faces : ndarray, shape (F, 3), int32
    """

    places: np.ndarray
    origin: np.ndarray
    room: np.ndarray
    part: np.ndarray
    faces: np.ndarray


class Parts(NamedTuple):
    """Sums over the components of a `Boundary`.

    Attributes
    ----------
    faces : ndarray, shape (P,), int64
    volume : ndarray, shape (P,), float64
        Cubic cells; negative for cavities.
    invented, sheets : float
        Shares of the area that caps and doors, and sheets have.
    """

    faces: np.ndarray
    volume: np.ndarray
    invented: float
    sheets: float


@cache
def library():
    """Return the compiled library with its functions' types declared."""
    lib = load(Path(__file__).with_name("solid.c"))
    pointer, i32, i64, f32 = ctypes.c_void_p, ctypes.c_int32, ctypes.c_int64, ctypes.c_float
    lib.solid_new.restype = pointer
    lib.solid_new.argtypes = [pointer, pointer, i64, i64, i64, pointer]
    lib.solid_free.argtypes = [pointer]
    lib.solid_rooms.argtypes = [pointer, i32, f32, f32]
    lib.solid_fill.argtypes = [pointer, pointer, f32]
    lib.solid_surface.argtypes = [pointer, f32]
    lib.solid_counts.argtypes = [pointer, pointer]
    lib.solid_middles.argtypes = [pointer, pointer]
    lib.solid_walls.argtypes = [pointer] * 6
    lib.solid_doors.restype, lib.solid_doors.argtypes = i64, [pointer] * 3
    lib.solid_result.argtypes = [pointer] * 5
    lib.solid_simplify.argtypes = [pointer, i64, pointer, i64, pointer, ctypes.c_double, pointer]
    lib.solid_reopen.argtypes = [pointer, i64, pointer, i64, ctypes.c_double, pointer, pointer]
    lib.solid_parts.restype, lib.solid_parts.argtypes = i64, [pointer, pointer]
    lib.solid_sums.argtypes = [pointer] * 5
    lib.solid_rims.restype = i64
    lib.solid_rims.argtypes = [pointer, i64, i32, pointer, pointer]
    lib.solid_loops.argtypes = [i32, pointer]
    return lib


def rims(edges, vertices):
    """Split open edges into closed loops of vertices.

    Parameters
    ----------
    edges : ndarray, shape (n, 2), int32
    vertices : int
        Number of vertices of the mesh.

    Returns
    -------
    list of ndarray
    """
    edges = np.ascontiguousarray(edges, np.int32)
    loops, sizes = np.empty(len(edges), np.int32), np.empty(len(edges), np.int64)
    count = library().solid_rims(
        edges.ctypes.data, len(edges), vertices, loops.ctypes.data, sizes.ctypes.data
    )
    if count < 0:
        raise PandisError(f"not enough memory for the rims of {len(edges):,} open edges")
    sizes = sizes[:count]
    return np.split(loops[: sizes.sum()], np.cumsum(sizes)[:-1]) if count else []


def merged(places, faces, *, locked, tolerance):
    """Merge vertices of a closed manifold mesh into neighbours, so that it needs fewer faces.

    Parameters
    ----------
    places : ndarray, shape (V, 3), float64
    faces : ndarray, shape (F, 3), int32
    locked : ndarray, shape (V,), bool
        Vertices that stay.
    tolerance : float
        Largest root mean square distance of a merged vertex from the planes it stood for.

    Returns
    -------
    ndarray, shape (V,), int32
        The vertex that stands for each; a face with two equal ones is gone. If the mesh is not
        closed and manifold, nothing is merged, and -1 stands for the ends of edges without exactly
        one face on each side or, if there are none, for vertices that join several fans of faces.

    Raises
    ------
    PandisError
        Memory is short.
    """
    places, faces = np.ascontiguousarray(places), np.array(faces, np.int32, order="C")
    locked = np.ascontiguousarray(locked, np.uint8)
    into = np.empty(len(places), np.int32)
    if not library().solid_simplify(
        places.ctypes.data, len(places), faces.ctypes.data, len(faces), locked.ctypes.data,
        tolerance, into.ctypes.data,
    ):  # fmt: skip
        raise PandisError("not enough memory to simplify the surface")
    return into


def reopened(places, faces, *, into, chosen, tolerance):
    """Let vertices stand for themselves that are merged with chosen ones.

    More are taken apart where a face at the border would turn over, be a needle, or leave the
    surface.

    Parameters
    ----------
    places : ndarray, shape (V, 3), float64
    faces : ndarray, shape (F, 3), int32
        Before anything was merged.
    into : ndarray, shape (V,), int32
        From `merged`.
    chosen : ndarray, shape (V,), bool
    tolerance : float
        As in `merged`.

    Returns
    -------
    into : ndarray, shape (V,), int32
    apart : ndarray, shape (V,), bool
        The vertices that stand for themselves again.

    Raises
    ------
    PandisError
        Memory is short.
    """
    places, faces = np.ascontiguousarray(places), np.ascontiguousarray(faces, np.int32)
    into, apart = into.copy(), chosen.astype(np.uint8)
    if not library().solid_reopen(
        places.ctypes.data, len(places), faces.ctypes.data, len(faces), tolerance,
        into.ctypes.data, apart.ctypes.data,
    ):  # fmt: skip
        raise PandisError("not enough memory to simplify the surface")
    return into, apart.astype(bool)


class Lattice:
    """A lattice of nodes, and the cuts of triangles with its edges.

    Parameters
    ----------
    corners : ndarray, shape (T, 3, 3), float64
        Corners of triangles in cells, at least two cells from the lattice's border.
    open_edges : ndarray, shape (T,), uint8
        Bit k is set if a door can stand at the edge from corner k to k + 1: it is open.
    caps : int
        Number of triangles, the last ones, that only block.
    strips : int
        Number of caps, the last ones, that continue faces a little beyond their open edges.
    size : ndarray, shape (3,)
        Nodes along each axis.

    Raises
    ------
    PandisError
        There is not enough memory. Every method can raise this.
    """

    def __init__(self, corners, open_edges, *, caps, strips, size):
        self._corners = np.ascontiguousarray(corners, np.float64)
        self._open = np.ascontiguousarray(open_edges, np.uint8)
        self.size = np.ascontiguousarray(size, np.int32)
        self._library, self._lattice, self._caps = library(), None, caps
        self._lattice = self._library.solid_new(
            self._corners.ctypes.data,
            self._open.ctypes.data,
            len(self._corners),
            caps,
            strips,
            self.size.ctypes.data,
        )
        self._check(self._lattice)

    def __del__(self):
        if getattr(self, "_lattice", None):
            self._library.solid_free(self._lattice)
            self._lattice = None

    def _check(self, done):
        if not done:
            cells = " x ".join(map(str, self.size.tolist()))
            raise PandisError(f"not enough memory for a lattice of {cells} nodes")

    def _counts(self):
        counts = np.zeros(4, np.int64)
        self._library.solid_counts(self._lattice, counts.ctypes.data)
        return counts.tolist()

    def find_rooms(self, widest, share):
        """Number the rooms; shut doors between open edges.

        Parameters
        ----------
        widest : float
            Largest half width of a door, cells.
        share : float
            Largest half width of a door, as a share of the radius of the smaller room.

        Returns
        -------
        ndarray, shape (R, 3), int32
            A node of each room, far from its walls. Room 0 is outside.
        """
        has_open = bool(self._open.any())
        self._check(self._library.solid_rooms(self._lattice, has_open, widest, share))
        count = self._counts()[0]
        middle = np.empty((count, 3), np.int32)
        self._library.solid_middles(self._lattice, middle.ctypes.data)
        return middle

    def walls(self):
        """Return the `Walls` between and in the rooms."""
        count = self._counts()[1]
        rooms, triangle = np.empty((count, 2), np.int32), np.empty(count, np.int32)
        single, faces = np.empty(count, np.bool_), np.empty(count, np.int8)
        beside = np.empty((count, 2, 3), np.float32)
        columns = [array.ctypes.data for array in (rooms, triangle, single, faces, beside)]
        self._library.solid_walls(self._lattice, *columns)
        cap = triangle >= len(self._corners) - self._caps
        return Walls(rooms, triangle, cap, single, faces, beside)

    def doors(self):
        """Return the edges through shut doors: the rooms at their ends, and how wide it is there.

        Returns
        -------
        rooms : ndarray, shape (n, 2), int32
        distance : ndarray, shape (n,), float32
            Distance from the surface, cells.
        """
        count = 0
        if self._open.any():  # else there are none
            count = self._library.solid_doors(self._lattice, None, None)
        rooms, distance = np.empty((count, 2), np.int32), np.empty(count, np.float32)
        if count:
            self._library.solid_doors(self._lattice, rooms.ctypes.data, distance.ctypes.data)
        return rooms, distance

    def boundary(self, solid, half):
        """Find the boundary of the solid rooms, and of sheets where air is on both sides.

        Parameters
        ----------
        solid : ndarray, shape (R,), bool
        half : float
            Half thickness of sheets of nodes, cells; the caller places their sides.

        Returns
        -------
        Boundary, Parts
        """
        solid = np.ascontiguousarray(solid, np.uint8)
        self._check(self._library.solid_fill(self._lattice, solid.ctypes.data, half))
        self._check(self._library.solid_surface(self._lattice, half))
        *_, vertices, faces = self._counts()
        result = Boundary(
            np.empty((vertices, 3)), np.empty(vertices, np.uint8), np.empty(vertices, np.int32),
            np.empty(vertices, np.int32), np.empty((faces, 3), np.int32),
        )  # fmt: skip
        columns = [array.ctypes.data for array in result]
        self._library.solid_result(self._lattice, *columns[:3], columns[4])
        count = self._library.solid_parts(self._lattice, columns[3])
        sums = np.zeros(count, np.int64), np.zeros(count), np.zeros(3)
        self._library.solid_sums(self._lattice, columns[3], *(part.ctypes.data for part in sums))
        area, *others = sums[2].tolist()
        invented, sheets = (other / area if area else 0.0 for other in others)
        return result, Parts(sums[0], sums[1], invented, sheets)
