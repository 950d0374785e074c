"""Crossing and connected faces: the binding of ``faces.c``."""

import ctypes
from functools import cache
from pathlib import Path

import numpy as np

from pandis.base.errors import PandisError
from pandis.engine.compiler import load


@cache
def library():
    """Return the compiled library with its functions' types declared."""
    lib = load(Path(__file__).with_name("faces.c"))
    pointer, i32, i64 = ctypes.c_void_p, ctypes.c_int32, ctypes.c_int64
    lib.faces_crossings.restype = i64
    lib.faces_crossings.argtypes = [pointer, pointer, i32, pointer, pointer]
    lib.faces_close.restype = i64
    lib.faces_close.argtypes = [pointer, i32, ctypes.c_double, pointer]
    lib.faces_free.argtypes = [pointer]
    lib.faces_connect.argtypes = [pointer, i64, pointer, i64]
    return lib


def crossings(vertices, faces, question=None):
    """Return the pairs (m, 2) of faces that meet outside their common vertices and edge, sorted.

    Faces are closed sets, and one without area is a segment. Decisions are exact (Shewchuk 1997).

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), float64
        Finite, and of a size between 1e-150 and 1e150.
    faces : ndarray, shape (F, 3), integer
    question : ndarray, shape (F,), bool, optional
        Only pairs with at least one of these faces are returned.
    """
    faces = np.ascontiguousarray(faces, np.int32)
    if not len(faces):
        return np.empty((0, 2), np.int64)
    used = np.zeros(len(vertices), bool)
    used[faces.reshape(-1)] = True
    # a power of two rounds nothing; at this size, products neither overflow nor underflow
    size = np.ptp(vertices[used], axis=0).max()
    with np.errstate(over="ignore"):  # of vertices that no face uses
        places = np.ascontiguousarray(np.ldexp(vertices, 200 - int(np.frexp(size)[1])))
    mask = None if question is None else np.ascontiguousarray(question, np.uint8)
    mask_start = None if mask is None else mask.ctypes.data
    return _pairs(library().faces_crossings, places, faces.ctypes.data, len(faces), mask_start)


def close(points, distance):
    """Return the pairs (m, 2) of points (n, 3) that are at most a distance apart, sorted."""
    if not len(points):
        return np.empty((0, 2), np.int64)
    return _pairs(library().faces_close, np.ascontiguousarray(points), len(points), distance)


def _pairs(function, places, *arguments):
    """Call a function that allocates pairs, and return them sorted."""
    start = ctypes.c_void_p()
    count = function(places.ctypes.data, *arguments, ctypes.byref(start))
    try:
        if count < 0:
            raise PandisError("not enough memory for the pairs of faces that cross")
        pairs = np.frombuffer(ctypes.string_at(start, 8 * count), np.int32).reshape(-1, 2)
    finally:
        library().faces_free(start)
    return pairs[np.lexsort(pairs.T[::-1])].astype(np.int64)


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
