"""What is wrong with a mesh: everything that a signed distance depends on."""

from dataclasses import asdict, dataclass

import igl
import igl.predicates
import numpy as np


@dataclass(frozen=True)
class Diagnosis:
    """Faults and key figures of a triangle mesh; lengths and volumes in mesh units."""

    vertices: int
    faces: int
    components: int
    euler: int
    boundary_edges: int
    holes: list  # of {"edges": int, "length": float}, longest first
    nonmanifold_edges: int
    nonmanifold_vertices: int
    orientation_conflicts: int
    duplicate_faces: int
    degenerate_faces: int
    unreferenced_vertices: int
    inverted_components: int
    self_intersections: int
    volume: float
    area: float
    diagonal: float

    @property
    def closed(self):
        """Every edge has exactly two faces."""
        return not (self.boundary_edges or self.nonmanifold_edges)

    @property
    def valid(self):
        """Closed, manifold, consistently oriented, outward: a signed distance is defined."""
        return self.closed and not (
            self.nonmanifold_vertices
            or self.orientation_conflicts
            or self.duplicate_faces
            or self.degenerate_faces
            or self.inverted_components
        )

    def attributes(self):
        """Return the diagnosis as an artifact's attribute."""
        return asdict(self) | {"closed": self.closed, "valid": self.valid}

    def faults(self):
        """Return the faults that make the mesh invalid, as one phrase."""
        names = {
            "boundary_edges": "boundary edges",
            "nonmanifold_edges": "non-manifold edges",
            "nonmanifold_vertices": "non-manifold vertices",
            "orientation_conflicts": "edges whose faces disagree in orientation",
            "duplicate_faces": "duplicate faces",
            "degenerate_faces": "degenerate faces",
            "inverted_components": "components that are inside out",
        }
        found = [
            f"{getattr(self, key)} {name}" for key, name in names.items() if getattr(self, key)
        ]
        if self.holes:
            longest = self.holes[0]
            found.append(
                f"{len(self.holes)} holes, the longest with {longest['edges']} edges and a rim of "
                f"{100 * longest['length'] / self.diagonal:.1f} % of the diagonal"
            )
        return ", ".join(found) or "none"


def diagnose(vertices, faces):
    """Examine a mesh.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), float64
    faces : ndarray, shape (F, 3), int64

    Returns
    -------
    Diagnosis
    """
    faces = np.ascontiguousarray(faces, np.int64)
    edges = EdgeTable(faces)
    corners = vertices[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    component, count = components(faces)
    used = np.unique(faces)
    manifold = igl.is_vertex_manifold(faces)
    inverted, self_intersections = 0, 0
    if edges.closed and not edges.conflicts:
        wrong = wrong_side(vertices, faces, component, count)
        inverted = int(wrong.sum())
        _, pairs, _ = igl.predicates.find_self_intersections(vertices, faces)
        self_intersections = len(pairs)
    return Diagnosis(
        vertices=len(vertices),
        faces=len(faces),
        components=count,
        euler=len(used) - edges.count + len(faces),
        boundary_edges=edges.boundary_count,
        holes=edges.holes(vertices),
        nonmanifold_edges=int((edges.uses > 2).sum()),
        nonmanifold_vertices=int((~manifold[used]).sum()),
        orientation_conflicts=edges.conflicts,
        duplicate_faces=len(faces) - len(np.unique(np.sort(faces, axis=1), axis=0)),
        degenerate_faces=int(repeats_a_vertex(faces).sum()),
        unreferenced_vertices=len(vertices) - len(used),
        inverted_components=inverted,
        self_intersections=self_intersections,
        volume=float(signed_volumes(vertices, faces, component, count).sum()),
        area=float(np.linalg.norm(cross, axis=1).sum() / 2),
        diagonal=float(np.linalg.norm(np.ptp(vertices[used], axis=0))),
    )


class EdgeTable:
    """The edges of a mesh and how often, and in which direction, faces use them."""

    def __init__(self, faces):
        directed = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        ordered = np.sort(directed, axis=1)
        self.edges, index, self.uses = np.unique(
            ordered, axis=0, return_inverse=True, return_counts=True
        )
        forward = np.zeros(len(self.edges), np.int64)
        np.add.at(forward, index.reshape(-1), directed[:, 0] < directed[:, 1])
        self.count = len(self.edges)
        self.boundary_count = int((self.uses == 1).sum())
        self.conflicts = int(((self.uses == 2) & (forward != 1)).sum())
        self._directed, self._index = directed, index.reshape(-1)

    @property
    def closed(self):
        """Every edge has exactly two faces."""
        return bool((self.uses == 2).all())

    def holes(self, vertices):
        """Return edge count and length of each connected rim, longest first."""
        rim = self._directed[self.uses[self._index] == 1]
        if not len(rim):
            return []
        nodes, index = np.unique(rim, return_inverse=True)
        label = connected(index.reshape(-1, 2), len(nodes))[index.reshape(-1, 2)[:, 0]]
        lengths = np.linalg.norm(vertices[rim[:, 0]] - vertices[rim[:, 1]], axis=1)
        found = [
            {"edges": int((label == k).sum()), "length": float(lengths[label == k].sum())}
            for k in np.unique(label)
        ]
        return sorted(found, key=lambda hole: -hole["length"])


def connected(pairs, count):
    """Return a component label for each of ``count`` nodes joined by ``pairs`` (m, 2)."""
    label = np.arange(count)
    while True:
        before = label.copy()
        low = np.minimum(label[pairs[:, 0]], label[pairs[:, 1]])
        np.minimum.at(label, pairs[:, 0], low)
        np.minimum.at(label, pairs[:, 1], low)
        label = label[label]
        if (label == before).all():
            return label


def components(faces):
    """Return the edge-connected component of each face, and their number."""
    count, label = igl.facet_components(faces)
    return label, int(count)


def signed_volumes(vertices, faces, component, count):
    """Return the signed volume of each component (meaningful where it is closed)."""
    corners = (vertices - vertices[faces[0, 0]])[faces]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    return np.bincount(component, volume, count)


def wrong_side(vertices, faces, component, count):
    """Tell for each closed component whether it must be turned.

    A component inside an even number of others bounds matter and has positive
    volume; inside an odd number it bounds a cavity and has negative volume.
    Inside means with every vertex: components that merely overlap are matter.
    """
    volumes = signed_volumes(vertices, faces, component, count)
    depth = np.zeros(count, np.int64)
    if count > 1:
        corners = vertices[faces]
        low = np.array([corners[component == k].min(axis=(0, 1)) for k in range(count)])
        high = np.array([corners[component == k].max(axis=(0, 1)) for k in range(count)])
        for outer in range(count):
            enclosed = (low > low[outer]).all(axis=1) & (high < high[outer]).all(axis=1)
            shell = np.ascontiguousarray(faces[component == outer])
            for inner in np.flatnonzero(enclosed):
                points = vertices[np.unique(faces[component == inner])]
                turns = igl.winding_number(vertices, shell, points)
                depth[inner] += (np.abs(turns) > 0.5).all()
    return (volumes > 0) != (depth % 2 == 0)


def repeats_a_vertex(faces):
    """Tell which faces name a vertex twice."""
    a, b, c = faces.T
    return (a == b) | (b == c) | (c == a)
