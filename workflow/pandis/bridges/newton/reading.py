"""Samples a cooked file in NumPy, like Newton's sampler that interpolates in software."""

import numpy as np

from pandis.bridges.newton.cells import LINEAR


def sample(content, points):
    """Return distances (n,) and gradients (n, 3) at points (n, 3), metres.

    Parameters
    ----------
    content : mapping
        Content of a file: ``numpy.load(path)``.
    """
    low, cell, size = content["min_extents"], content["cell_size"], int(content["subgrid_size"])
    dims, slots = np.array(content["coarse_dims"]), content["subgrid_start_slots"]
    most = {1: 255.0, 2: 65535.0, 4: 1.0}[int(content["quantization_mode"])]
    scale, offset = (
        float(content["subgrids_sdf_value_range"]) / most,
        float(content["subgrids_min_sdf_value"]),
    )
    inside = np.clip(points, low, low + dims * size * cell)
    at = (inside - low) / cell
    whole = np.clip(np.floor(at).astype(int), 0, dims * size - 1)
    block = whole // size
    slot = slots[tuple(block.T)]
    fine = slot < LINEAR
    # first of the eight corners, in the packed blocks or in the coarse grid
    start = np.stack([slot & 1023, slot >> 10 & 1023, slot >> 20 & 1023], axis=-1).astype(int)
    first = np.where(fine[:, None], start * (size + 1) + whole - block * size, block)
    share = np.where(fine[:, None], at - whole, at / size - block)
    step = np.where(fine[:, None], cell, size * cell)
    corners = np.empty((len(points), 2, 2, 2))
    for x, y, z in np.ndindex(2, 2, 2):
        i, j, k = (first + (x, y, z)).T
        corners[fine, x, y, z] = offset + scale * content["subgrid_data"][k[fine], j[fine], i[fine]]
        corners[~fine, x, y, z] = content["coarse_sdf"][k[~fine], j[~fine], i[~fine]]
    a = np.stack([1 - share, share], axis=1)
    slope = np.array([-1.0, 1.0])
    distance = np.einsum("nijk,ni,nj,nk->n", corners, a[:, :, 0], a[:, :, 1], a[:, :, 2])
    gradient = np.stack([
        np.einsum("nijk,i,nj,nk->n", corners, slope, a[:, :, 1], a[:, :, 2]),
        np.einsum("nijk,ni,j,nk->n", corners, a[:, :, 0], slope, a[:, :, 2]),
        np.einsum("nijk,ni,nj,k->n", corners, a[:, :, 0], a[:, :, 1], slope),
    ], axis=-1) / step  # fmt: skip
    way = points - inside
    off = np.linalg.norm(way, axis=1)
    gradient[off > 0] = way[off > 0] / off[off > 0, None]
    return distance + off, gradient
