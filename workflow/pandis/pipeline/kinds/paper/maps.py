"""Support planes with distance maps, as far as [16] (Moustakas 2015) describes them.

There are 642 directions, the vertices of an icosahedron subdivided three times. Each has a plane
that touches the shape, and a map of the surface's depth below that plane. In this implementation
the maps are rasters. If the shape is not convex, they contain only its outermost surface.
"""

import numpy as np
from trimesh.creation import icosphere

SUBDIVISIONS = 3
#: Pixels per axis of a map.
SIZE = 64
#: Distance from the surface within which a ray counts as a hit, and its maximum number of steps.
_HIT, _STEPS = 1e-6, 96
#: Rays start at this height above their plane, because a tessellation touches it from below.
_ABOVE = 1e-3


def plane_axes(normals):
    """Return two arrays (n, 3) of unit vectors that span the planes with normals (n, 3)."""
    helper = np.where(np.abs(normals[:, :1]) < 0.6, [1.0, 0, 0], [0, 1.0, 0])
    one = np.cross(normals, helper)
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    return one, np.cross(normals, one)


def build_planes(vertices, engine, progress):
    """Return the support planes and maps of a shape.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), unit frame
    engine : object
        The exact distance of a `pandis.pipeline.geometry.body.Body`.
    progress : pandis.base.progress.Progress

    Returns
    -------
    dict of str to ndarray
        ``normals`` n (642, 3) and ``offsets`` h (642,) of the planes n·x = h; ``maps``
        (642, 64, 64), the depth below each plane at ``linspace(-radius, radius, 64)`` along both
        `plane_axes`; ``radius`` (). All float32. Where a ray hits nothing, the depth is that of
        the far side.
    """
    normals = np.array(icosphere(SUBDIVISIONS).vertices)
    offsets = np.concatenate([(part @ vertices.T).max(1) for part in np.array_split(normals, 20)])
    radius = float(np.linalg.norm(vertices, axis=1).max())
    axis = np.linspace(-radius, radius, SIZE)
    ones, others = plane_axes(normals)
    maps = np.empty((len(normals), SIZE, SIZE), np.float32)
    report = progress("planes", len(normals), "planes")
    for start in range(0, len(normals), 32):
        part = slice(start, start + 32)
        normal = np.repeat(normals[part], SIZE**2, axis=0)
        origin = (
            ((offsets[part] + _ABOVE)[:, None] * normals[part])[:, None, None]
            + axis[:, None, None] * ones[part][:, None, None]
            + axis[:, None] * others[part][:, None, None]
        ).reshape(-1, 3)
        depth = _march(engine, origin, -normal, longest=2 * radius) - _ABOVE
        maps[part] = depth.reshape(-1, SIZE, SIZE)
        report.update(min(start + 32, len(normals)))
    return {
        "normals": normals.astype(np.float32),
        "offsets": offsets.astype(np.float32),
        "maps": maps,
        "radius": np.float32(radius),
    }


def _march(engine, origin, along, *, longest):
    """Sphere-trace rays to the surface; return their lengths (n,), at most ``longest``."""
    way = np.zeros(len(origin))
    going = np.arange(len(origin))
    for _ in range(_STEPS):
        distance, _ = engine.distance_and_normal(
            origin[going] + way[going, None] * along[going], check=False
        )
        way[going] += distance
        going = going[(distance > _HIT) & (way[going] < longest)]
        if not len(going):
            break
    way[going] = longest
    return np.minimum(way, longest)
