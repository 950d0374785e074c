"""Writes grids of floats as ``.vdb`` files of OpenVDB's version 224, with mask compression only.

A tree has three levels: nodes with 32³ children, nodes with 16³ children, and leaves of 8³ voxels.
Regions without leaves have the background value with the sign of their side.
"""

import hashlib
import struct
import uuid

import numpy as np

from pandis.bridges.vdb.leaves import SIDE

MAGIC, VERSION, _LIBRARY = 0x56444220, 224, (10, 0)
#: For each level of inner nodes: number of children per axis, and a node's side length in voxels.
INNER, OUTER = (16, 16 * SIDE), (32, 32 * 16 * SIDE)
#: Grid compression: only active values are stored. Node compression: for each inactive value, a
#: mask selects the outside background or the inside one.
_BY_MASK, BY_SIGN = 2, 3


def vdb_bytes(volumes):
    """Return the content of a ``.vdb`` file with the given volumes.

    Parameters
    ----------
    volumes : dict of str to pandis.bridges.vdb.leaves.Leaves
        Volumes by grid name.
    """
    grids = {name: _grid(name, leaves) for name, leaves in volumes.items()}
    digest = hashlib.sha256(b"".join(part for parts in grids.values() for part in parts)).digest()
    data = struct.pack("<qIIIb", MAGIC, VERSION, *_LIBRARY, 1)
    data += str(uuid.UUID(bytes=digest[:16])).encode() + _entries({})
    data += struct.pack("<i", len(grids))
    for name, (topology, buffers) in grids.items():
        data += _text(name) + _text("Tree_float_5_4_3") + _text("")
        start = len(data) + 24
        data += (
            struct.pack("<3q", start, start + len(topology), start + len(topology) + len(buffers))
            + topology
            + buffers
        )
    return data


def _grid(name, leaves):
    """Return the two parts of a grid: its metadata with its tree, and the values of its leaves."""
    order = _order(leaves.origins)
    origins, values = leaves.origins[order], leaves.values[order]
    active = leaves.active[order]
    masks = []
    for mask, block in zip(active, values, strict=True):
        selected = _bits(block > 0)
        masks.append(_bits(mask) + bytes([BY_SIGN]) + selected + block[mask].tobytes())
    about = {"class": "level set", "name": name, "creator": "pandis"}
    head = struct.pack("<I", _BY_MASK) + _entries(about) + _transform(leaves.voxel)
    return head + _topology(origins, active, leaves), b"".join(masks)


def _order(origins):
    """Return the order of leaves in the tree: by node, and within a node by x, y and z."""
    keys = []
    for _, side in (OUTER, INNER):
        keys += [np.floor_divide(origins, side)[:, k] for k in range(3)]
    keys += [origins[:, k] for k in range(3)]
    return np.lexsort(keys[::-1])


def _topology(origins, active, leaves):
    """Return the tree without voxel values: which entries of its nodes are children or tiles."""
    outer = np.unique(np.floor_divide(origins, OUTER[1]), axis=0)
    parts = [struct.pack("<I", 1), struct.pack("<f", leaves.background)]
    parts.append(struct.pack("<II", 0, len(outer)))
    for place in outer * OUTER[1]:
        here = (np.floor_divide(origins, OUTER[1]) * OUTER[1] == place).all(axis=1)
        parts.append(struct.pack("<3i", *place))
        inner = np.unique(np.floor_divide(origins[here], INNER[1]) * INNER[1], axis=0)
        parts.append(_node(place, inner, OUTER[0], side=INNER[1], leaves=leaves))
        for below in inner:
            inside = (np.floor_divide(origins, INNER[1]) * INNER[1] == below).all(axis=1)
            parts.append(_node(below, origins[inside], INNER[0], side=SIDE, leaves=leaves))
            parts += [_bits(mask) for mask in active[inside]]
    return b"".join(parts)


def _node(place, children, count, *, side, leaves):
    """Return a node's bytes: masks of its children, active tiles (none) and outside tiles."""
    child = np.zeros((count,) * 3, bool)
    child[tuple(((children - place) // side).T)] = True
    tiles = np.argwhere(~child)
    middles = place + side * tiles + (side - 1) / 2
    outside = np.ones_like(child)
    # points beyond the surface's blocks are outside
    low, high = leaves.origins.min(axis=0), leaves.origins.max(axis=0) + SIDE
    within = ((middles > low) & (middles < high)).all(axis=1)
    outside[tuple(tiles[within].T)] = ~leaves.inside(middles[within])
    return _bits(child) + bytes(child.size // 8) + bytes([BY_SIGN]) + _bits(outside)


def _bits(mask):
    return np.packbits(mask.reshape(-1), bitorder="little").tobytes()


def _text(text):
    return struct.pack("<I", len(text)) + text.encode()


def _entries(about):
    """Encode metadata, given as strings by name."""
    parts = [_text(name) + _text("string") + _text(text) for name, text in about.items()]
    return struct.pack("<i", len(parts)) + b"".join(parts)


def _transform(voxel):
    """Return the map from voxels to positions: a scale, with the factors that OpenVDB stores."""
    steps = voxel, voxel, 1 / voxel, 1 / voxel**2, 0.5 / voxel
    return _text("UniformScaleMap") + b"".join(struct.pack("<3d", *[value] * 3) for value in steps)
