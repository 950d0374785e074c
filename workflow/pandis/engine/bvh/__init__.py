"""Closest points and winding numbers of a triangle mesh: the binding of ``bvh.c``."""

import ctypes
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pandis.base.errors import PandisError
from pandis.engine.compiler import load
from pandis.engine.threads import SMALL, in_threads

#: Parts of a tree in memory: vertices, their normals, faces, their neighbours, nodes, leaves.
PARTS = ("VERT", "VNRM", "FACE", "NEIG", "TREE", "LEAF")
#: Bytes of a node and of a leaf.
NODE_BYTES, LEAF_BYTES = 224, 200
#: Bytes of a node's slabs.
_SLAB_BYTES = 160
#: Largest coordinate, whose square and more fit into single precision with a step per leaf.
_LARGEST = 1e30
#: Numbers of branches, as in branches.h: in the first two levels, which are opened first, and in
#: the first three. A tree of fewer than _MANY faces is built by one thread.
_OPENED, _BRANCHES, _MANY = 1 + 8, 1 + 8 + 64, 10_000
INVALID, TIED, OVERRULED, ON_SURFACE = 1, 2, 4, 8


class Labels(NamedTuple):
    """Exact distances, normals and closest points, in the frame of the mesh.

    Attributes
    ----------
    distance : ndarray, shape (n,)
        Negative inside; NaN at invalid points.
    normal : ndarray, shape (n, 3)
        Direction of steepest increase, unit length.
    face : ndarray, shape (n,), int32
        Index of the face with the closest point; -1 at invalid points.
    barycentrics : ndarray, shape (n, 3)
        Barycentric coordinates of the closest point.
    flags : ndarray, shape (n,), uint8
        Sum of the flags that apply: INVALID (a coordinate is not finite, or is 1e150 or more), TIED
        (two closest points), OVERRULED (the pseudonormal's sign was wrong) and ON_SURFACE (the
        normal is the pseudonormal).
    """

    distance: np.ndarray
    normal: np.ndarray
    face: np.ndarray
    barycentrics: np.ndarray
    flags: np.ndarray


def library():
    """Return the compiled library with its functions' types declared."""
    lib = load(Path(__file__).with_name("bvh.c"))
    pointer, i32, i64, f64 = ctypes.c_void_p, ctypes.c_int32, ctypes.c_int64, ctypes.c_double
    lib.bvh_start.restype, lib.bvh_start.argtypes = pointer, [pointer, i32, pointer, i32]
    lib.bvh_open.argtypes = lib.bvh_grow.argtypes = [pointer, i32]
    lib.bvh_meet.argtypes = lib.bvh_turn.argtypes = [pointer]
    lib.bvh_finish.restype, lib.bvh_finish.argtypes = pointer, [pointer]
    lib.bvh_free.argtypes = [pointer]
    lib.bvh_inside.argtypes = [pointer, pointer, i64, pointer]
    lib.bvh_look.argtypes = [pointer, i32, i32, f64, pointer]
    lib.bvh_winding.argtypes = [pointer, pointer, i64, pointer, pointer]
    lib.bvh_turns.argtypes = lib.bvh_whole.argtypes = [pointer, pointer, i64, f64, pointer]
    lib.bvh_first_hits.argtypes = [*[pointer] * 4, f64, i64, pointer]
    lib.bvh_part.restype, lib.bvh_part.argtypes = pointer, [pointer, i32, pointer]
    lib.bvh_slabs.argtypes = [pointer, pointer]
    lib.bvh_reach.restype, lib.bvh_reach.argtypes = f64, [pointer]
    lib.bvh_scan.argtypes = [pointer, pointer, i64, pointer, pointer]
    lib.bvh_order.argtypes = [pointer, i64, pointer]
    lib.bvh_label.argtypes = [*[pointer] * 3, i64, f64, i32, i32, f64, f64, *[pointer] * 6]
    return lib


class Bvh:
    """A tree over triangles.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), float64
    faces : ndarray, shape (F, 3), integer
    """

    def __init__(self, vertices, faces):
        vertices = np.ascontiguousarray(vertices, np.float64)
        faces = np.ascontiguousarray(faces, np.int32)
        if not len(faces) or faces.min() < 0 or faces.max() >= len(vertices):
            raise ValueError("faces must not be empty, and must index vertices")
        if not (np.abs(vertices) <= _LARGEST).all():
            raise ValueError(f"coordinates must be finite, and at most {_LARGEST:g}")
        self._library = library()
        self._tree = self._built(vertices, faces)
        if not self._tree:
            raise PandisError(f"not enough memory for a tree over {len(faces):,} faces")
        self._faces = len(faces)
        self.overruled = 0

    def _built(self, vertices, faces):
        """Return the tree, built on all threads; None if memory is short."""
        lib = self._library
        work = lib.bvh_start(vertices.ctypes.data, len(vertices), faces.ctypes.data, len(faces))
        if not work:
            return None
        small = 1 if len(faces) >= _MANY else SMALL
        opened = [partial(lib.bvh_open, work, index) for index in range(_OPENED)]
        grown = [partial(lib.bvh_grow, work, index) for index in range(_BRANCHES)]
        others = [partial(task, work) for task in (lib.bvh_meet, lib.bvh_turn)]
        # each step waits for the previous one; within a step, the longest tasks start first
        for tasks in (opened[:1], opened[1:], [*others, *grown]):
            in_threads(
                lambda low, _, tasks=tasks: tasks[low](), len(tasks), len(tasks), small=small
            )
        return lib.bvh_finish(work)

    def __del__(self):
        if getattr(self, "_tree", None):
            self._library.bvh_free(self._tree)
            self._tree = None

    def label(self, points, on_surface, check=True, *, tie=None, feet=True, close=False):
        """Return exact distances with normals, faces and flags.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
        on_surface : float
            Distance up to which the normal is the pseudonormal and no sign is checked.
        check : bool
            Whether to compare every sign with the winding number.
        tie : (float, float), optional
            Relative distance d and angle a (radians). A point is flagged if a second closest point
            is farther by at most the fraction d, in a direction that differs by more than a.
        feet : bool
            Whether to return faces and barycentrics; otherwise they are None.
        close : bool
            Whether distances next to the surface have all digits of single precision. Otherwise
            they are those of double arithmetic, as ``pandis.h`` computes them.

        Returns
        -------
        Labels
        """
        points = np.ascontiguousarray(points, np.float64)
        count = len(points)
        out = Labels(
            np.empty(count),
            np.empty((count, 3)),
            np.empty(count, np.int32) if feet else None,
            np.empty((count, 3)) if feet else None,
            np.empty(count, np.uint8),
        )
        relative, cosine = (tie[0], np.cos(tie[1])) if tie else (0.0, 0.0)
        order = None
        if count >= SMALL:
            order = np.empty(count, np.int64)
            if not self._library.bvh_order(points.ctypes.data, count, order.ctypes.data):
                raise PandisError(f"not enough memory to sort {count:,} points")
        columns = [None if column is None else column.ctypes.data for column in out]

        def part(low, high):
            counts = np.zeros(2, np.int64)
            start = order[low:].ctypes.data if order is not None else None
            self._library.bvh_label(
                self._tree, points.ctypes.data, start, high - low, on_surface, check, close,
                relative, cosine, *columns, counts.ctypes.data,
            )  # fmt: skip
            return counts

        counts = sum(in_threads(part, count)) if count else (0, 0)
        self.overruled += int(counts[1])
        return out

    def inside(self, points):
        """Return a mask (n,) of the points (n, 3) inside, by the winding number alone."""
        points = np.ascontiguousarray(points, np.float64)
        inside = np.empty(len(points), np.uint8)

        def part(low, high):
            start = points[low:].ctypes.data
            self._library.bvh_inside(self._tree, start, high - low, inside[low:].ctypes.data)

        in_threads(part, len(points))
        return inside.astype(bool)

    def look_wrong(self, beside):
        """Return a mask (F,) of faces with the outside below them, or the inside above them.

        Each face is tested at points at distance ``beside`` on both sides, in the middle and near
        the corners. Faces without area count as wrong.
        """
        wrong = np.empty(self._faces, np.uint8)

        def part(low, high):
            self._library.bvh_look(self._tree, low, high, beside, wrong.ctypes.data)

        in_threads(part, len(wrong))
        return wrong.astype(bool)

    def parts(self):
        """Return the arrays of the tree, as stored in a file for ``pandis.h``.

        Returns
        -------
        dict of str to bytes
            The keys are the section names in docs/format.md.
        """
        arrays, size = {}, ctypes.c_int64()
        for index, name in enumerate(PARTS):
            start = self._library.bvh_part(self._tree, index, ctypes.byref(size))
            arrays[name] = ctypes.string_at(start, size.value)
        slabs = np.empty(len(arrays["TREE"]) // NODE_BYTES * _SLAB_BYTES, np.uint8)
        self._library.bvh_slabs(self._tree, slabs.ctypes.data)
        return arrays | {"SLAB": slabs.tobytes()}

    @property
    def reach(self):
        """The largest absolute coordinate."""
        return self._library.bvh_reach(self._tree)

    def scan(self, points):
        """Return distance (n,) and normal (n, 3) at points (n, 3) by brute force over all faces.

        Off the surface, results equal those of `label` with ``check=False`` bit for bit. A program
        without a tree, such as the one for the paper's ground truth, computes distances this way.
        """
        points = np.ascontiguousarray(points, np.float64)
        distance, normal = np.empty(len(points)), np.empty((len(points), 3))
        if not self._library.bvh_scan(
            self._tree, points.ctypes.data, len(points), distance.ctypes.data, normal.ctypes.data
        ):
            raise PandisError("not enough memory for all faces at once")
        return distance, normal

    def turns(self, points, beta, *, closed=False):
        """Return the winding numbers (n,) at points (n, 3).

        A cluster of faces farther away than ``beta`` times its radius counts as one dipole. If the
        mesh is closed, a ray's crossings are counted instead: the numbers are whole, and exact but
        for points on the surface, where doubles cannot tell what the ray crosses.
        """
        points = np.ascontiguousarray(points, np.float64)
        turns = np.empty(len(points))
        of_part = self._library.bvh_whole if closed else self._library.bvh_turns

        def part(low, high):
            start = points[low:].ctypes.data
            of_part(self._tree, start, high - low, beta, turns[low:].ctypes.data)

        if len(points):
            in_threads(part, len(points))
        return turns

    def first_hits(self, points, ways, skipped, *, least=0.0):
        """Return the lengths (n,) of rays up to the first face that they meet, or infinity.

        Parameters
        ----------
        points, ways : ndarray, shape (n, 3)
            Starts and unit directions.
        skipped : ndarray, shape (n,)
            For each ray, a face that does not count.
        least : float
            Hits closer than this do not count.
        """
        points, ways = (np.ascontiguousarray(rows, np.float64) for rows in (points, ways))
        skipped, lengths = np.ascontiguousarray(skipped, np.int32), np.empty(len(points))
        columns = [column.ctypes.data for column in (points, ways, skipped)]
        self._library.bvh_first_hits(self._tree, *columns, least, len(points), lengths.ctypes.data)
        return lengths

    def winding(self, points):
        """Return the approximate and the exact winding numbers (n,) at points (n, 3)."""
        points = np.ascontiguousarray(points, np.float64)
        rough, exact = np.empty(len(points)), np.empty(len(points))
        self._library.bvh_winding(
            self._tree, points.ctypes.data, len(points), rough.ctypes.data, exact.ctypes.data
        )
        return rough, exact
