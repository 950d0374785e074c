"""Writes a field's signed distance as a sparse volume."""

import tempfile
from os import PathLike
from pathlib import Path

import numpy as np

from pandis.base.errors import PandisError
from pandis.base.files import write_atomically
from pandis.bridges.vdb.leaves import ALONG, SIDE, leaves
from pandis.bridges.vdb.vdb import vdb_bytes
from pandis.runtime.field import NativeField, Number


def write_volume(
    field: NativeField,
    path: str | PathLike[str],
    *,
    voxel: Number | None = None,
    band: Number = 3.0,
    length: Number = 1.0,
    name: str = "distance",
) -> None:
    """Write a field's signed distance as an OpenVDB or NanoVDB volume.

    Parameters
    ----------
    field : pandis.runtime.field.NativeField
        Not a grid of forces, which has no distance outside.
    path : path-like
        ``….vdb``; or ``….nvdb``, which needs Warp.
    voxel : float, optional
        Length of a voxel; by default a two-hundredth of the object's longest side.
    band : float
        Width of the band of distances on each side of the surface, in voxels. Beyond it a ``.vdb``
        has the background value with the sign of the side, like any level set. A ``.nvdb`` has the
        negative background value in blocks inside, and the positive one everywhere outside.
    length : float
        Volume units per unit of the field's mesh.
    name : str
        Name of the grid in a ``.vdb``; a ``.nvdb`` uses Warp's name.

    Raises
    ------
    PandisError
        The field is a grid of forces; the path has another suffix; a number is not finite and
        positive; or Warp is missing.
    """
    path = Path(path)
    if path.suffix not in (".vdb", ".nvdb"):
        raise PandisError(f"{path}: the file name must end in .vdb (OpenVDB) or .nvdb (NanoVDB)")
    if not field.has_distance:
        raise PandisError(f"{field.path}: it is a grid of forces, which has no distance outside")
    if voxel is None:
        low, high = field.bounds
        voxel = float((high - low).max()) * length / ALONG
    for what, value in (("voxel", voxel), ("band", band), ("length", length)):
        if not (np.isfinite(value) and value > 0):
            raise PandisError(f"{what}: {value} is not a positive number")
    volume = leaves(
        field, float(voxel), float(band), length=float(length), whole=path.suffix == ".nvdb"
    )
    if path.suffix == ".vdb":
        write_atomically(path, vdb_bytes({name: volume}))
    else:
        _write_nvdb(volume, path)


def _write_nvdb(tree, path):
    """Write a volume with Warp, which treats all space beyond the blocks as outside the object."""
    try:
        import warp as wp
    except ImportError as error:
        raise PandisError('a .nvdb needs Warp: pip install "warp-lang>=1.19"') from error
    with wp.ScopedDevice("cpu"):
        values = wp.array(tree.values.reshape(-1), dtype=float)
        origins = wp.array(tree.origins.astype(np.int32), dtype=wp.vec3i)
        volume = wp.Volume.allocate_by_tiles(
            origins, voxel_size=tree.voxel, bg_value=tree.background
        )
        wp.launch(_fill(), len(tree.origins) * SIDE**3, [volume.id, origins, values])
        with tempfile.TemporaryDirectory() as folder:
            whole = Path(folder) / "volume.nvdb"
            volume.save_to_nvdb(str(whole))
            write_atomically(path, whole.read_bytes())


def _fill():
    from pandis.engine.cuda.volumes import fill

    return fill
