"""Winding numbers of an open or closed mesh, computed with a tree and refined where unclear.

See Jacobson et al. 2013 and Barill et al. 2018. The tree bounds the cost per point for any mesh.
With a hundred thousand faces and many points whose winding numbers are not whole, the exact sum
over all faces would take a quarter of an hour.
"""

import numpy as np

from pandis.engine.bvh import Bvh
from pandis.pipeline.mesh.topology import compact

#: Winding numbers farther than this from an integer are recomputed with finer clusters.
CLEAR = 0.1
#: Distance, in cluster radii, beyond which a cluster replaces its faces: first pass, refinement.
ROUGH, FINE = 3.0, 12.0


class WindingNumber:
    """The winding number of an open or closed mesh.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), float64
    faces : ndarray, shape (F, 3), int64
    """

    def __init__(self, vertices, faces):
        corners, faces = compact(vertices, faces)
        self.centre = (corners.min(axis=0) + corners.max(axis=0)) / 2
        self.scale = 1 / np.ptp(corners, axis=0).max()
        # clusters are stored as float32, which requires coordinates of about 1
        self._tree = Bvh((corners - self.centre) * self.scale, faces)

    def __call__(self, points):
        """Return the winding number (n,) at points (n, 3)."""
        points = np.ascontiguousarray((points - self.centre) * self.scale)
        turns = self._tree.turns(points, ROUGH)
        unclear = np.flatnonzero(np.abs(turns - np.round(turns)) > CLEAR)
        if len(unclear):
            turns[unclear] = self._tree.turns(points[unclear], FINE)
        return turns
