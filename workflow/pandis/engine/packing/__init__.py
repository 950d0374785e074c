"""Packs a mesh on a lattice into blocks and a tree: the binding of ``packing.c``."""

import ctypes
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pandis.base.errors import PandisError
from pandis.engine.compiler import load
from pandis.engine.threads import in_threads

#: Maximum number of bits of a lattice coordinate.
MOST_BITS = 20
#: Sizes of a branch and of a block's record, bytes.
BRANCH_BYTES, BLOCK_BYTES = 96, 16
#: Maximum number of faces per block.
BLOCK_FACES = 64
#: How a point's side is found: from its nearest face, as stored (outside or inside), or by a ray.
BY_FACE, OUTSIDE, INSIDE, BY_RAY = 0, 1, 2, 3


class Packed(NamedTuple):
    """A packed mesh.

    Attributes
    ----------
    branches, blocks, packed : ndarray, uint8
        Contents of the sections ``BRCH``, ``BLCK`` and ``PACK`` of docs/format.md.
    """

    branches: np.ndarray
    blocks: np.ndarray
    packed: np.ndarray


class Sides(NamedTuple):
    """How to find the side of a point whose closest point is on a corner, edge or face.

    Each entry is BY_FACE, OUTSIDE, INSIDE or BY_RAY.

    Attributes
    ----------
    corners : ndarray, shape (V,), uint8
    edges : ndarray, shape (F, 3), uint8
        Edge k is from corner k to k + 1.
    faces : ndarray, shape (F,), uint8
    """

    corners: np.ndarray
    edges: np.ndarray
    faces: np.ndarray


def find_rays(vertices, faces):
    """Return test points for the corners and edges at which the faces do not determine the side.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), integer
    faces : ndarray, shape (F, 3), integer

    Returns
    -------
    points : ndarray, shape (n, 3)
        Points just off the surface. Their closest surface point is the corner or edge midpoint.
    owners : ndarray, shape (n,), int32
        The vertex of a corner; V + 3 · face + first corner (0, 1 or 2) for an edge.
    """
    vertices, faces = _checked(vertices, faces)
    library = _library()
    rays = library.packing_rays(vertices.ctypes.data, len(vertices), faces.ctypes.data, len(faces))
    if not rays:
        raise PandisError(f"not enough memory to examine {len(faces):,} faces")
    count = library.packing_ray_count(rays)
    points, owners = np.empty((count, 3)), np.empty(count, np.int32)
    if count:
        library.packing_copy_rays(rays, points.ctypes.data, owners.ctypes.data)
    library.packing_free_rays(rays)
    return points, owners


def pack_mesh(vertices, faces, sides):
    """Pack a mesh on a lattice.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), integer
        Lattice coordinates, from 0 to 2^20 - 1.
    faces : ndarray, shape (F, 3), integer
        No face may have two equal corners.
    sides : Sides

    Returns
    -------
    Packed

    Raises
    ------
    ValueError
        A vertex is off the lattice, or a face has an invalid or a repeated index.
    PandisError
        There is not enough memory, or there is no C compiler.
    """
    vertices, faces = _checked(vertices, faces)
    tells = [np.ascontiguousarray(part, np.uint8).ravel() for part in sides]
    if [len(part) for part in tells] != [len(vertices), 3 * len(faces), len(faces)]:
        raise ValueError("sides must match the vertices, the edges of the faces, and the faces")
    library = _library()
    packing = library.packing_build(
        vertices.ctypes.data, len(vertices), faces.ctypes.data, len(faces),
        *(part.ctypes.data for part in tells),
    )  # fmt: skip
    if not packing:
        raise PandisError(f"not enough memory to pack {len(faces):,} faces")
    parts, size = [], ctypes.c_int64()
    for index in range(len(Packed._fields)):
        start = library.packing_part(packing, index, ctypes.byref(size))
        parts.append(np.frombuffer(ctypes.string_at(start, size.value), np.uint8))
    library.packing_free(packing)
    return Packed(*parts)


def distance_and_clear(arrays, bits, points, *, most=0):
    """Return the distances that ``pandis.h`` computes, and lower bounds on the true distances.

    Parameters
    ----------
    arrays : dict of str to ndarray
        ``branches``, ``blocks`` and ``packed``, from `pack_mesh`; not checked.
    bits : int
    points : ndarray, shape (n, 3)
    most : int
        Maximum number of face groups and blocks that a query may visit; 0: no limit.

    Returns
    -------
    distance, clear : ndarray, shape (n,), unit frame
        Where ``clear`` is less than ``abs(distance)``, the query was cut short.
    """
    points = np.ascontiguousarray(points, np.float64)
    parts = [np.ascontiguousarray(arrays[name]) for name in Packed._fields]
    distance, clear = np.empty(len(points)), np.empty(len(points))

    def part(low, high):
        start, *out = (array[low:].ctypes.data for array in (points, distance, clear))
        where = [array.ctypes.data for array in parts]
        library.packing_distances(*where, bits, most, start, high - low, *out)

    library = _library()
    in_threads(part, len(points))
    return distance, clear


def _checked(vertices, faces):
    vertices = np.ascontiguousarray(vertices, np.int32)
    faces = np.ascontiguousarray(faces, np.int32)
    if not len(faces) or faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError("faces must not be empty, and must index vertices")
    if vertices.min() < 0 or vertices.max() >> MOST_BITS:
        raise ValueError(f"vertices must be whole numbers from 0 to {(1 << MOST_BITS) - 1:,}")
    if (faces == np.roll(faces, 1, axis=1)).any():
        raise ValueError("a face has two equal corners")
    return vertices, faces


def _library():
    lib = load(Path(__file__).with_name("packing.c"))
    pointer, i32, i64 = ctypes.c_void_p, ctypes.c_int32, ctypes.c_int64
    lib.packing_build.restype = pointer
    lib.packing_build.argtypes = [pointer, i32, pointer, i32, pointer, pointer, pointer]
    lib.packing_part.restype, lib.packing_part.argtypes = pointer, [pointer, i32, pointer]
    lib.packing_distances.argtypes = [*[pointer] * 3, i32, i32, pointer, i64, pointer, pointer]
    lib.packing_free.argtypes = lib.packing_free_rays.argtypes = [pointer]
    lib.packing_rays.restype, lib.packing_rays.argtypes = pointer, [pointer, i32, pointer, i32]
    lib.packing_ray_count.restype = i64
    lib.packing_ray_count.argtypes = [pointer]
    lib.packing_copy_rays.argtypes = [pointer, pointer, pointer]
    return lib
