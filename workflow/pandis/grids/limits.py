"""How much of a mesh one query may look at, so that none next to its surface is cut.

Where very many faces are about equally near, as in the middle of a ball, a query is cut: it says
how far all faces are at least, and answers one that is not much farther. But where the boxes of
very many faces overlap, as around a corner of thousands of narrow ones, what is cut can be wrong
by the size of the object. Contact happens next to the surface: so nothing may be cut there.
"""

import numpy as np

from pandis.geometry.sampling import Surface

#: Points next to the surface, and vertices, at which queries are tried.
_POINTS = 50_000
#: Heights above and below the surface (unit frame), spread by logarithm.
_HEIGHTS = 1e-5, 0.1


def near_surface(vertices, faces, count, rng):
    """Draw points (count, 3) next to a surface, in all directions from it.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), unit frame
    faces : ndarray, shape (F, 3)
    count : int
    rng : numpy.random.Generator
    """
    feet = Surface(vertices, faces).draw(count, rng)[0]
    height = np.exp(rng.uniform(*np.log(_HEIGHTS), count)) * rng.choice((-1, 1), count)
    away = rng.normal(size=(count, 3))
    return feet + away * (height / np.linalg.norm(away, axis=1))[:, None]


def least_limit(first, vertices, faces, query):
    """Double a limit until no query next to a surface, or at a vertex of it, is cut.

    Parameters
    ----------
    first : int
        The least one.
    vertices : ndarray, shape (V, 3), unit frame
    faces : ndarray, shape (F, 3)
    query : callable
        Answers (distance, clear), each (n,), at points (n, 3) with a limit, as
        `pandis.native.packing.distances` does.

    Returns
    -------
    int
    """
    rng = np.random.default_rng(0)
    few = vertices[:: -(-len(vertices) // _POINTS)]
    points = np.concatenate([few, near_surface(vertices, faces, _POINTS, rng)])
    most = first
    while True:
        distance, clear = query(points, most)
        points = points[clear < np.abs(distance)]
        if not len(points):
            return most
        most *= 2
