"""Tricubic B-splines over a box: the binding of ``spline.c``.

Unser 1999, Splines: a perfect fit for signal and image processing.
"""

import ctypes
from pathlib import Path

import numpy as np

from pandis.engine.compiler import load
from pandis.engine.threads import in_threads

#: Nodes per axis of a block, and blocks per axis of a brick.
BLOCK, BRICK = 2, 4
_NO_BRICK = 65535
#: Coordinates are clipped to ±EDGE, so the faces of the box [-1, 1]³ belong to its last cells.
EDGE = 1 - 1e-12
#: Number of parts of a parallel sum: fixed, so that results do not depend on the thread count.
_PARTS = 2


class _Layout(ctypes.Structure):
    _fields_ = (
        ("size", ctypes.c_int32),
        ("bricks", ctypes.c_int32),
        ("low", ctypes.c_double),
        ("per_step", ctypes.c_double),
        ("brick", ctypes.c_void_p),
        ("mask", ctypes.c_void_p),
        ("base", ctypes.c_void_p),
    )


def library():
    """Return the compiled library with its functions' types declared."""
    lib = load(Path(__file__).with_name("spline.c"))
    pointer, i32, i64, f64 = ctypes.c_void_p, ctypes.c_int32, ctypes.c_int64, ctypes.c_double
    lib.spline_dense_evaluate.argtypes = [i32, f64, f64, pointer, pointer, i64, pointer, pointer]
    lib.spline_dense_adjoint.argtypes = [i32, f64, f64, pointer, i64, pointer, pointer, pointer]
    lib.spline_evaluate.argtypes = [pointer, pointer, i32, pointer, i64, *[pointer] * 3]
    return lib


class Lattice:
    """The lattice of a spline: ``size`` nodes per axis, from ``low`` to ``-low``.

    The spline is defined where a point has two nodes on either side: [low + step, -low - step].
    """

    def __init__(self, size, low=-1.0):
        self.size, self.low = int(size), float(low)
        self.per_step = (self.size - 1) / (-2 * self.low)
        self.step = 1 / self.per_step
        self._library = library()

    @classmethod
    def around_box(cls, cells):
        """Return the lattice that covers the box [-1, 1]³ with ``cells`` cells per axis."""
        return cls(cells + 3, -1 - 2 / cells)

    def places(self, nodes):
        """Return the positions (n, 3) of nodes with flat indices (n,)."""
        index = np.stack(np.unravel_index(nodes, (self.size,) * 3), axis=1)
        return self.low + self.step * index

    def evaluate(self, coefficients, points):
        """Return values (n,) and gradients (n, 3), from coefficients at all nodes.

        Parameters
        ----------
        coefficients : ndarray, shape (size, size, size), float32
        points : ndarray, shape (n, 3)
        """
        coefficients = np.ascontiguousarray(coefficients, np.float32)
        points = np.ascontiguousarray(points, np.float64)
        value, gradient = np.empty(len(points)), np.empty((len(points), 3))

        def part(low, high):
            self._library.spline_dense_evaluate(
                self.size, self.low, self.per_step, coefficients.ctypes.data,
                points[low:].ctypes.data, high - low,
                value[low:].ctypes.data, gradient[low:].ctypes.data,
            )  # fmt: skip

        in_threads(part, len(points))
        return value, gradient

    def adjoint(self, points, value, gradient):
        """Return the adjoint of `evaluate`: residuals (n,) and (n, 3), summed per node (size³,)."""
        points, value, gradient = (
            np.ascontiguousarray(a, np.float64) for a in (points, value, gradient)
        )

        def part(low, high):
            sums = np.zeros(self.size**3)
            self._library.spline_dense_adjoint(
                self.size, self.low, self.per_step, points[low:].ctypes.data, high - low,
                value[low:].ctypes.data, gradient[low:].ctypes.data, sums.ctypes.data,
            )  # fmt: skip
            return sums

        parts = in_threads(part, len(points), _PARTS)
        total = parts[0]
        for more in parts[1:]:
            total += more
        return total


class SparseSpline:
    """A spline that stores only some blocks of coefficients.

    Parameters
    ----------
    lattice : Lattice
    masks : ndarray, shape (bricks, bricks, bricks), uint64
        For each brick, 64 bits that mark which of its blocks are stored.
    coefficients : ndarray, shape (blocks, 8), float32
        Ordered by brick and, within each brick, by bit.
    """

    def __init__(self, lattice, masks, coefficients):
        self.lattice = lattice
        blocks = masks.reshape(-1)
        occupied = np.flatnonzero(blocks)
        if len(occupied) >= _NO_BRICK:
            raise ValueError(f"{len(occupied):,} bricks are too many")
        self._brick = np.full(len(blocks), _NO_BRICK, np.uint16)
        self._brick[occupied] = np.arange(len(occupied))
        self._mask = np.ascontiguousarray(blocks[occupied], np.uint64)
        counts = np.bitwise_count(self._mask).astype(np.int64)
        if counts.sum() != len(coefficients):
            raise ValueError("the number of coefficient blocks differs from the number of bits set")
        self._base = (np.cumsum(counts) - counts).astype(np.uint32)
        self._blank, self.bricks = coefficients.size, len(masks)
        self._coefficients = np.append(coefficients.reshape(-1), 0).astype(np.float32)
        self._layout = _Layout(
            lattice.size,
            len(masks),
            lattice.low,
            lattice.per_step,
            *(array.ctypes.data for array in (self._brick, self._mask, self._base)),
        )
        self._library = library()

    @property
    def index(self):
        """Brick numbers by position, the bricks' masks, and the number of blocks before each."""
        return self._brick, self._mask, self._base

    @property
    def index_bytes(self):
        """Size in bytes of the arrays that locate coefficients."""
        return self._brick.nbytes + self._mask.nbytes + self._base.nbytes

    def add(self, points, value, gradient):
        """Add the spline to values (n,) and gradients (n, 3) at points (n, 3).

        Returns
        -------
        ndarray, shape (n,), uint8
            0 where no coefficient is stored, 1 where some are, 2 where all 64 are.
        """
        covered = np.empty(len(points), np.uint8)

        def part(low, high):
            self._library.spline_evaluate(
                ctypes.byref(self._layout), self._coefficients.ctypes.data, self._blank,
                points[low:].ctypes.data, high - low, value[low:].ctypes.data,
                gradient[low:].ctypes.data, covered[low:].ctypes.data,
            )  # fmt: skip

        in_threads(part, len(points))
        return covered


def pack(blocks):
    """Return the bricks' masks, given a bool array (b, b, b) that marks the blocks to store.

    ``b`` must be a multiple of four.
    """
    n = len(blocks) // BRICK
    split = blocks.reshape(n, BRICK, n, BRICK, n, BRICK).transpose(0, 2, 4, 1, 3, 5)
    bits = split.reshape(n, n, n, BRICK**3).astype(np.uint64)
    return (bits << np.arange(BRICK**3, dtype=np.uint64)).sum(axis=-1, dtype=np.uint64)


def kept_nodes(masks):
    """Return the nodes (blocks, 8, 3) of the stored blocks, in the order of their coefficients."""
    n = len(masks)
    bits = (masks.reshape(-1, 1) >> np.arange(BRICK**3, dtype=np.uint64)) & np.uint64(1)
    brick, bit = np.nonzero(bits)
    bit = np.stack(np.unravel_index(bit, (BRICK,) * 3), axis=1)
    block = BRICK * np.stack(np.unravel_index(brick, (n,) * 3), axis=1) + bit
    corner = np.stack(np.unravel_index(np.arange(BLOCK**3), (BLOCK,) * 3), axis=1)
    return BLOCK * block[:, None] + corner


def block_count(size):
    """Return how many blocks per axis cover ``size`` nodes, rounded up to whole bricks."""
    return -(-size // (BLOCK * BRICK)) * BRICK
