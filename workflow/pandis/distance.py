"""Exact signed distance and direction, in float64: the truth that everything is judged by.

An engine answers in the unit frame. For a mesh it is libigl's AABB tree for
the closest point and the winding number for the sign; the direction is from
the closest point to the query (turned outward inside). On the surface the
direction, and right next to it the sign, is that of the angle-weighted
pseudonormal (Bærentzen & Aanæs 2005). For a closed-form shape
it is the formula.
"""

import igl
import numpy as np

from pandis.frame import Frame
from pandis.mesh.shapes import find_shape

#: Closer than this (unit frame) the quotient (q - c) / d has lost too many digits.
ON_SURFACE = 1e-9
#: Closer than this the float32 winding number cannot tell the sides apart.
NEAR_SURFACE = 1e-6
CHUNK = 50_000


class MeshDistance:
    """Exact distances to a closed, outward mesh.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), float64, unit frame
    faces : ndarray, shape (F, 3), integer
    """

    def __init__(self, vertices, faces):
        self.vertices = np.ascontiguousarray(vertices, np.float64)
        self.faces = np.ascontiguousarray(faces, np.int64)
        self._tree = igl.AABB()
        self._tree.init(self.vertices, self.faces)
        self._winding = igl.FastWindingNumberBVH()
        self._winding.init(self.vertices, self.faces)
        self._features = None

    def distance_and_normal(self, points, progress=None):
        """Answer the signed distance and the direction of steepest increase.

        Parameters
        ----------
        points : ndarray, shape (n, 3), unit frame
        progress : Progress, optional
            Told how many points are done.

        Returns
        -------
        distance : ndarray, shape (n,), float64, negative inside
        normal : ndarray, shape (n, 3), float64, unit length
        """
        points = np.ascontiguousarray(points, np.float64)
        distance, normal = np.empty(len(points)), np.empty((len(points), 3))
        for start in range(0, len(points), CHUNK):
            part = slice(start, start + CHUNK)
            distance[part], normal[part] = self._answer(points[part])
            if progress:
                progress.update(min(start + CHUNK, len(points)))
        return distance, normal

    def inside(self, points):
        """Tell which points (n, 3) lie inside."""
        points = np.ascontiguousarray(points, np.float64)
        return self._winding.winding_number(points) > 0.5

    def _answer(self, points):
        squared, face, closest = self._tree.squared_distance(self.vertices, self.faces, points)
        distance = np.sqrt(squared)
        sign = np.where(self.inside(points), -1.0, 1.0)
        offset = points - closest
        near = np.flatnonzero(distance <= NEAR_SURFACE)
        if len(near):
            pseudo = self._pseudonormals(face[near], closest[near])
            sign[near] = np.where(np.einsum("ij,ij->i", offset[near], pseudo) < 0, -1.0, 1.0)
        normal = offset * (sign / np.maximum(distance, 1e-300))[:, None]
        if len(near):
            on = distance[near] <= ON_SURFACE
            normal[near[on]] = pseudo[on]
        return sign * distance, normal / np.linalg.norm(normal, axis=1, keepdims=True)

    def _pseudonormals(self, face, closest):
        """Return the pseudonormal of the face, edge or vertex that each point lies on."""
        if self._features is None:
            self._features = _feature_normals(self.vertices, self.faces)
        face_normal, edge_normal, vertex_normal = self._features
        a, b, c = (self.vertices[self.faces[face, k]] for k in range(3))
        # barycentrics by areas against the face's own normal
        n = np.cross(b - a, c - a)
        total = np.einsum("ij,ij->i", n, n)
        bary = np.stack(
            [
                np.einsum("ij,ij->i", np.cross(q - closest, r - closest), n) / total
                for q, r in ((b, c), (c, a), (a, b))
            ],
            axis=1,
        )
        zero = bary < 1e-9
        normal = face_normal[face]
        for k in range(3):  # the edge opposite to corner k
            on_edge = zero[:, k] & (zero.sum(axis=1) == 1)
            normal[on_edge] = edge_normal[face[on_edge], k]
            at_corner = zero[:, (k + 1) % 3] & zero[:, (k + 2) % 3]
            normal[at_corner] = vertex_normal[self.faces[face[at_corner], k]]
        return normal


def _feature_normals(vertices, faces):
    """Return unit normals of faces (F, 3), of edges opposite to corners (F, 3, 3), of vertices."""
    corners = vertices[faces]
    side = np.roll(corners, -1, axis=1) - corners  # from corner k to corner k+1
    face_normal = np.cross(side[:, 0], side[:, 1])
    face_normal /= np.maximum(np.linalg.norm(face_normal, axis=1, keepdims=True), 1e-300)
    directed = faces[:, [[1, 2], [2, 0], [0, 1]]]  # edge opposite to corner k
    _, index = np.unique(np.sort(directed, axis=2).reshape(-1, 2), axis=0, return_inverse=True)
    index = index.reshape(-1)
    edge_sum = np.zeros((index.max() + 1, 3))
    np.add.at(edge_sum, index, np.repeat(face_normal, 3, axis=0))
    unit = side / np.maximum(np.linalg.norm(side, axis=2, keepdims=True), 1e-300)
    cosine = -np.einsum("ijk,ijk->ij", unit, np.roll(unit, 1, axis=1))
    angle = np.arccos(np.clip(cosine, -1, 1))
    vertex_sum = np.zeros_like(vertices)
    np.add.at(
        vertex_sum, faces.reshape(-1), (angle[..., None] * face_normal[:, None]).reshape(-1, 3)
    )

    def normalised(sums):
        return sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-300)

    return face_normal, normalised(edge_sum)[index].reshape(-1, 3, 3), normalised(vertex_sum)


class ShapeDistance:
    """Exact distances to a closed-form shape.

    Parameters
    ----------
    shape : object
        From `pandis.mesh.shapes`.
    frame : Frame
    """

    def __init__(self, shape, frame):
        self.shape, self.frame = shape, frame

    def distance_and_normal(self, points, progress=None):
        """Answer as `MeshDistance.distance_and_normal` does."""
        del progress  # a formula takes no time
        distance, normal = self.shape.distance_and_normal(self.frame.to_mesh(points))
        return distance * self.frame.scale, normal

    def inside(self, points):
        """Tell which points (n, 3) lie inside."""
        return self.distance_and_normal(points)[0] < 0


def open_distance(mesh):
    """Return the engine of a mesh artifact: closed form where there is one.

    Parameters
    ----------
    mesh : pandis.artifact.Artifact
        Of kind ``mesh``.
    """
    frame = Frame.from_attributes(mesh.attributes["frame"])
    if mesh.attributes.get("shape"):
        return ShapeDistance(find_shape(mesh.attributes["shape"]), frame)
    return MeshDistance(frame.to_unit(mesh.arrays["vertices"]), mesh.arrays["faces"])
