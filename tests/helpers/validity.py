"""Whether a mesh has an inside: a check that shares no code with the library."""

import igl
import numpy as np
from igl.copyleft import cgal


def assert_valid(vertices, faces, points=20_000, crossings=True):
    """Assert bar by bar what a repaired mesh promises.

    Every edge has two faces that run along it in opposite directions; the faces
    around every vertex form one ring; no vertex is unused or at the place of
    another; no two faces meet elsewhere than in shared corners (CGAL's exact
    test; the library has its own); and the exact winding number at random
    points is 0 or 1, which makes outer surfaces face outward, cavities inward.
    """
    vertices, faces = np.asarray(vertices), np.asarray(faces, np.int64)
    directed = {}
    for a, b, c in faces.tolist():
        for edge in ((a, b), (b, c), (c, a)):
            assert edge not in directed, f"two faces run along {edge} the same way"
            directed[edge] = next(iter({a, b, c} - set(edge)))
    for a, b in directed:
        assert (b, a) in directed, f"the edge {(a, b)} has one face only"
    degree = np.bincount(faces.reshape(-1), minlength=len(vertices))
    assert degree.min() > 0, "a vertex is unused"
    for a, b in dict(list(directed)).items():
        ring, third = 0, b
        while ring == 0 or third != b:
            third, ring = directed[a, third], ring + 1
            assert ring <= degree[a]
        assert ring == degree[a], f"vertex {a} is not manifold"
    assert len(np.unique(vertices, axis=0)) == len(vertices), "two vertices at one place"
    if crossings:
        _, _, pairs, _, _ = cgal.remesh_self_intersections(vertices, faces, detect_only=True)
        assert not len(pairs), f"{len(pairs)} pairs of faces cross"
    middle, half = (vertices.min(0) + vertices.max(0)) / 2, np.ptp(vertices, axis=0) / 2
    asked = np.random.default_rng(1).uniform(-1, 1, (points, 3)) * half * 1.02
    turns = igl.winding_number(vertices - middle, faces, asked)
    off = np.abs(turns[:, None] - [0.0, 1.0]).min(axis=1)
    assert off.max() < 1e-3, f"winding numbers up to {off.max():.3g} off 0 and 1"


def volume(vertices, faces):
    """Return the enclosed volume."""
    corners = (vertices - vertices.mean(axis=0))[faces]
    return np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
