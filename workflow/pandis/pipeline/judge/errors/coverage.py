"""Measures how much of the surface the trajectories visit, by curvature and by thickness."""

import numpy as np
from scipy.spatial import cKDTree

from pandis.base.streams import COVERAGE, generator
from pandis.pipeline.geometry.thickness import inscribed_radius

#: PLACES surface points are sorted into tenths. A point's curvature is measured from its NEIGHBOURS
#: nearest points.
PLACES, NEIGHBOURS = 4000, 9
TENTHS = 10
#: A tenth of the surface counts as visited if it contains at least this share of the samples.
VISITED = 0.01


def coverage(body, paths, seed):
    """Count the tenths of the surface that trajectories visit.

    Parameters
    ----------
    body : pandis.pipeline.geometry.body.Body
    paths : ndarray, shape (p, m, 3), unit frame
    seed : int

    Returns
    -------
    dict
        ``curvature`` and ``thickness``: number of visited tenths of the area, which is sorted by
        `curvature` or by inscribed radius; ``share_curvature`` and ``share_thickness``: share
        of the samples in each tenth.
    """
    rng = generator(seed, COVERAGE)
    places, normals, _, _ = body.surface.draw(PLACES, rng)
    tree = cKDTree(places)
    values = {
        "curvature": curvature(tree, places, normals),
        "thickness": inscribed_radius(body.distance, places, normals),
    }
    nearest = tree.query(paths.reshape(-1, 3))[1]
    shares = {}
    for name, value in values.items():
        tenth = np.argsort(np.argsort(value, kind="stable"), kind="stable") * TENTHS // PLACES
        share = np.bincount(tenth[nearest], minlength=TENTHS) / len(nearest)
        shares[name] = int((share >= VISITED).sum())
        shares[f"share_{name}"] = share.tolist()
    return shares


def curvature(tree, places, normals):
    """Return how fast (n,) the normal turns near each surface point, rad per unit length."""
    apart, near = tree.query(places, NEIGHBOURS + 1)
    cosine = np.einsum("nk,njk->nj", normals, normals[near[:, 1:]])
    angle, same = np.arccos(np.clip(cosine, -1, 1)), cosine > 0  # not across thin walls
    turn = np.where(same, angle / np.maximum(apart[:, 1:], 1e-12), 0.0)
    return turn.sum(axis=1) / np.maximum(same.sum(axis=1), 1)
