"""Points in the layout that C expects."""

import numpy as np


def as_rows(points):
    """Return points as a contiguous array (n, 3) of doubles; accepts one point as (3,)."""
    if np.iscomplexobj(points):
        raise ValueError("points must be real numbers")
    array = np.ascontiguousarray(points, np.float64)
    if array.shape == (3,):
        return array[None]
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"points must be an array of shape (n, 3), not {array.shape}")
    return array
