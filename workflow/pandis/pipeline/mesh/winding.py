"""Winding numbers of a mesh, closed or not: by a tree, as finely as they must be known.

Jacobson et al. 2013; Barill et al. 2018. The price of a point is bounded by the tree, whatever the
mesh: a sum over all faces, which is exact, takes a quarter of an hour where many points lie between
whole numbers and there are a hundred thousand faces.
"""

import numpy as np

from pandis.engine.bvh import Bvh

#: A number is believed this far from a whole one; else it is asked again, with finer clusters.
CLEAR = 0.1
#: How far away, in radii, a cluster of faces counts as one: at first, and where that is unclear.
ROUGH, FINE = 3.0, 12.0


class WindingNumber:
    """The winding number of a mesh, closed or not.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), float64
    faces : ndarray, shape (F, 3), int64
    """

    def __init__(self, vertices, faces):
        used, index = np.unique(faces, return_inverse=True)
        corners = vertices[used]
        self.centre = (corners.min(axis=0) + corners.max(axis=0)) / 2
        self.scale = 1 / np.ptp(corners, axis=0).max()
        # clusters are float32: they need coordinates of size 1
        self._tree = Bvh((corners - self.centre) * self.scale, index.reshape(-1, 3))

    def __call__(self, points):
        """Return the winding number (n,) at points (n, 3)."""
        points = np.ascontiguousarray((points - self.centre) * self.scale)
        turns = self._tree.turns(points, ROUGH)
        unclear = np.flatnonzero(np.abs(turns - np.round(turns)) > CLEAR)
        if len(unclear):
            turns[unclear] = self._tree.turns(points[unclear], FINE)
        return turns
