"""A tree over the faces of any mesh, open or closed: exact distances, and winding numbers.

See Jacobson et al. 2013 and Barill et al. 2018; in a closed mesh, winding numbers are counted along
a ray. The tree bounds the cost per point for any mesh. With a hundred thousand faces and many
points whose winding numbers are not whole, the exact sum over all faces would take a quarter of an
hour.
"""

from functools import cached_property

import numpy as np

from pandis.engine.bvh import Bvh
from pandis.pipeline.mesh.topology import compact, edges_of

#: Winding numbers farther than this from an integer are recomputed with finer clusters.
CLEAR = 0.1
#: Distance, in cluster radii, beyond which a cluster replaces its faces: first pass, refinement.
ROUGH, FINE = 3.0, 12.0


class MeshTree:
    """A tree over the faces of a mesh.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), float64
    faces : ndarray, shape (F, 3), int64
    """

    def __init__(self, vertices, faces):
        vertices, faces = compact(vertices, faces)
        self.centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        extent = np.ptp(vertices, axis=0).max()
        self.scale = 1 / extent if extent else 1.0
        # clusters are stored as float32, which requires coordinates of about 1
        self._tree = Bvh(self._to_unit(vertices), faces)
        self._faces = faces

    @cached_property
    def _closed(self):
        return edges_of(self._faces).balanced

    def _to_unit(self, points):
        return np.ascontiguousarray((points - self.centre) * self.scale)

    def distance(self, points):
        """Return the unsigned distance (n,) from points (n, 3) to the mesh."""
        labels = self._tree.label(self._to_unit(points), 0.0, False, feet=False)
        return np.abs(labels.distance) / self.scale

    def closest(self, points):
        """Return the closest points (n, 3) of the mesh, and the faces (n,) on which they lie."""
        labels = self._tree.label(self._to_unit(points), 0.0, False)
        # barycentric coordinates would be noise on slivers
        way = labels.distance[:, None] * np.where(labels.distance[:, None], labels.normal, 0)
        return points - way / self.scale, labels.face

    def first_hits(self, points, ways, skipped, *, least=0.0):
        """Return the lengths (n,) of rays up to the first face: see `Bvh.first_hits`."""
        points, least = self._to_unit(points), least * self.scale
        return self._tree.first_hits(points, ways, skipped, least=least) / self.scale

    def windings(self, points):
        """Return the winding number (n,) at points (n, 3): whole in a closed mesh."""
        points = self._to_unit(points)
        if self._closed:
            return self._tree.turns(points, FINE, closed=True)
        turns = self._tree.turns(points, ROUGH)
        unclear = np.flatnonzero(np.abs(turns - np.round(turns)) > CLEAR)
        if len(unclear):
            turns[unclear] = self._tree.turns(points[unclear], FINE)
        return turns
