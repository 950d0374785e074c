"""Exports a mesh's fields as grids of one ``.vdb`` file, which is checked before it is written."""

import numpy as np

from pandis.base.errors import PandisError
from pandis.bridges.vdb.leaves import ALONG, leaves
from pandis.bridges.vdb.reading import read_vdb
from pandis.bridges.vdb.vdb import vdb_bytes
from pandis.pipeline.export.distances import with_distances
from pandis.runtime.field import NativeField

#: Width of the band of distances on each side of the surface, in voxels.
_BAND = 3.0
#: Number of points per query, and of points drawn to check the leaves.
_CHUNK = 1 << 18


def export_volumes(paths, log):
    """Return the bytes of a file with one grid for each field, in mesh units.

    Parameters
    ----------
    paths : list of path-like
        Field files for ``pandis.h``.
    log : pandis.base.progress.Log

    Raises
    ------
    PandisError
        No field has distances, or the file's distances differ from those of its field.
    """
    fields = with_distances([NativeField(path) for path in paths], log)
    low, high = fields[0].bounds
    voxel, volumes = float((high - low).max()) / ALONG, {}
    for field in fields:
        try:
            volumes[field.path.stem] = leaves(field, voxel, _BAND)
        except PandisError as error:
            log(f"{field.path.stem}: left out: {error}")
    if not volumes:
        raise PandisError(
            f"all fields are empty at a voxel size of {voxel:.3g}: remove vdb from export.also, "
            "and write smaller voxels with `pandis volume --voxel`"
        )
    data = vdb_bytes(volumes)
    read = read_vdb(data)
    for field in fields:
        if grid := read.get(field.path.stem):
            _compare(field, grid)
            count = int(grid.active.sum())
            log(f"{field.path.stem}: {count:,} voxels of {voxel:.3g}, with the field's distances")
    return data


def _compare(field, grid):
    """Raise if values or signs differ from the field's, or if voxels omit part of its surface."""
    side = grid.active.shape[1]
    local = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1)
    points = (grid.origins[:, None] + local.reshape(-1, 3)).reshape(-1, 3) * grid.voxel
    parts = [field.query(points[i : i + _CHUNK]).distance for i in range(0, len(points), _CHUNK)]
    distance = np.concatenate(parts).reshape(grid.values.shape)
    expected = np.clip(distance, -grid.background, grid.background).astype(np.float32)
    if not np.array_equal(grid.values, expected):
        raise PandisError(
            f"{field.path.stem}: the volume's distances differ from the field's; this is a defect "
            "of the export: please report it"
        )
    low, high = grid.origins.min(axis=0), grid.origins.max(axis=0) + side
    within = ((grid.tiles > low) & (grid.tiles < high)).all(axis=1)
    inside = field.query(grid.tiles[within] * grid.voxel).distance < 0
    if (grid.outside[within] == inside).any() or not grid.outside[~within].all():
        raise PandisError(
            f"{field.path.stem}: the volume disagrees with the field about inside and outside "
            "where it has no voxels; this is a defect of the export: please report it"
        )
    _check_leaves(field, grid)


def _check_leaves(field, grid):
    """Raise unless the leaves cover all sampled voxels near the surface."""
    rng = np.random.default_rng(0)
    low, high = field.bounds
    voxels = np.rint(rng.uniform(low, high, (_CHUNK, 3)) / grid.voxel).astype(int)
    near = np.abs(field.query(voxels * grid.voxel).distance) < grid.voxel
    origins = {tuple(origin) for origin in grid.origins.tolist()}
    side = grid.active.shape[1]
    blocks = np.unique(np.floor_divide(voxels[near], side) * side, axis=0)
    if not origins.issuperset(map(tuple, blocks.tolist())):
        raise PandisError(
            f"{field.path.stem}: the volume omits part of the surface; this is a defect of the "
            "export: please report it"
        )
