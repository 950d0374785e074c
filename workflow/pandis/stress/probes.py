"""Points that the questions are asked at."""

import numpy as np

from pandis.sampling import PROBE_DEPTHS


def shell_points(surface, count, rng):
    """Return points (n, 3) 0 to 0.04 below the surface, and the normals (n, 3) above them."""
    points, normals, _, _ = surface.draw(count, rng)
    depth = rng.uniform(0, PROBE_DEPTHS["deep"], count)
    return points - depth[:, None] * normals, normals


def directions(count, rng):
    """Return unit vectors (n, 3) in all directions."""
    along = rng.normal(size=(count, 3))
    return along / np.linalg.norm(along, axis=1, keepdims=True)
