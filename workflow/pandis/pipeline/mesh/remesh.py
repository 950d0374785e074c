"""Remeshes any triangle soup as the closed level set where the winding number is one half.

After Jacobson et al. 2013, "Robust inside-outside segmentation using generalized winding
numbers". Marching cubes extracts the zero level of a field. The field is the exact distance
multiplied by a side, which changes gradually with the winding number, from 1 (outside) to
−1 (inside). It is exact at the surface and continuous across holes. Only cells near the
surface or near a change of side are visited.
"""

import numpy as np

from pandis.pipeline.mesh.topology import components, edges_of, oriented, patches, used_vertices
from pandis.pipeline.mesh.tree import MeshTree

#: Depth of the octree at which every cell is visited.
DENSE_LEVEL = 5
#: At winding number w, the side is SLOPE · (1 − 2w), clipped to [−1, 1]. It is 1 (outside) up to
#: w = 0.375, and −1 (inside) from w = 0.625.
SLOPE = 4.0
#: Corners of a cell in libigl's order for marching cubes: around the bottom, then around the top.
_CORNERS = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
)
#: Maximum number of rays per patch that decide which of its sides is more visible.
RAYS = 400


def winding_remesh(vertices, faces, level):
    """Remesh with cubic cells.

    Parameters
    ----------
    vertices, faces : ndarray
        Need not be closed or manifold. Rays decide which side of a patch is
        outside.
    level : int
        Octree depth: 2**level cells span 1.1 times the longest side.

    Returns
    -------
    vertices, faces : ndarray
        Closed, unless the surface leaves the visited cells.
    """
    used = vertices[used_vertices(faces)]
    centre = (used.min(axis=0) + used.max(axis=0)) / 2
    scale = 1 / (1.1 * np.ptp(used, axis=0).max())
    unit = np.ascontiguousarray((vertices - centre) * scale + 0.5)
    field = _Field(unit, orient_by_sight(unit, faces))
    cells = np.stack(np.meshgrid(*[np.arange(2**DENSE_LEVEL)] * 3, indexing="ij"), -1)
    cells = _active(cells.reshape(-1, 3), DENSE_LEVEL, field)
    for depth in range(DENSE_LEVEL + 1, level + 1):
        children = (2 * cells[:, None] + _CORNERS).reshape(-1, 3)
        cells = _active(children, depth, field)
    corners, index = _corners_of(cells, level)
    value = field(corners / 2**level)
    import igl  # imports scipy.sparse, which takes longer than most other rungs

    # a value of exactly 0 at a node would produce faces without area
    tiny = 1e-3 / 2**level
    value = np.where(np.abs(value) < tiny, np.where(value < 0, -tiny, tiny), value)
    v, f, _ = igl.marching_cubes(
        value, np.ascontiguousarray(corners / 2**level), np.ascontiguousarray(index), 0.0
    )
    if not len(f):
        return np.empty((0, 3)), np.empty((0, 3), np.int64)
    return (v - 0.5) / scale + centre, f


class _Field(MeshTree):
    def side(self, points):
        return np.clip(SLOPE * (1 - 2 * self.windings(points)), -1, 1)

    def __call__(self, points):
        return self.distance(points) * self.side(points)


def _active(cells, depth, field):
    """Return the cells that the surface may cross, and the cells around a change of side."""
    size = 2.0**-depth
    near = field.distance((cells + 0.5) * size) <= size * np.sqrt(3) / 2 * 1.01
    corners, index = _corners_of(cells, depth)
    inside = field.side(corners * size) < 0
    count = inside[index].sum(axis=1)
    change = cells[(count > 0) & (count < 8)]
    around = (
        change[:, None] + np.stack(np.meshgrid(*[[-1, 0, 1]] * 3), -1).reshape(-1, 3)
    ).reshape(-1, 3)
    around = around[((around >= 0) & (around < 2**depth)).all(axis=1)]
    keys = np.unique(np.concatenate([_key(cells[near], depth), _key(around, depth)]))
    return _cells(keys, depth)


def _corners_of(cells, depth):
    """Return the distinct corners (C, 3) of cells, and each cell's indices (n, 8) into them."""
    keys = _key(cells[:, None] + _CORNERS, depth + 1)
    unique, index = np.unique(keys, return_inverse=True)
    return _cells(unique, depth + 1), index.reshape(-1, 8).astype(np.int64)


def _key(cells, depth):
    n = 2**depth
    return (cells[..., 2] * n + cells[..., 1]) * n + cells[..., 0]


def _cells(keys, depth):
    n = 2**depth
    return np.stack([keys % n, keys // n % n, keys // n**2], axis=1)


def orient_by_sight(vertices, faces):
    """Orient each manifold patch so that its front is the side with more unobstructed rays.

    After Takayama et al. 2014, "A simple method for correcting facet
    orientations in polygon meshes based on ray casting". A closed patch that is
    visible from neither side keeps its orientation.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
    faces : ndarray, shape (F, 3)

    Returns
    -------
    ndarray, shape (F, 3)
    """
    faces = np.ascontiguousarray(faces, np.int64)
    used = vertices[used_vertices(faces)]
    vertices = (vertices - used.min(axis=0)) / np.ptp(used, axis=0).max()
    edges = edges_of(faces)
    patch, count = patches(faces) if edges.nonmanifold.any() else components(faces)
    if edges.conflicts.any():
        faces = oriented(faces)
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1)
    normal /= np.maximum(area, 1e-300)[:, None]
    rng = np.random.default_rng(0)
    order = np.argsort(patch, kind="stable")
    groups = np.split(order, np.cumsum(np.bincount(patch, minlength=count))[:-1])
    rays = max(8, min(RAYS, 40_000 // count))
    chosen = np.concatenate(
        [rng.choice(g, rays, p=area[g] / area[g].sum()) if area[g].sum() else g[:0] for g in groups]
    )
    way = rng.normal(size=(len(chosen), 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    front = np.einsum("ij,ij->i", way, normal[chosen]) > 0
    weights = rng.dirichlet((1, 1, 1), len(chosen))
    origin = np.einsum("ij,ijk->ik", weights, corners[chosen])
    seen = np.isinf(MeshTree(vertices, faces).first_hits(origin, way, chosen, least=1e-7))
    balance = np.bincount(patch[chosen], np.where(front, 1, -1) * seen, minlength=count)
    turn = (balance < 0)[patch]
    faces = faces.copy()
    faces[turn] = faces[turn][:, ::-1]
    return faces
