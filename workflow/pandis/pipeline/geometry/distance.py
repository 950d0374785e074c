"""Exact signed distance and direction in float64, the reference for all fields.

An engine works in the unit frame. For a mesh it searches a tree over the faces
(`pandis.engine.bvh`) for the closest point. The sign follows from the angle-weighted
pseudonormal there (Bærentzen & Aanæs 2005) and is compared with the winding number at
every point. Where they differ, the exact winding number decides. If they differ at more
than a few points, the mesh is unsound and the stage stops. The direction points from the
closest point to the query; inside, it is reversed. On the surface it is the
pseudonormal. For a closed-form shape, a formula provides distance and direction.
"""

import numpy as np

from pandis.base.arrays import Flags, Points
from pandis.base.errors import PandisError
from pandis.engine.bvh import INVALID, ON_SURFACE, TIED, Bvh, Labels

#: At distances d up to this (unit frame), the direction (q - c) / d has too few accurate digits.
SURFACE_DISTANCE = 1e-9
#: Largest relative difference between the distances of two tied closest points.
TIE_DISTANCE = 1e-3
#: Smallest angle between the directions to two tied closest points (radians).
TIE_ANGLE = np.radians(10)
#: Share of signs that the winding number may overrule before the mesh counts as unsound.
MAX_OVERRULED = 1e-5
#: Number of points per batch; it bounds the memory of a call.
CHUNK = 1 << 20


class MeshDistance:
    """Exact distances to a closed mesh whose faces are oriented outward.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), float64, unit frame
    faces : ndarray, shape (F, 3), integer

    Raises
    ------
    PandisError
        There is no C compiler to compile the tree's code on first use.
    """

    def __init__(self, vertices, faces):
        self.vertices = np.ascontiguousarray(vertices, np.float64)
        self.faces = np.ascontiguousarray(faces, np.int32)
        self._tree = Bvh(self.vertices, self.faces)
        self._checked = 0

    def label(self, points: Points, ties=True, check=True):
        """Return all labels of points.

        Parameters
        ----------
        points : ndarray, shape (n, 3), unit frame
            Points that are not finite are flagged, and their distances are NaN.
        ties : bool
            Search for a second closest point.
        check : bool
            Compare the signs with the winding number.

        Returns
        -------
        pandis.engine.bvh.Labels

        Raises
        ------
        PandisError
            The signs by pseudonormal and by winding number disagree too often.
        """
        tie = (TIE_DISTANCE, TIE_ANGLE) if ties else None
        return self._answer(points, check, tie=tie, feet=True, close=True)

    def _answer(self, points, check, *, tie=None, feet=False, close=False):
        more = {"tie": tie, "feet": feet, "close": close}
        labels = self._tree.label(points, SURFACE_DISTANCE, check, **more)
        self._checked += len(points)
        allowed = max(1, MAX_OVERRULED * self._checked)
        if self._tree.overruled > allowed:
            raise PandisError(
                f"the signs of {self._tree.overruled:,} of {self._checked:,} points, taken from "
                "the mesh's pseudonormals, contradict its winding number: the mesh is not closed, "
                "or folds over itself, and repair did not detect this; let repair rebuild it "
                "(mesh.rungs: [remesh])"
            )
        return labels

    def distance_and_normal(self, points: Points, progress=None, check=True):
        """Return the signed distance and the direction of steepest increase.

        Parameters
        ----------
        points : ndarray, shape (n, 3), unit frame
        progress : pandis.base.progress.Report, optional
            Receives the number of points done.
        check : bool
            As for `label`.

        Returns
        -------
        distance : ndarray, shape (n,), float64, negative inside
        normal : ndarray, shape (n, 3), float64, unit length
            NaN, like the distance, at points that are not finite.
        """
        points = np.ascontiguousarray(points, np.float64)
        if len(points) <= CHUNK:
            return self._answer(points, check)[:2]
        distance, normal = np.empty(len(points)), np.empty((len(points), 3))
        for start in range(0, len(points), CHUNK):
            part = slice(start, start + CHUNK)
            distance[part], normal[part] = self._answer(points[part], check)[:2]
            if progress:
                progress.update(min(start + CHUNK, len(points)))
        return distance, normal

    def tree_parts(self):
        """Return the arrays of the tree: see `pandis.engine.bvh.Bvh.parts`."""
        return self._tree.parts()

    @property
    def tree_bytes(self):
        """Size of the tree's arrays in bytes."""
        return sum(map(len, self.tree_parts().values()))

    @property
    def reach(self):
        """The largest absolute coordinate."""
        return self._tree.reach

    @property
    def bounds(self):
        """Lowest and highest corner (2, 3) of the surface's bounding box."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    def scan(self, points: Points):
        """Return distance (n,) and normal (n, 3) by brute force over all faces."""
        return self._tree.scan(points)

    def inside(self, points: Points) -> Flags:
        """Return which points (n, 3) are inside; points that are not finite count as outside."""
        return self._tree.inside(points)


class ShapeDistance:
    """Exact distances to a closed-form shape.

    Parameters
    ----------
    shape : object
        One of `pandis.pipeline.geometry.shapes`.
    frame : Frame
    """

    def __init__(self, shape, frame):
        self.shape, self.frame = shape, frame

    def label(self, points: Points, ties=True, check=True):
        """Return labels as `MeshDistance.label` does, without faces and closest points.

        A point counts as having two closest points if the direction turns by more than
        `TIE_ANGLE` within a step of `TIE_DISTANCE` times the distance.
        """
        distance, normal = self.distance_and_normal(points)
        flags = np.where(np.isnan(distance), INVALID, 0).astype(np.uint8)
        with np.errstate(invalid="ignore"):
            flags[np.abs(distance) <= SURFACE_DISTANCE] |= ON_SURFACE
            if ties:
                helper = np.where(np.abs(normal[:, :1]) < 0.6, [1.0, 0, 0], [0, 1.0, 0])
                aside = np.cross(normal, helper)
                aside /= np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), 1e-300)
                tied = np.zeros(len(points), bool)
                across = np.cross(normal, aside)
                for direction in (aside, -aside, across, -across, normal, -normal):
                    step = TIE_DISTANCE * np.abs(distance)[:, None] * direction
                    _, beside = self.distance_and_normal(points + step)
                    tied |= np.einsum("ij,ij->i", normal, beside) < np.cos(TIE_ANGLE)
                flags[tied] |= TIED
        return Labels(
            distance,
            normal,
            np.full(len(points), -1, np.int32),
            np.full((len(points), 3), np.nan),
            flags,
        )

    def distance_and_normal(self, points: Points, progress=None, check=True):
        """Return distances and directions as `MeshDistance.distance_and_normal` does."""
        del progress, check  # a formula is fast, and its sign needs no check
        points = np.asarray(points, np.float64)
        bad = ~(np.abs(points) < 1e150).all(axis=1)
        distance, normal = self.shape.distance_and_normal(
            self.frame.to_mesh(np.where(bad[:, None], 2.0, points))
        )
        return (
            np.where(bad, np.nan, distance * self.frame.scale),
            np.where(bad[:, None], np.nan, normal),
        )

    @property
    def bounds(self):
        """Lowest and highest corner (2, 3) of the closed form's bounding box."""
        half = np.array(self.shape.half_extent, np.float64)
        return self.frame.to_unit(np.stack([-half, half]))

    def inside(self, points: Points) -> Flags:
        """Return which points (n, 3) are inside."""
        return self.distance_and_normal(points)[0] < 0
