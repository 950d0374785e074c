"""Exact signed distance and direction, in float64: the truth that everything is judged by.

An engine answers in the unit frame. For a mesh it is a tree over its faces
(`pandis.engine.bvh`): closest point, and the sign of the angle-weighted
pseudonormal there (Bærentzen & Aanæs 2005). The sign is compared with the
winding number at every point; where they differ the exact winding number
decides, and more than a few such points stop the stage: the mesh is not what
it was taken for. The direction is from the closest point to the query (turned
outward inside), on the surface the pseudonormal. For a closed-form shape all
of it is the formula.
"""

import numpy as np

from pandis.base.arrays import Flags, Points
from pandis.base.errors import PandisError
from pandis.engine.bvh import INVALID, ON_SURFACE, TIED, Bvh, Labels

#: Closer than this (unit frame) the quotient (q - c) / d has lost too many digits.
SURFACE_DISTANCE = 1e-9
#: Two closest points tie if they are equally far to this share of the distance …
TIE_DISTANCE = 1e-3
#: … and lie in directions that differ by more than this (radians).
TIE_ANGLE = np.radians(10)
#: Share of signs that the winding number may overrule before the mesh counts as unsound.
MAX_OVERRULED = 1e-5
#: Points answered at once: what bounds the memory of a call.
CHUNK = 1 << 20


class MeshDistance:
    """Exact distances to a closed, outward mesh.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), float64, unit frame
    faces : ndarray, shape (F, 3), integer

    Raises
    ------
    PandisError
        No C compiler is at hand: the tree is compiled on first use.
    """

    def __init__(self, vertices, faces):
        self.vertices = np.ascontiguousarray(vertices, np.float64)
        self.faces = np.ascontiguousarray(faces, np.int32)
        self._tree = Bvh(self.vertices, self.faces)
        self._checked = 0

    def label(self, points: Points, ties=True, check=True):
        """Answer everything there is to know at points.

        Parameters
        ----------
        points : ndarray, shape (n, 3), unit frame
            At points that are no finite numbers the answers are NaN, and flagged.
        ties : bool
            Look for second closest points.
        check : bool
            Compare the signs with the winding number.

        Returns
        -------
        pandis.engine.bvh.Labels

        Raises
        ------
        PandisError
            The two kinds of sign disagree too often.
        """
        return self._answer(points, (TIE_DISTANCE, TIE_ANGLE) if ties else None, check, True)

    def _answer(self, points, tie, check, feet):
        labels = self._tree.label(points, SURFACE_DISTANCE, check, tie, feet)
        self._checked += len(points)
        allowed = max(1, MAX_OVERRULED * self._checked)
        if self._tree.overruled > allowed:
            raise PandisError(
                f"the signs of {self._tree.overruled:,} of {self._checked:,} points by the mesh's "
                "pseudonormals contradict its winding number: it is not closed, or folds over "
                "itself where the repair did not see it; let the repair rebuild it (mesh.rungs: "
                "[remesh])"
            )
        return labels

    def distance_and_normal(self, points: Points, progress=None, check=True):
        """Answer the signed distance and the direction of steepest increase.

        Parameters
        ----------
        points : ndarray, shape (n, 3), unit frame
        progress : Progress, optional
            Told how many points are done.
        check : bool
            As for `label`.

        Returns
        -------
        distance : ndarray, shape (n,), float64, negative inside
        normal : ndarray, shape (n, 3), float64, unit length
            NaN, as the distance, at points that are no finite numbers.
        """
        points = np.ascontiguousarray(points, np.float64)
        if len(points) <= CHUNK:
            return self._answer(points, None, check, False)[:2]
        distance, normal = np.empty(len(points)), np.empty((len(points), 3))
        for start in range(0, len(points), CHUNK):
            part = slice(start, start + CHUNK)
            distance[part], normal[part] = self._answer(points[part], None, check, False)[:2]
            if progress:
                progress.update(min(start + CHUNK, len(points)))
        return distance, normal

    def tree_parts(self):
        """Return what the tree is made of: see `pandis.engine.bvh.Bvh.parts`."""
        return self._tree.parts()

    @property
    def tree_bytes(self):
        """How large all of that is."""
        return sum(map(len, self.tree_parts().values()))

    @property
    def reach(self):
        """The largest coordinate."""
        return self._tree.reach

    @property
    def bounds(self):
        """Lowest and highest corner (2, 3) of the box around the surface."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    def scan(self, points: Points):
        """Answer distance (n,) and normal (n, 3) by looking at every face: brute force."""
        return self._tree.scan(points)

    def inside(self, points: Points) -> Flags:
        """Tell which points (n, 3) lie inside; none that is no finite number does."""
        return self._tree.inside(points)


class ShapeDistance:
    """Exact distances to a closed-form shape.

    Parameters
    ----------
    shape : object
        From `pandis.pipeline.geometry.shapes`.
    frame : Frame
    """

    def __init__(self, shape, frame):
        self.shape, self.frame = shape, frame

    def label(self, points: Points, ties=True, check=True):
        """Answer as `MeshDistance.label` does; a formula has no faces.

        Points next to which the direction turns by more than `TIE_ANGLE` within
        `TIE_DISTANCE` of the distance are those with two closest points.
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
        """Answer as `MeshDistance.distance_and_normal` does."""
        del progress, check  # a formula takes no time, and has but one sign
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
        """Lowest and highest corner (2, 3) of the box around the surface: of the closed form."""
        half = np.array(self.shape.half_extent, np.float64)
        return self.frame.to_unit(np.stack([-half, half]))

    def inside(self, points: Points) -> Flags:
        """Tell which points (n, 3) lie inside."""
        return self.distance_and_normal(points)[0] < 0
