"""Filling a grid with exact answers. What its nodes hold: see `pandis.fields.grid`."""

import numpy as np

from pandis.forces import penalty_force

#: Nodes evaluated at once: also how often progress is reported.
SLAB = 1 << 14


def node_axis(size):
    """Return the coordinates of a grid's nodes along each axis."""
    return np.linspace(-1.0, 1.0, size)


def bake(engine, content, size, progress):
    """Evaluate the exact field at every node that needs it.

    Parameters
    ----------
    engine : object
        From `pandis.distance.open_distance`.
    content : {"force", "normal"}
    size : int
        Nodes per axis.
    progress : callable
        Makes a `pandis.stage.Progress`.

    Returns
    -------
    ndarray, shape (size, size, size, 3 or 4), float32
        Axes x, y, z.
    """
    axis = node_axis(size)
    values = np.zeros((size**3, 3 if content == "force" else 4), np.float32)
    report = progress("nodes", size**3)
    for start in range(0, size**3, SLAB):
        index = np.arange(start, min(start + SLAB, size**3))
        points = np.stack([axis[i] for i in np.unravel_index(index, (size,) * 3)], axis=1)
        if content == "force":
            # outside the force is zero: only nodes inside ask for a closest point
            inside = engine.inside(points)
            distance, normal = engine.distance_and_normal(points[inside])
            values[index[inside]] = penalty_force(distance, normal)
        else:
            distance, normal = engine.distance_and_normal(points)
            values[index, 0], values[index, 1:] = distance, normal
        report.update(index[-1] + 1)
    return values.reshape(size, size, size, -1)


def grid_attributes(content, size):
    """Describe a grid's geometry, for readers that know nothing of pandis."""
    return {
        "grid": {
            "axes": ["x", "y", "z"],
            "centering": "node",
            "content": content,
            "origin": [-1.0, -1.0, -1.0],
            "spacing": [2.0 / (size - 1)] * 3,
            "unit": "unit frame",
        }
    }
