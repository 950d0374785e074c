"""Kinds of places that trajectories pass: tenths of the surface by curvature and thickness."""

import numpy as np
from scipy.spatial import cKDTree

from pandis.base.streams import COVERAGE, generator
from pandis.pipeline.geometry.thickness import inscribed_radius

#: Surface points that are split into tenths, and neighbours that curvature is measured from.
PLACES, NEIGHBOURS = 4000, 9
TENTHS = 10
#: A tenth is visited if this share of the samples lies in it: a tenth of its share of the surface.
VISITED = 0.01


def coverage(surface, engine, paths, seed):
    """Count the tenths of the surface that trajectories visit.

    Parameters
    ----------
    surface : pandis.pipeline.geometry.sampling.Surface
    engine : object
        The exact distance of a `pandis.pipeline.geometry.body.Body`.
    paths : ndarray, shape (p, m, 3), unit frame
    seed : int

    Returns
    -------
    dict
        ``curvature`` and ``thickness``: how many tenths of the surface's area, ordered by how
        fast the normal turns and by the largest ball inside, hold one sample in a hundred;
        ``share_…``: the share of samples in each.
    """
    rng = generator(seed, COVERAGE)
    places, normals, _, _ = surface.draw(PLACES, rng)
    tree = cKDTree(places)
    values = {
        "curvature": curvature(tree, places, normals),
        "thickness": inscribed_radius(engine, places, normals),
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
    """Return how fast the normal turns (n,) around surface points: radians per unit length."""
    apart, near = tree.query(places, NEIGHBOURS + 1)
    cosine = np.einsum("nk,njk->nj", normals, normals[near[:, 1:]])
    angle, same = np.arccos(np.clip(cosine, -1, 1)), cosine > 0  # the other side of a thin wall
    turn = np.where(same, angle / np.maximum(apart[:, 1:], 1e-12), 0.0)
    return turn.sum(axis=1) / np.maximum(same.sum(axis=1), 1)
