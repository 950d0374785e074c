"""Reads the ``.vdb`` files that `vdb` writes; other layouts are not supported."""

import struct
from typing import NamedTuple

import numpy as np

from pandis.base.errors import PandisError
from pandis.bridges.vdb.leaves import SIDE
from pandis.bridges.vdb.vdb import BY_SIGN, INNER, MAGIC, OUTER, VERSION


class Grid(NamedTuple):
    """A grid in a ``.vdb`` file.

    Attributes
    ----------
    origins : ndarray, shape (n, 3)
        The first voxel of each leaf.
    values : ndarray, shape (n, 8, 8, 8), float32
        Inactive voxels have the background value with the sign of their side.
    active : ndarray, shape (n, 8, 8, 8), bool
        Whether the value of a voxel is stored.
    tiles : ndarray, shape (m, 3)
        Centres of the tiles (regions without leaves), in voxels.
    outside : ndarray, shape (m,), bool
        Whether the tiles are outside.
    voxel, background : float
    """

    origins: np.ndarray
    values: np.ndarray
    active: np.ndarray
    tiles: np.ndarray
    outside: np.ndarray
    voxel: float
    background: float


class _Reader:
    """Bytes, and the position of the next one to read."""

    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, layout):
        values = struct.unpack_from("<" + layout, self.data, self.at)
        self.at += struct.calcsize("<" + layout)
        return values

    def text(self):
        (length,) = self.take("I")
        self.at += length
        return self.data[self.at - length : self.at].decode()

    def bits(self, side):
        count = side**3 // 8
        packed = np.frombuffer(self.data, np.uint8, count, self.at)
        self.at += count
        return np.unpackbits(packed, bitorder="little").astype(bool)

    def sides(self):
        (how,) = self.take("b")
        if how != BY_SIGN:
            raise ValueError(f"unknown storage of values: {how}")

    def entries(self):
        (count,) = self.take("i")
        return {self.text(): (self.text(), self.text()) for _ in range(count)}


def read_vdb(data):
    """Return the grids of a file, by name.

    Raises
    ------
    PandisError
        The file was not written by `vdb`.
    """
    reader = _Reader(data)
    try:
        magic, version = reader.take("qI")
        if (magic, version) != (MAGIC, VERSION):
            raise ValueError("its magic number or version is unknown")
        reader.take("IIb36s")
        reader.entries()
        (count,) = reader.take("i")
        return dict(_grid(reader) for _ in range(count))
    except (struct.error, ValueError) as error:
        raise PandisError(f"this is not a volume that pandis wrote: {error}") from error


def _grid(reader):
    name, _, _ = reader.text(), reader.text(), reader.text()
    first, buffers, end = reader.take("3q")
    if first != reader.at:
        raise ValueError("its grids do not begin at the stored offset")
    reader.take("I")
    reader.entries()
    reader.text()
    voxel = reader.take("15d")[0]
    _, background, _, outer = reader.take("IfII")
    origins, masks, tiles = [], [], []
    for _ in range(outer):
        place = np.array(reader.take("3i"))
        for below in _children(reader, place, OUTER[0], length=INNER[1], tiles=tiles):
            leaves = _children(reader, below, INNER[0], length=SIDE, tiles=tiles)
            origins.append(leaves)
            masks += [reader.bits(SIDE) for _ in leaves]
    if buffers != reader.at:
        raise ValueError("its voxels do not begin at the stored offset")
    active = np.array(masks).reshape(-1, SIDE**3)
    values = np.empty(active.shape, np.float32)
    for mask, block in zip(active, values, strict=True):
        if not np.array_equal(reader.bits(SIDE), mask):
            raise ValueError("a leaf's mask differs from that in the tree")
        reader.sides()
        block[:] = np.where(reader.bits(SIDE), background, -background)
        count = int(mask.sum())
        block[mask] = np.frombuffer(reader.data, "<f4", count, reader.at)
        reader.at += 4 * count
    if end != reader.at:
        raise ValueError("its grids do not end at the stored offset")
    shape = (-1, SIDE, SIDE, SIDE)
    middles, outside = (np.concatenate(parts) for parts in zip(*tiles, strict=True))
    return name, Grid(
        np.concatenate(origins),
        values.reshape(shape),
        active.reshape(shape),
        middles,
        outside,
        voxel,
        background,
    )


def _children(reader, place, side, *, length, tiles):
    """Return the first voxels of a node's children, each ``length`` voxels wide; add its tiles."""
    child, _ = reader.bits(side), reader.bits(side)
    reader.sides()
    outside = reader.bits(side)
    where = np.argwhere(~child.reshape(side, side, side))
    tiles.append((place + length * where + (length - 1) / 2, outside[~child]))
    return place + length * np.argwhere(child.reshape(side, side, side))
