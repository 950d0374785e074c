"""Fields for Newton: files for its cache of cooked distances, made from ``.pandis`` fields.

Newton looks for such a file before it bakes distances itself. The file's name is a hash of the mesh
and the options. Cooking needs only NumPy, not Newton or a GPU.
"""

import hashlib
import json
from os import PathLike, replace
from pathlib import Path
from typing import Any

import numpy as np

from pandis.base.errors import PandisError
from pandis.bridges.newton.cells import EMPTY, LINEAR, NODES, Grid, build
from pandis.runtime.field import NativeField, Number

#: Version of Newton's cache format, and the release whose code defines it.
VERSION, RELEASE = 2, "1.8.0"
#: Storage formats of node values: bytes per value, and its NumPy type.
FORMATS = {"uint8": (1, np.uint8), "uint16": (2, np.uint16), "float32": (4, np.float32)}
_KIND = "newton.texture_sdf"
#: Maximum number of packed blocks along an axis: a position has ten bits.
_MOST = 1023
#: Largest accepted median distance of vertices from the surface, as a share of the longest side.
_APART = 0.02


def cook(field: NativeField, mesh: Any, folder: str | PathLike[str], **options: Any) -> Path:
    """Write the file that Newton's ``mesh.build_sdf(cache_dir=folder, ...)`` reads.

    Parameters
    ----------
    field, mesh, options
        As for `cooked`.
    folder : path-like
        Created if necessary.

    Raises
    ------
    PandisError
        As `cooked` does.
    """
    name, content = cooked(field, mesh, **options)
    return put(folder, name, content)


def put(folder: str | PathLike[str], name: str, content: dict[str, Any]) -> Path:
    """Write the result of `cooked` into Newton's cache folder, atomically."""
    path = Path(folder) / f"{name}.sdf.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f"{path.name}.part.npz")  # NumPy would add a missing suffix
    np.savez(beside, **content)
    replace(beside, path)
    return path


def cooked(  # noqa: PLR0913 - the options of Newton's function
    field: NativeField,
    mesh: Any,
    *,
    length: Number = 1.0,
    max_resolution: int | None = None,
    target_voxel_size: Number | None = None,
    narrow_band_range: tuple[Number, Number] = (-0.1, 0.1),
    margin: Number = 0.05,
    texture_format: str = "uint16",
    sign_method: str = "auto",
    scale: tuple[Number, Number, Number] | None = None,
    fitted: bool = True,
    progress: Any = lambda done, total: None,
) -> tuple[str, dict[str, Any]]:
    """Return the name and content of a file for Newton's cache.

    Parameters
    ----------
    field : pandis.runtime.field.NativeField
        Preferably one with exact distances: an exact or a compact mesh.
    mesh : newton.Mesh
        Or an object with attributes ``vertices``, ``indices``, ``is_solid``, ``is_watertight``.
    length : float
        Metres per unit of the field's mesh.
    max_resolution, target_voxel_size, narrow_band_range, margin, texture_format, sign_method, scale
        Newton's options. Newton finds the file only if it is called with the same values.
    fitted : bool
        Whether to choose node values that minimise the error of Newton's interpolation, rather
        than the distances at the nodes.
    progress : callable
        Called as ``progress(done, total)``, in points.

    Returns
    -------
    name : str
    content : dict of str to ndarray

    Raises
    ------
    PandisError
        Mesh and field do not coincide, an option has an invalid value, or the grid is too fine for
        Newton's layout.

    Notes
    -----
    The layout is that of Newton 1.8.0 (``newton/_src/geometry/_sdf_cache.py``).
    """
    if texture_format not in FORMATS:
        raise PandisError(f"texture_format: {texture_format!r} is none of {', '.join(FORMATS)}")
    if scale is not None and len(set(scale)) > 1:
        raise PandisError(
            f"scale: a field cannot be stretched: the factors must be equal, not {scale}"
        )
    if max_resolution is None and target_voxel_size is None:
        max_resolution = 64
    for name, resolution in (
        ("max_resolution", max_resolution),
        ("target_voxel_size", target_voxel_size),
    ):
        if resolution is not None and not resolution > 0:
            raise PandisError(f"{name}: {resolution} is not a positive number")
    metres = float(length) * float(scale[0] if scale else 1)
    vertices = np.asarray(mesh.vertices, np.float32).reshape(-1, 3)
    vertices = vertices * np.array(scale or (1, 1, 1), np.float32)
    if not len(vertices):
        raise PandisError("the mesh has no vertices")

    def distance(points):
        return field.query(points / metres).distance * metres

    if not field.has_distance:
        raise PandisError(f"{field.path}: it is a grid of forces, which has no distance outside")
    _check_place(distance, vertices)
    grid = Grid.around(vertices, margin, max_resolution, voxel=target_voxel_size)
    band = max(abs(float(side)) for side in narrow_band_range)
    cells = build(distance, grid, band, fitted=fitted, progress=progress)
    content = arrays(cells, grid, texture_format)
    return hashed(mesh, vertices, {
        "narrow_band_range": [float(side) for side in narrow_band_range],
        "target_voxel_size": None if target_voxel_size is None else float(target_voxel_size),
        "max_resolution": max_resolution,
        "margin": float(margin),
        "texture_format": texture_format,
        "sign_method_resolved": _sign_method(mesh, sign_method),
        "winding_threshold_sign": 1,
        "scale": None if scale is None else [float(side) for side in scale],
    }), content  # fmt: skip


def arrays(cells, grid, texture_format):
    """Return the arrays of a cache file, keyed by Newton's names."""
    coarse, blocks, values, flat = cells
    mode, kind = FORMATS[texture_format]
    places, count = blocks.places, len(blocks.places)
    side = next(n for n in range(1, count + 2) if n**3 >= count)
    if side > _MOST:
        raise PandisError(
            "max_resolution: there are more blocks near the surface than Newton can address"
        )
    # Newton numbers blocks with x varying fastest
    order = np.lexsort(places.T)
    required = np.zeros(grid.blocks[::-1], np.int32)
    required[tuple(places.T[::-1])] = 1
    slots = np.full(grid.blocks, EMPTY, np.uint32)
    slots[tuple(flat.T)] = LINEAR
    packed = np.zeros((side * NODES,) * 3 if count else (1, 1, 1))
    low, high = (float(values.min()), float(values.max())) if count else (0.0, 1.0)
    for number, block in enumerate(order):
        z, rest = divmod(number, side * side)
        y, x = divmod(rest, side)
        slots[tuple(places[block])] = x | y << 10 | z << 20
        here = [slice(NODES * at, NODES * (at + 1)) for at in (z, y, x)]
        packed[tuple(here)] = values[blocks.index[block]].transpose(2, 1, 0)
    if mode == FORMATS["float32"][0] or not count:
        kind, low, high = np.float32, 0.0, 1.0
    else:
        most = np.iinfo(kind).max
        packed = np.rint(np.clip((packed - low) / (high - low), 0, 1) * most)
    whole = {
        "subgrid_tex_size": packed.shape[0], "num_subgrids": count, "subgrid_size": NODES - 1,
        "quantization_mode": mode, "__cache_format_version__": VERSION,
    }  # fmt: skip
    real = {"subgrids_min_sdf_value": low, "subgrids_sdf_value_range": high - low}
    places = {"min_extents": grid.low, "cell_size": grid.cell,
              "max_extents": grid.low + grid.blocks * (NODES - 1) * grid.cell}  # fmt: skip
    return {
        "coarse_sdf": np.ascontiguousarray(coarse.transpose(2, 1, 0), np.float32),
        "subgrid_data": packed.astype(kind),
        "subgrid_start_slots": slots,
        "subgrid_required": required.ravel(),
        "coarse_dims": grid.blocks.astype(np.int32),
        **{name: np.asarray(value, np.int32) for name, value in whole.items()},
        **{name: np.asarray(value, np.float32) for name, value in real.items()},
        **{name: np.asarray(value, np.float64) for name, value in places.items()},
        "__kind__": np.asarray(_KIND),
        "__newton_version__": np.asarray(RELEASE),
        "__created_utc__": np.asarray(""),
    }


def hashed(mesh, vertices, options):
    """Return Newton's cache name for a mesh and its options."""
    indices = np.ascontiguousarray(np.asarray(mesh.indices).reshape(-1), np.int32)
    facts = {
        "kind": _KIND,
        "cache_format_version": VERSION,
        "mesh": {
            "vertices_sha256": hashlib.sha256(
                np.ascontiguousarray(vertices, np.float32)
            ).hexdigest(),
            "indices_sha256": hashlib.sha256(indices).hexdigest(),
            "num_vertices": len(vertices),
            "num_triangles": len(indices) // 3,
            "is_solid": bool(getattr(mesh, "is_solid", True)),
        },
        "build_params": options,
    }
    text = json.dumps(facts, sort_keys=True, separators=(",", ":"))
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def _sign_method(mesh, options):
    """Return Newton's method of finding signs, which is part of the cache name."""
    if options != "auto":
        return options
    return "parity" if mesh.is_watertight else "winding"


def _check_place(distance, vertices):
    """Raise PandisError if mesh and field do not match, usually because their units differ."""
    some = vertices[:: max(1, len(vertices) // 10_000)].astype(float)
    apart = np.median(np.abs(distance(some)))
    longest = float(np.ptp(vertices, axis=0).max())
    if not apart <= _APART * longest:
        raise PandisError(
            f"the mesh's vertices are {apart:.3g} m from the field's surface (median), and the "
            f"mesh is {longest:.3g} m long: is `length` in metres per unit of the field?"
        )
