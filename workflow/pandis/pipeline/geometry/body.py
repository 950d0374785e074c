"""The body: one object with its frame, its exact distance and its surface.

Whoever needs the truth about an object takes a `Body`, opened from the mesh stage's artifact or
made from plain arrays. Only here is it asked whether the object is a mesh or a closed form.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from pandis.base.frame import Frame
from pandis.pipeline.geometry.distance import MeshDistance, ShapeDistance
from pandis.pipeline.geometry.sampling import Surface
from pandis.pipeline.geometry.shapes import find_shape


class Regions(NamedTuple):
    """Which material each face has: a number for each, shape (F,), and what the materials are."""

    of_face: np.ndarray
    names: tuple


class Body:
    """A mesh, or a closed-form shape with a tessellation.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), float64, mesh units
    faces : ndarray, shape (F, 3), integer
    frame : Frame, optional
        That of the bounding box, unless given.
    shape : str, optional
        The name of the closed form (`pandis.pipeline.geometry.shapes`) that the mesh approximates.
    regions : Regions, optional
    """

    def __init__(self, vertices, faces, frame=None, shape=None, regions=None):
        self.vertices, self.faces, self.shape = vertices, faces, shape
        self.regions = regions
        self.frame = frame or Frame.of_bounds(vertices.min(axis=0), vertices.max(axis=0))

    @classmethod
    def open(cls, mesh):
        """Open the body of an artifact of kind ``mesh``."""
        frame = Frame.of(mesh)
        shape, names = mesh.attributes.get("shape"), mesh.attributes.get("regions")
        regions = Regions(mesh.arrays["region"], tuple(names)) if names else None
        return cls(mesh.arrays["vertices"], mesh.arrays["faces"], frame, shape, regions)

    @cached_property
    def corners(self):
        """The vertices (V, 3) in the unit frame."""
        return self.frame.to_unit(self.vertices)

    @cached_property
    def distance(self):
        """What answers the exact distance: a `MeshDistance`, or a `ShapeDistance`."""
        if self.shape:
            return ShapeDistance(find_shape(self.shape), self.frame)
        return MeshDistance(self.corners, self.faces)

    @cached_property
    def surface(self):
        """The `Surface` that points are drawn on; of a closed form they lie on it exactly."""
        if self.shape:
            return Surface(self.corners, self.faces, self.distance)
        return Surface(self.distance.vertices, self.distance.faces)

    @property
    def bytes(self):
        """What an exact answer needs in memory, as pandis.h holds it: a formula needs nothing."""
        return 0 if self.shape else self.distance.tree_bytes

    @property
    def size(self):
        """How many pieces an exact answer chooses from: the faces; a formula is one."""
        return 1 if self.shape else len(self.faces)

    def scan(self, points):
        """Answer distance (n,) and normal (n, 3), mesh units, by looking at every face.

        Only where `can_be_scanned`.
        """
        distance, normal = self.distance.scan(self.frame.to_unit(points))
        return distance / self.frame.scale, normal

    @property
    def can_be_scanned(self):
        """Whether there are faces to look at: a closed form has none."""
        return not self.shape
