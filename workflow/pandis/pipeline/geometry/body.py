"""The body: one object with its frame, its exact distance and its surface.

A `Body` provides the exact data of an object. It is opened from the mesh stage's artifact or made
from plain arrays. Bodies of meshes and of closed forms have the same members.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from pandis.base.frame import Frame
from pandis.pipeline.geometry.distance import MeshDistance, ShapeDistance
from pandis.pipeline.geometry.sampling import Surface
from pandis.pipeline.geometry.shapes import find_shape


class Regions(NamedTuple):
    """Materials of the faces: each face's index (F,) into the names, and the materials' names."""

    of_face: np.ndarray
    names: tuple


class Body:
    """A mesh, or a closed-form shape with a tessellation.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), float64, mesh units
    faces : ndarray, shape (F, 3), integer
    frame : Frame, optional
        By default the frame of the bounding box.
    shape : str, optional
        Name of the closed form (`pandis.pipeline.geometry.shapes`) that the mesh approximates.
    regions : Regions, optional
    """

    def __init__(self, vertices, faces, frame=None, *, shape=None, regions=None):
        self.vertices, self.faces, self.shape = vertices, faces, shape
        self.regions = regions
        self.frame = frame or Frame.of_bounds(vertices.min(axis=0), vertices.max(axis=0))

    @classmethod
    def open(cls, mesh):
        """Open the body of an artifact of kind ``mesh``."""
        frame = Frame.of(mesh)
        shape, names = mesh.attributes.get("shape"), mesh.attributes.get("regions")
        regions = Regions(mesh.arrays["region"], tuple(names)) if names else None
        vertices, faces = mesh.arrays["vertices"], mesh.arrays["faces"]
        return cls(vertices, faces, frame, shape=shape, regions=regions)

    @cached_property
    def corners(self):
        """The vertices (V, 3) in the unit frame."""
        return self.frame.to_unit(self.vertices)

    @cached_property
    def distance(self):
        """The exact distance: a `MeshDistance` or a `ShapeDistance`."""
        if self.shape:
            return ShapeDistance(find_shape(self.shape), self.frame)
        return MeshDistance(self.corners, self.faces)

    @cached_property
    def surface(self):
        """The `Surface` from which points are drawn; points on a closed form are exact."""
        if self.shape:
            return Surface(self.corners, self.faces, self.distance)
        return Surface(self.distance.vertices, self.distance.faces)

    @property
    def bytes(self):
        """Bytes of memory that pandis.h needs for exact distances; a closed form needs none."""
        return 0 if self.shape else self.distance.tree_bytes

    @property
    def size(self):
        """Number of faces; 1 for a closed form."""
        return 1 if self.shape else len(self.faces)

    def scan(self, points):
        """Return distance (n,) and normal (n, 3), mesh units, by brute force over all faces.

        Requires `can_be_scanned`.
        """
        distance, normal = self.distance.scan(self.frame.to_unit(points))
        return distance / self.frame.scale, normal

    @property
    def can_be_scanned(self):
        """Whether `scan` is possible: a closed form has no faces."""
        return not self.shape
