"""Two-sided distance of a repaired mesh from its source, sampled on faces.

Sampling vertices alone would not suffice: flipping the diagonal of a skew quad keeps
every vertex but moves the surface. Faces that both meshes share have distance 0 and are
not measured.

Two kinds of surface are not counted, because repair is meant to change them. *Hidden*
parts of the source have its solid on both sides (walls inside a union). *Caps* are the
parts of the result where the source has no surface and its winding number is clearly
between 0 and 1; of a solid, those farther than a cell from the source.
"""

import numpy as np

from pandis.pipeline.mesh.topology import equal_rows, used_vertices
from pandis.pipeline.mesh.tree import MeshTree

#: Sample points per direction.
SAMPLES = 100_000
#: Distance from a face at which its two sides are examined, as a share of the diagonal.
BESIDE = 1e-5
#: A winding number is clearly between 0 and 1 if it is farther than this from both.
BETWEEN = 0.05
#: Possible origins of a face of a repaired mesh.
ORIGINS = ("kept", "cut or moved", "cap of a hole")


class Surface:
    """A mesh for measuring deviations; its tree is built when first needed.

    Parameters
    ----------
    vertices, faces : ndarray
    """

    def __init__(self, vertices, faces):
        self.vertices = np.ascontiguousarray(vertices, np.float64)
        self.faces = np.ascontiguousarray(faces, np.int64)
        used = self.vertices[used_vertices(self.faces)]
        self.low, self.high = used.min(axis=0), used.max(axis=0)
        self.diagonal = float(np.linalg.norm(self.high - self.low))
        self._lazy = None

    @property
    def _tree(self):
        if self._lazy is None:
            self._lazy = MeshTree(self.vertices, self.faces)
        return self._lazy

    def distance(self, points):
        """Return the unsigned distance (n,) from points (n, 3) to the mesh."""
        return self._tree.distance(points)

    def windings(self, points):
        """Return the winding number (n,) at points (n, 3)."""
        return self._tree.windings(points)

    def sample(self, count, rng, among):
        """Draw ``count`` points uniformly by area; return those on faces in the mask ``among``.

        Returns
        -------
        points : ndarray, shape (n, 3), n <= count
        normals : ndarray, shape (n, 3)
        """
        corners = self.vertices[self.faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(normal, axis=1)
        share = np.cumsum(area) / area.sum()
        position = (np.arange(count) + rng.random(count)) / count
        face = np.minimum(np.searchsorted(share, position, side="right"), len(area) - 1)
        face = face[among[face]]
        root, turn = np.sqrt(rng.random(len(face))), rng.random(len(face))
        weights = np.stack([1 - root, root * (1 - turn), root * turn], axis=1)
        points = np.einsum("ij,ijk->ik", weights, corners[face])
        return points, normal[face] / np.maximum(area[face], 1e-300)[:, None]


def deviation(source, result, seed, *, reference=None, wall=0.0, samples=SAMPLES):
    """Measure how far apart two meshes are, in both directions.

    Parameters
    ----------
    source, result : Surface
    seed : int
    reference : Surface, optional
        The source after welding and outward orientation, so that its inside is
        defined even if the source is a triangle soup. Defaults to the source.
    wall : float
        Half the wall's thickness (mesh units) if the surface was thickened into a wall, else 0.
        Source points deeper than this inside the result's solid count as hidden.
    samples : int
        Number of points per direction, uniform by area.

    Returns
    -------
    dict
        ``to_result`` and ``to_source``: max, p99 and mean distance in mesh
        units, and the shares of area not counted (``hidden``, ``caps``);
        ``untouched``: the share of the source's corner positions that the result keeps.
    """
    reference = reference or source
    kept_source, kept_result, untouched = _common(source, result)
    rng = np.random.default_rng(seed)
    points, normals = source.sample(samples, rng, ~kept_source)
    hidden = np.zeros(len(points), bool)
    distance = np.zeros(len(points))
    if len(points):
        distance = result.distance(points)
        beside = BESIDE * source.diagonal * normals
        far = np.flatnonzero(distance > 2 * BESIDE * source.diagonal)
        if len(far):
            least = np.minimum(
                reference.windings((points + beside)[far]),
                reference.windings((points - beside)[far]),
            )
            hidden[far] = least > 0.75
        deep = np.flatnonzero(distance > wall) if wall else []
        if len(deep):
            hidden[deep] |= result.windings(points[deep]) > 0.5
    to_result = summary(distance[~hidden], samples) | {"hidden": float(hidden.sum() / samples)}
    points, _ = result.sample(samples, rng, ~kept_result)
    caps, distance = np.zeros(len(points), bool), np.zeros(len(points))
    if len(points):
        distance = reference.distance(points)
        far = np.flatnonzero(distance > 2 * BESIDE * source.diagonal)
        if len(far) and not wall:  # winding numbers beside a sheet are all between 0 and 1
            caps[far] = np.abs(reference.windings(points[far]) - 0.5) < 0.5 - BETWEEN
    to_source = summary(distance[~caps], samples) | {"caps": float(caps.sum() / samples)}
    return {"to_result": to_result, "to_source": to_source, "untouched": untouched}


def provenance(source, result, reference, *, cell=None):
    """Return the origin of each face of a repaired mesh, and its distance to the reference.

    Parameters
    ----------
    source, result, reference : Surface
    cell : float, optional
        Size of the cells (mesh units) if the result is a solid: its faces that are farther than
        this from the reference are caps.

    Returns
    -------
    origin : ndarray, shape (F,), uint8
        An index into `ORIGINS`.
    distance : ndarray, shape (F,), float32
        Distance from each face's centre to the reference, in mesh units; 0 for shared faces.
    """
    _, common, _ = _common(source, result)
    origin, distance = np.where(common, 0, 1).astype(np.uint8), np.zeros(len(common), np.float32)
    new = np.flatnonzero(~common)
    if len(new):
        centres = result.vertices[result.faces[new]].mean(axis=1)
        distance[new] = reference.distance(centres)
        far = np.flatnonzero(distance[new] > (cell or 2 * BESIDE * source.diagonal))
        if len(far) and cell is None:
            far = far[np.abs(reference.windings(centres[far]) - 0.5) < 0.5 - BETWEEN]
        origin[new[far]] = 2
    return origin, distance


def none():
    """Return the deviation of a mesh from itself."""
    zero = {"max": 0.0, "p99": 0.0, "mean": 0.0}
    return {
        "to_result": zero | {"hidden": 0.0},
        "to_source": zero | {"caps": 0.0},
        "untouched": 1.0,
    }


def summary(distance, samples):
    """Summarise distances; samples that are not in ``distance`` count as 0."""
    if not len(distance):
        return {"max": 0.0, "p99": 0.0, "mean": 0.0}
    whole = np.concatenate([np.zeros(max(samples - len(distance), 0)), distance])
    return {
        "max": float(distance.max()),
        "p99": float(np.percentile(whole, 99)),
        "mean": float(whole.mean()),
    }


def _common(source, result):
    """Return a mask of shared faces for each mesh, and the share of kept corner positions."""
    name = equal_rows(np.concatenate([source.vertices, result.vertices]) + 0.0)
    faces = [
        np.sort(name[: len(source.vertices)][source.faces], axis=1),
        np.sort(name[len(source.vertices) :][result.faces], axis=1),
    ]
    mine, theirs = np.split(equal_rows(np.concatenate(faces)), [len(source.faces)])
    untouched = float(_members(faces[1], len(name))[used_vertices(faces[0])].mean())
    count = len(mine) + len(theirs)
    return _members(theirs, count)[mine], _members(mine, count)[theirs], untouched


def _members(numbers, count):
    """Return a mask (count,) of the numbers in an array."""
    mask = np.zeros(count, bool)
    mask[numbers] = True
    return mask


def inside_changed(reference, result, seed, *, count=20_000):
    """Return the volume that a repair has added or removed, as a share of the inside.

    A point counts only if its winding number in the reference clearly means inside or outside.
    This excludes points near the reference's holes.

    Parameters
    ----------
    reference, result : Surface
    seed : int
    count : int
        Number of points, drawn uniformly in the reference's bounding box.
    """
    rng = np.random.default_rng(seed)
    points = rng.uniform(reference.low, reference.high, (count, 3))
    before, after = reference.windings(points), result.windings(points) > 0.5
    sure = np.abs(before - 0.5) > 0.25
    changed = int((sure & ((before > 0.5) != after)).sum())
    return changed / max(int((sure & (before > 0.5)).sum()), 1)
