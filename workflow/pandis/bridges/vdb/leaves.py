"""Distances at the voxels near a surface, in blocks of 8³, as in sparse volumes."""

from typing import NamedTuple

import numpy as np

from pandis.base.errors import PandisError

#: Voxels along a block.
SIDE = 8
#: Default number of voxels along the object's longest side.
ALONG = 200
#: Points per call, and maximum number of blocks that may be examined.
_CHUNK, _MOST = 1 << 18, 1 << 27


class Leaves(NamedTuple):
    """Blocks of voxels, and a function that tells which points beyond them are inside.

    Attributes
    ----------
    origins : ndarray, shape (n, 3)
        The first voxel of each block: multiples of 8. Voxel i is at ``i * voxel``.
    values : ndarray, shape (n, 8, 8, 8), float32
        Distances, clipped to the background.
    voxel, background : float
        Length of a voxel, and largest distance stored, both in volume units.
    inside : callable
        Maps points (n, 3), in voxels, to a mask (n,) of those inside.
    """

    origins: np.ndarray
    values: np.ndarray
    voxel: float
    background: float
    inside: object

    @property
    def active(self):
        """Mask (n, 8, 8, 8) of the voxels whose absolute distance is below the background."""
        return np.abs(self.values) < np.float32(self.background)


def leaves(field, voxel, band, *, length=1.0, whole=False):
    """Return the `Leaves` of a field.

    Parameters
    ----------
    field : pandis.runtime.field.NativeField
    voxel : float
        Length of a voxel, in volume units.
    band : float
        Width of the band of distances on each side of the surface, in voxels.
    length : float
        Volume units per unit of the field's mesh.
    whole : bool
        Whether to also keep the blocks that are inside the surface but beyond the band.

    Raises
    ------
    PandisError
        Voxels are so small that there are too many blocks, or so large that none is inside.
    """
    background = voxel * band

    def distance(voxels):
        parts = [
            field.query(voxels[i : i + _CHUNK] * (voxel / length)).distance * length
            for i in range(0, len(voxels), _CHUNK)
        ]
        return np.concatenate(parts) if parts else np.zeros(0)

    low, high = (np.array(end) * length / voxel for end in field.bounds)
    first = np.floor((low - band) / SIDE).astype(int)
    count = np.floor((high + band) / SIDE).astype(int) - first + 1
    if np.prod(count.astype(float)) > _MOST:
        raise PandisError(f"voxel: {voxel:g} is so small that there are more than {_MOST:,} blocks")
    blocks = np.stack(np.meshgrid(*map(np.arange, count), indexing="ij"), axis=-1).reshape(-1, 3)
    origins = SIDE * (blocks + first)
    middle = distance(origins + (SIDE - 1) / 2)
    radius = voxel * np.sqrt(3) * (SIDE - 1) / 2
    near = np.abs(middle) < background + radius
    if whole:
        near |= middle < 0
    origins = origins[near]
    local = np.stack(np.meshgrid(*[np.arange(SIDE)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    values = distance((origins[:, None] + local).reshape(-1, 3))
    if not (values < 0).any():
        raise PandisError(f"voxel: {voxel:g} is so large that no voxel lies inside")
    values = np.clip(values, -background, background).astype(np.float32)
    return Leaves(
        origins,
        values.reshape(-1, SIDE, SIDE, SIDE),
        voxel,
        background,
        lambda voxels: distance(voxels) < 0,
    )
