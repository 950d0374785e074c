"""Diagnoses a mesh: counts all faults that affect a signed distance."""

from dataclasses import asdict, dataclass, field

import numpy as np

from pandis.base.arrays import Faces, Vertices
from pandis.pipeline.mesh.nesting import must_turn, nesting_depth, signed_volumes
from pandis.pipeline.mesh.topology import (
    components,
    count_distinct,
    crossing_faces,
    edges_of,
    nonmanifold_vertices,
    same_place,
    used_vertices,
)
from pandis.pipeline.mesh.tree import MeshTree

#: A face whose smallest altitude is at most this share of its longest edge has no usable normal.
FLAT = 1e-13
#: A face whose smallest altitude is at most this share of its longest edge is a sliver.
SLIVER = 1e-2
#: Numbers of points at which the winding number is checked, and of rays that measure wall
#: thickness.
WINDING_POINTS, THICKNESS_RAYS = 20_000, 2_000
#: Maximum number of components listed, largest first.
LISTED_COMPONENTS = 50

#: Counts that must all be zero, and their names in messages.
FAULTS = {
    "split_vertices": "vertices that coincide with another",
    "boundary_edges": "boundary edges",
    "nonmanifold_edges": "non-manifold edges",
    "nonmanifold_vertices": "non-manifold vertices",
    "orientation_conflicts": "edges whose faces disagree in orientation",
    "duplicate_faces": "duplicate faces",
    "degenerate_faces": "degenerate faces",
    "inverted_components": "components that are inside out",
    "self_intersections": "pairs of faces that cross or touch",
    "odd_windings": "points whose winding number is neither 0 nor 1",
}


@dataclass(frozen=True)
class Diagnosis:
    """Faults and key figures of a triangle mesh; lengths and volumes in mesh units."""

    vertices: int
    faces: int
    components: int
    euler: int
    boundary_edges: int
    holes: list  # of {"edges": int, "length": float}, longest first
    unbalanced_edges: int  # traversed more often in one direction than in the other
    nonmanifold_edges: int
    nonmanifold_vertices: int
    orientation_conflicts: int
    duplicate_faces: int
    degenerate_faces: int
    sliver_faces: int
    unreferenced_vertices: int
    split_vertices: int  # vertices that coincide with another; merged for all other counts
    inverted_components: int
    self_intersections: int
    odd_windings: int  # among WINDING_POINTS in the bounding box
    volume: float
    area: float
    diagonal: float
    parts: list = field(default_factory=list)  # of {"faces", "volume", "depth"}, largest first
    cavities: int | None = None  # components at odd depth; None unless all are closed
    genus: int | None = None  # of all components; None unless manifold and closed
    wall: dict | None = None  # {"min", "p1"}: thickness along inward rays; None unless valid

    @property
    def closed(self):
        """Whether every edge has exactly two faces."""
        return not (self.boundary_edges or self.nonmanifold_edges)

    @property
    def valid(self):
        """Whether an inside is defined: closed, manifold, outward, without self-intersections."""
        return not any(getattr(self, name) for name in FAULTS)

    @property
    def rank(self):
        """Sort key; lower is better. Order: unbalanced edges, connectivity faults, all faults."""
        return (
            self.unbalanced_edges,
            self.nonmanifold_edges + self.nonmanifold_vertices + self.orientation_conflicts,
            sum(getattr(self, name) for name in FAULTS),
        )

    def attributes(self):
        """Return the diagnosis as a dict, for an artifact's attributes."""
        return asdict(self) | {"closed": self.closed, "valid": self.valid}

    def faults(self):
        """Return the faults that make the mesh invalid, as one phrase."""
        faults = [
            f"{getattr(self, key):,} {name}" for key, name in FAULTS.items() if getattr(self, key)
        ]
        if self.holes:
            longest = self.holes[0]
            rim = f"{longest['length'] / self.diagonal:.3g} times the mesh's diagonal"
            several = len(self.holes) > 1
            count = f"{len(self.holes):,} holes, the longest" if several else "1 hole"
            faults.append(f"{count} with {longest['edges']} edges and a rim of {rim}")
        return ", ".join(faults) or "none"


def diagnose(vertices: Vertices, faces: Faces):
    """Examine a mesh.

    Coincident vertices are counted, then merged. The other counts therefore describe the
    surface itself, even if the mesh is a triangle soup.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), float64
    faces : ndarray, shape (F, 3), int64

    Returns
    -------
    Diagnosis
    """
    vertices = np.ascontiguousarray(vertices, np.float64)
    separate = used_vertices(faces)
    faces = np.ascontiguousarray(same_place(vertices)[faces])
    edges = edges_of(faces)
    component, count = components(faces)
    used = used_vertices(faces)
    altitude, area = altitudes(vertices[faces])
    unit = _unit_box(vertices, used)
    volumes = signed_volumes(vertices, faces, component, count=count)
    solid = edges.closed and not edges.conflicts.any()
    depth = nesting_depth(vertices, faces, component, count=count) if edges.closed else None
    tree = MeshTree(unit, faces) if solid else None
    euler = len(used) - edges.count + len(faces)
    torn = len(nonmanifold_vertices(faces, edges))
    figures = {
        "vertices": len(vertices),
        "faces": len(faces),
        "components": count,
        "euler": euler,
        "boundary_edges": int(edges.boundary.sum()),
        "holes": edges.holes(vertices),
        "unbalanced_edges": int((2 * edges.forward != edges.uses).sum()),
        "nonmanifold_edges": int(edges.nonmanifold.sum()),
        "nonmanifold_vertices": torn,
        "orientation_conflicts": int(edges.conflicts.sum()),
        "duplicate_faces": len(faces) - count_distinct(faces),
        "degenerate_faces": int((altitude <= FLAT).sum()),
        "sliver_faces": int(((altitude > FLAT) & (altitude <= SLIVER)).sum()),
        "unreferenced_vertices": len(vertices) - len(separate),
        "split_vertices": len(separate) - len(used),
        "inverted_components": int(must_turn(volumes, depth).sum()) if solid else 0,
        "self_intersections": len(crossing_faces(vertices, faces)),
        "odd_windings": _odd_windings(tree, unit[used]) if solid else 0,
        "volume": float(volumes.sum()),
        "area": float(area.sum()),
        "diagonal": float(np.linalg.norm(np.ptp(vertices[used], axis=0))),
        "parts": _parts(component, count, volumes, depth=depth),
        "cavities": int((depth % 2).sum()) if solid else None,
        "genus": int(count - euler / 2) if solid and not torn else None,
    }
    diagnosis = Diagnosis(**figures)
    if not diagnosis.valid:
        return diagnosis
    scale = np.ptp(vertices[used], axis=0).max()
    return Diagnosis(**figures, wall=_wall_thickness(tree, unit[faces], area, scale=scale))


def _unit_box(vertices, used):
    """Centre vertices and scale the longest side to 1, so that products do not underflow."""
    low, high = vertices[used].min(axis=0), vertices[used].max(axis=0)
    return (vertices - (low + high) / 2) / (high - low).max()


def altitudes(corners):
    """Return (smallest altitude / longest edge) and area of faces with corners (F, 3, 3)."""
    a, b, c = (np.ascontiguousarray(corners[:, k]) for k in range(3))
    normal = np.cross(b - a, c - b)
    longest, double = 0.0, np.sqrt(np.einsum("ij,ij->i", normal, normal))
    for side in (b - a, c - b, a - c):
        longest = np.maximum(longest, np.sqrt(np.einsum("ij,ij->i", side, side)))
    return double / np.maximum(longest, 1e-300) / np.maximum(longest, 1e-300), double / 2


def _odd_windings(tree, used):
    half = np.ptp(used, axis=0) / 2
    points = np.random.default_rng(0).uniform(-1, 1, (WINDING_POINTS, 3)) * half
    return int((~np.isin(np.round(tree.windings(points)), (0, 1))).sum())


def _parts(component, count, volumes, *, depth):
    sizes = np.bincount(component, minlength=count)
    largest = np.argsort(-sizes, kind="stable")[:LISTED_COMPONENTS]
    return [
        {
            "faces": int(sizes[k]),
            "volume": float(volumes[k]),
            "depth": None if depth is None else int(depth[k]),
        }
        for k in largest
    ]


def _wall_thickness(tree, corners, area, *, scale):
    """Return the minimum and first percentile of the wall thickness, along inward normals."""
    rng = np.random.default_rng(0)
    start = np.minimum(
        np.searchsorted(np.cumsum(area) / area.sum(), rng.random(THICKNESS_RAYS)), len(area) - 1
    )
    corners = corners[start]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    weights = rng.dirichlet((1, 1, 1), len(start))
    origin = np.einsum("ij,ijk->ik", weights, corners)
    lengths = tree.first_hits(origin, -normal, start) * scale
    lengths = lengths[np.isfinite(lengths)]
    if not len(lengths):
        return None
    return {"min": float(lengths.min()), "p1": float(np.percentile(lengths, 1))}
