"""Finds how many parts a query must be allowed to visit so that none next to the surface is cut.

Where very many faces are about equally near, as in the middle of a ball, a query is cut: it returns
a lower bound of the distance, and a face that is not much farther. But where the boxes of very many
faces overlap, as around a corner of thousands of narrow faces, a cut query can be off by the size
of the object. One such corner is enough, however small it is and however large the mesh. No query
may be cut next to the surface, because contact happens there. So queries are tried at every vertex
and every face, at heights proportional to the lengths of the edges there.
"""

import numpy as np

from pandis.pipeline.geometry.sampling import Surface

#: Number of points next to the surface at which queries are tried, in addition to those at vertices
#: and faces.
_POINTS = 50_000
#: Range of these points' offsets from the surface (unit frame), log-uniform. Farther away queries
#: may be cut, because a search visits less there, whatever its limit: see PANDIS__CLOSE.
_HEIGHTS = 1e-5, 0.1
#: Range of distances from a vertex or a face's centre, as fractions of the longest edge there.
_SHARES = 1e-5, 0.1
#: Queries are tried at _TRIES points around a vertex that more than _CROWD faces share.
_CROWD, _TRIES = 32, 64


def near_surface(vertices, faces, count, *, rng):
    """Draw points (count, 3) next to a surface, in all directions from it.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), unit frame
    faces : ndarray, shape (F, 3)
    count : int
    rng : numpy.random.Generator
    """
    feet = Surface(vertices, faces).draw(count, rng)[0]
    return _moved(feet, np.exp(rng.uniform(*np.log(_HEIGHTS), count)), rng)


def at_corners(vertices, faces, rng):
    """Draw points (n, 3) next to every vertex and every face's middle.

    Vertices shared by very many faces get more points. The vertices themselves are included,
    although they are the easiest places: the first face visited is at distance 0, so no other box
    can be nearer.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), unit frame
    faces : ndarray, shape (F, 3)
    rng : numpy.random.Generator
    """
    corners = vertices[faces]
    longest = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).max(axis=1)
    around = np.zeros(len(vertices))
    np.maximum.at(around, faces.ravel(), np.repeat(longest, 3))
    crowded = np.bincount(faces.ravel(), minlength=len(vertices)) > _CROWD
    tried = np.repeat(np.arange(len(vertices)), np.where(crowded, _TRIES, 1))
    places = np.concatenate([vertices[tried], corners.mean(axis=1)])
    share = np.exp(rng.uniform(*np.log(_SHARES), len(places)))
    next_to = _moved(places, share * np.concatenate([around[tried], longest]), rng)
    return np.concatenate([vertices, next_to])


def _moved(points, length, rng):
    """Return points (n, 3), each moved by a length (n,) in a random direction."""
    away = rng.normal(size=points.shape)
    return points + away * (length / np.linalg.norm(away, axis=1))[:, None]


def least_limit(first, vertices, faces, *, query):
    """Return a limit twice as high as one that cuts no query tried on or next to a surface.

    The factor of two allows for points that are not tried, which can need a higher limit.

    Parameters
    ----------
    first : int
        Smallest limit to return. It is doubled until no tried query is cut.
    vertices : ndarray, shape (V, 3), unit frame
    faces : ndarray, shape (F, 3)
    query : callable
        Takes points (n, 3) and a limit (0: none); returns (distance, clear), each (n,), as
        `pandis.engine.packing.distance_and_clear` does.

    Returns
    -------
    int
    """
    rng = np.random.default_rng(0)
    near = near_surface(vertices, faces, _POINTS, rng=rng)
    points = np.concatenate([at_corners(vertices, faces, rng), near])
    points = points[np.abs(query(points, 0)[0]) <= _HEIGHTS[1]]
    enough = first // 2
    while True:
        distance, clear = query(points, enough)
        if not (clear < np.abs(distance)).any():
            return 2 * enough
        enough *= 2
