"""Crossing and connected faces: the binding of ``faces.c``."""

import ctypes
from functools import cache
from pathlib import Path

import numpy as np

from pandis.base.errors import PandisError
from pandis.engine.compiler import load

#: Two faces with a common edge are folded onto each other if the angle between them is at most this
#: multiple of its rounding error.
_FOLD_TOLERANCE = 64


@cache
def library():
    """Return the compiled library with its functions' types declared."""
    lib = load(Path(__file__).with_name("faces.c"))
    pointer, i32, i64 = ctypes.c_void_p, ctypes.c_int32, ctypes.c_int64
    lib.faces_crossings.restype = i64
    lib.faces_crossings.argtypes = [pointer, pointer, i32, pointer, ctypes.c_double, pointer]
    lib.faces_folded.argtypes = [pointer, pointer, i64, ctypes.c_double, pointer]
    lib.faces_close.restype = i64
    lib.faces_close.argtypes = [pointer, i32, ctypes.c_double, pointer]
    lib.faces_free.argtypes = [pointer]
    lib.faces_connect.argtypes = [pointer, i64, pointer, i64]
    lib.faces_orient.argtypes = [pointer, pointer, i32, *[pointer] * 4]
    return lib


def crossings(vertices, faces, question=None, *, extent=0.0):
    """Return the pairs (m, 2) of faces that meet outside their common vertices and edge, sorted.

    Faces are closed sets, and one without area is a segment. Decisions are exact (Shewchuk 1997).

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), float64
        Finite, and of a size between 1e-150 and 1e150.
    faces : ndarray, shape (F, 3), integer
    question : ndarray, shape (F,), bool, optional
        Only pairs with at least one of these faces are returned.
    extent : float
        Longest side of the mesh: neighbours that are `folded` count, too. 0: only exact decisions.
    """
    vertices = np.asarray(vertices, np.float64)
    faces = np.ascontiguousarray(faces, np.int32)
    if not len(faces):
        return np.empty((0, 2), np.int64)
    places, rounding = _scaled(vertices, faces, extent)
    mask = None if question is None else np.ascontiguousarray(question, np.uint8)
    mask_start = None if mask is None else mask.ctypes.data
    return _pairs(
        library().faces_crossings, places, faces.ctypes.data, len(faces), mask_start, rounding
    )


def _scaled(vertices, indices, extent):
    """Return vertices, scaled so that products fit, and the tolerance of folds at that scale."""
    used = np.zeros(len(vertices), bool)
    used[indices.reshape(-1)] = True
    # a power of two rounds nothing; at this size, products neither overflow nor underflow
    size = np.ptp(vertices[used], axis=0).max()
    if not np.isfinite(size):
        raise ValueError("vertices that faces use must be finite")
    power = 200 - int(np.frexp(size)[1])
    with np.errstate(over="ignore"):  # of vertices that no face uses
        places = np.ascontiguousarray(np.ldexp(vertices, power))
    return places, float(np.ldexp(_FOLD_TOLERANCE * np.finfo(np.float64).eps * extent, power))


def folded(vertices, corners, *, extent):
    """Return a mask (m,) of the pairs of triangles that are folded onto each other within rounding.

    The angle between them is zero within its rounding error, which is that of the mesh's longest
    side relative to their heights over the common edge, or less than 1e-10. This edge has no
    normal, so a distance near it has no sign, whether or not they cross in exact arithmetic.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), float64
    corners : ndarray, shape (m, 4), integer
        The ends of each common edge, then the third corners of both triangles.
    extent : float
        Longest side of the mesh.
    """
    corners = np.ascontiguousarray(corners, np.int32)
    marks = np.zeros(len(corners), np.uint8)
    if len(corners):
        places, rounding = _scaled(np.asarray(vertices, np.float64), corners, extent)
        library().faces_folded(
            places.ctypes.data, corners.ctypes.data, len(corners), rounding, marks.ctypes.data
        )
    return marks.astype(bool)


def close(points, distance):
    """Return the pairs (m, 2) of points (n, 3) that are at most a distance apart, sorted."""
    points = np.ascontiguousarray(points, np.float64)
    if not len(points):
        return np.empty((0, 2), np.int64)
    return _pairs(library().faces_close, points, len(points), distance)


def _pairs(function, places, *arguments):
    """Call a function that allocates pairs, and return them sorted."""
    start = ctypes.c_void_p()
    count = function(places.ctypes.data, *arguments, ctypes.byref(start))
    try:
        if count < 0:
            raise MemoryError
        if not count:
            return np.empty((0, 2), np.int64)
        # not string_at, whose size is a C int
        numbers = (ctypes.c_int32 * (2 * count)).from_address(start.value)
        pairs = np.frombuffer(numbers, np.int32).reshape(-1, 2).astype(np.int64)
        return pairs[np.lexsort(pairs.T[::-1])]
    except MemoryError:
        raise PandisError("not enough memory: too many faces cross, or points are close") from None
    finally:
        library().faces_free(start)


def connected(pairs, count):
    """Return a label (count,) for each node of a graph: the least node connected with it.

    Parameters
    ----------
    pairs : ndarray, shape (m, 2), int64
        Nodes that are neighbours.
    count : int
        Number of nodes.
    """
    pairs, label = np.ascontiguousarray(pairs, np.int64), np.empty(count, np.int64)
    library().faces_connect(pairs.ctypes.data, len(pairs), label.ctypes.data, count)
    return label


def orientation(neighbours, agrees):
    """Return how faces must be turned so that neighbours agree with the first face of their patch.

    Parameters
    ----------
    neighbours : ndarray, shape (F, 3), integer
        The face across each edge of a face, or -1.
    agrees : ndarray, shape (F, 3), bool
        Whether that face runs along the edge the other way.

    Returns
    -------
    patch : ndarray, shape (F,), int32
        The first face of each face's patch.
    turned, one_sided : ndarray, shape (F,), bool
        Faces to turn, and faces of patches with only one side, where some neighbours cannot agree.
    """
    neighbours = np.ascontiguousarray(neighbours, np.int32)
    agrees, count = np.ascontiguousarray(agrees, np.uint8), len(neighbours)
    patch, queue = np.empty(count, np.int32), np.empty(count, np.int32)
    turned, one_sided = np.empty(count, np.uint8), np.empty(count, np.uint8)
    library().faces_orient(
        neighbours.ctypes.data, agrees.ctypes.data, count,
        *(column.ctypes.data for column in (patch, turned, one_sided, queue)),
    )  # fmt: skip
    return patch, turned.astype(bool), one_sided[patch].astype(bool)
