"""Unpacks a packed mesh as docs/format.md describes it: the reference for ``pandis.h``."""

import numpy as np

from pandis.engine.packing import BLOCK_BYTES, BRANCH_BYTES

_WIDTH, _BOXES, _GROUP = 8, 48, 18
_BRANCH = np.dtype(
    [
        ("origin", "<i4", 3),
        ("shift", "u1", 3),
        ("count", "u1"),
        ("boxes", "u1", (6, _WIDTH)),
        ("child", "<i4", _WIDTH),
    ]
)
_BLOCK = np.dtype([("start", "<u4"), ("counts", "<u4"), ("origin", "<u8")])
assert (_BRANCH.itemsize, _BLOCK.itemsize) == (BRANCH_BYTES, BLOCK_BYTES)


def unpack(arrays):
    """Return the vertices (n, 3) and faces (F, 3) of a compact mesh, int32, in steps.

    A vertex occurs once, even if several blocks share it; faces are in file order.
    """
    blocks, packed = arrays["blocks"].view(_BLOCK), arrays["packed"]
    corners, faces, before = [], [], 0
    for start, counts, origin in blocks.tolist():
        face_count, corner_count = (counts & 63) + 1, (counts >> 6 & 63) + 1
        bits = [counts >> (12 + 5 * k) & 31 for k in range(3)]
        groups, stride = -(-face_count // _WIDTH), sum(bits) // 8 + 1
        at = start + _BOXES
        codes = np.unpackbits(
            packed[at : at + _GROUP * groups].reshape(groups, 3, 6), axis=2, bitorder="little"
        )
        local = codes.reshape(groups, 3, _WIDTH, 6) @ (1 << np.arange(6))
        faces.append(local.swapaxes(1, 2).reshape(-1, 3)[:face_count] + before)
        at += _GROUP * groups
        words = np.zeros((corner_count, 8), np.uint8)
        words[:, :stride] = packed[at : at + stride * corner_count].reshape(-1, stride)
        word, place = words.view("<u8")[:, 0], []
        for k in range(3):
            place.append((word & np.uint64((1 << bits[k]) - 1)) + (origin >> 21 * k & 0x1FFFFF))
            word = word >> np.uint64(bits[k])
        corners.append(np.stack(place, axis=1).astype(np.int64))
        before += corner_count
    corners, faces = np.concatenate(corners), np.concatenate(faces)
    _, first, merged = np.unique(
        corners @ (1 << np.array([40, 20, 0])), return_index=True, return_inverse=True
    )
    return corners[first].astype(np.int32), merged.reshape(-1)[faces].astype(np.int32)
