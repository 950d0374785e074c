"""Connectivity of a triangle mesh: edges, rims, fans around a vertex, components, crossings.

Most functions use only indices; positions are needed for lengths, for coincident vertices and for
faces that cross. No function modifies its arguments.
"""

from functools import wraps

import numpy as np

from pandis.engine.faces import connected, crossings, folded, orientation

#: Number of results that are remembered: stages of a repair often ask for the same one.
_REMEMBERED = 3
#: Largest length of all arrays whose results a function remembers, some 300 MB.
_MOST_FACES = 1_000_000


def _remembered(function):
    """Make a function of arrays return its last results again for equal arrays.

    Results are handed out again, so nobody may modify them.
    """
    results = []

    @wraps(function)
    def remembering(*arrays):
        for known, result, _ in tuple(results):
            pairs = zip(known, arrays, strict=True)
            if all(a.dtype == b.dtype and np.array_equal(a, b) for a, b in pairs):
                return result
        result = function(*arrays)
        size = max(len(a) for a in (*arrays, result) if isinstance(a, np.ndarray))
        if size <= _MOST_FACES:
            while (
                len(results) == _REMEMBERED or sum(each[2] for each in results) > _MOST_FACES - size
            ):
                results.pop()
            results.insert(0, ([np.array(a) for a in arrays], result, size))
        return result

    return remembering


class EdgeTable:
    """The edges of a mesh, and the number and direction of the faces along them: see `edges_of`.

    Half-edge ``3 f + k`` runs from corner k of face f to its corner k + 1.

    Attributes
    ----------
    edges : ndarray, shape (E, 2)
        Vertex indices, the smaller first.
    edge_of : ndarray, shape (3 F,)
        Index of each half-edge's edge.
    order : ndarray, shape (3 F,)
        Half-edges sorted by edge, those of one edge in ascending order.
    uses, forward : ndarray, shape (E,)
        Number of faces at each edge, and how many of them traverse it from its smaller index.
    """

    def __init__(self, faces):
        self.directed = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        low, high = np.minimum(*self.directed.T), np.maximum(*self.directed.T)
        span = self._span = int(faces.max(initial=0)) + 1
        key, self.order = _sorted(low.astype(np.int64) * span + high)
        starts = np.flatnonzero(np.concatenate([key[:1] >= 0, key[1:] != key[:-1]]))
        self._key, self.uses = key[starts], np.diff(starts, append=len(key))
        self.edge_of = np.empty(len(key), np.int64)
        self.edge_of[self.order] = np.repeat(np.arange(len(starts)), self.uses)
        self.edges = np.stack([self._key // span, self._key % span], axis=1)
        self.runs_forward = self.directed[:, 0] == low
        self.forward = np.bincount(self.edge_of[self.runs_forward], minlength=len(self._key))
        for array in vars(self).values():
            if isinstance(array, np.ndarray):
                array.flags.writeable = False

    @property
    def count(self):
        """Number of edges."""
        return len(self.edges)

    def has(self, edge):
        """Return whether there is an edge between a pair of vertices, the smaller first."""
        key = edge[0] * self._span + edge[1]
        at = np.searchsorted(self._key, key)
        return at < len(self._key) and self._key[at] == key

    @property
    def closed(self):
        """Whether every edge has exactly two faces."""
        return bool((self.uses == 2).all())

    @property
    def balanced(self):
        """Whether faces traverse each edge equally often in both directions, as around a solid."""
        return bool((2 * self.forward == self.uses).all())

    @property
    def boundary(self):
        """Mask of the edges with only one face."""
        return self.uses == 1

    @property
    def nonmanifold(self):
        """Mask of the edges with more than two faces."""
        return self.uses > 2

    @property
    def conflicts(self):
        """Mask of the edges with two faces that disagree in orientation."""
        return (self.uses == 2) & (self.forward != 1)

    def pairs(self):
        """Return the pairs (m, 2) of half-edges at edges with two faces."""
        return self.order[np.repeat(self.uses == 2, self.uses)].reshape(-1, 2)

    def holes(self, vertices):
        """Return the edge count and the length of each connected rim, longest first."""
        rim = self.directed[self.boundary[self.edge_of]]
        if not len(rim):
            return []
        nodes, index = np.unique(rim, return_inverse=True)
        index = index.reshape(-1, 2)
        label = connected(index, len(nodes))[index[:, 0]]
        lengths = np.linalg.norm(vertices[rim[:, 0]] - vertices[rim[:, 1]], axis=1)
        _, which = np.unique(label, return_inverse=True)
        holes = [
            {"edges": int(edges), "length": float(length)}
            for edges, length in zip(np.bincount(which), np.bincount(which, lengths), strict=True)
        ]
        return sorted(holes, key=lambda hole: -hole["length"])


def _sorted(keys):
    """Return keys (n,) >= 0 in ascending order, and the places where they were, the first first."""
    bits = len(keys).bit_length()
    if int(keys.max(initial=0)).bit_length() + bits > 63:
        order = np.argsort(keys, kind="stable")
        return keys[order], order
    # to sort numbers that contain their places takes half as long as to sort the places
    both = np.sort((keys << bits) | np.arange(len(keys)))
    return both >> bits, both & ((1 << bits) - 1)


def _numbered(first):
    """Number the groups of a partition that is given by the first member of everyone's group."""
    starts = first == np.arange(len(first))
    number = np.cumsum(starts) - 1
    return number[first], int(starts.sum())


@_remembered
def edges_of(faces):
    """Return the `EdgeTable` of faces (F, 3)."""
    return EdgeTable(faces)


def one_sided(faces):
    """Return a mask (F,) of the faces of closed manifold pieces with only one side.

    Such a piece, for example a Klein bottle, cannot be oriented consistently and has no inside.
    """
    edges = edges_of(faces)
    patch, _, one_sided = _orientation(faces)
    open_ = np.zeros(len(faces), bool)
    open_[patch[np.flatnonzero(edges.uses[edges.edge_of] != 2) // 3]] = True
    return one_sided & ~open_[patch]


def oriented(faces):
    """Return faces (F, 3), turned so that neighbours agree with the first face of their patch.

    A patch is connected by edges with two faces. If it has only one side, some do not agree.
    """
    turned = _orientation(faces)[1]
    faces = faces.copy()
    faces[turned] = faces[turned][:, ::-1]
    return faces


def _orientation(faces):
    edges = edges_of(faces)
    one, other = edges.pairs().T
    neighbours, agrees = np.full(3 * len(faces), -1), np.zeros(3 * len(faces), bool)
    neighbours[one], neighbours[other] = other // 3, one // 3
    agrees[one] = agrees[other] = edges.runs_forward[one] != edges.runs_forward[other]
    return orientation(neighbours.reshape(-1, 3), agrees.reshape(-1, 3))


def patches(faces):
    """Return the patch of each face, joined by edges with two faces, and the number of patches."""
    return _numbered(_orientation(faces)[0])


@_remembered
def components(faces):
    """Return the edge-connected component of each face, and the number of components."""
    edges = edges_of(faces)
    edge, half = edges.edge_of[edges.order], edges.order
    same = np.flatnonzero(edge[1:] == edge[:-1])
    pairs = np.stack([half[same], half[same + 1]], axis=1) // 3
    label, count = _numbered(connected(pairs, len(faces)))
    label.flags.writeable = False
    return label, count


def face_keys(faces):
    """Return a key (F,) for each face; two keys are equal if the faces have the same vertices."""
    edges = edges_of(faces)
    sides = edges.edge_of.reshape(-1, 3)  # two edges of a face determine its vertices
    return sides.min(axis=1) * edges.count + sides.max(axis=1)


def count_distinct(faces):
    """Return the number of distinct vertex triples, regardless of their order."""
    return len(faces) and 1 + int(np.count_nonzero(np.diff(np.sort(face_keys(faces)))))


def fans(faces, edges, also=None):
    """Return the fan of each corner, (3 F,): the faces joined around its vertex by manifold edges.

    A vertex with more than one fan is not manifold. Fans are numbered by their
    smallest corner index (``3 f + k``).

    Parameters
    ----------
    faces : ndarray, shape (F, 3)
    edges : EdgeTable
    also : ndarray, shape (m, 2), optional
        Additional pairs of half-edges to join.
    """
    half = edges.pairs()
    if also is not None:
        half = np.concatenate([half, also])
    # join the corners of two faces at the same end of their common edge
    corner = (3 * (half // 3))[..., None] + np.stack([half % 3, (half + 1) % 3], axis=-1)
    vertex = faces.reshape(-1)[corner]
    pairs = []
    for mine in (0, 1):
        theirs = np.where(vertex[:, 0, mine] == vertex[:, 1, 0], 0, 1)
        pairs.append(
            np.stack([corner[:, 0, mine], corner[np.arange(len(corner)), 1, theirs]], axis=1)
        )
    return connected(np.concatenate(pairs), faces.size)


def nonmanifold_vertices(faces, edges):
    """Return the vertices around which the faces form more than one fan."""
    fan = fans(faces, edges)
    roots = np.flatnonzero(fan == np.arange(len(fan)))
    vertex, count = np.unique(faces.reshape(-1)[roots], return_counts=True)
    return vertex[count > 1]


@_remembered
def same_place(vertices):
    """For each vertex, return the index of the first vertex with the same coordinates."""
    first = equal_rows(vertices + 0.0)  # -0.0 becomes 0.0
    first.flags.writeable = False
    return first


def equal_rows(rows):
    """Return for each row (n, k) the index of the first row that is equal to it."""
    order = np.lexsort(rows.T)  # stable, and twice as fast as np.unique with an axis
    rows = rows[order]
    starts = np.ones(len(rows), bool)
    starts[1:] = (rows[1:] != rows[:-1]).any(axis=1)
    first = np.empty(len(rows), np.int64)
    first[order] = order[starts][np.cumsum(starts) - 1]
    return first


def repeats_a_vertex(faces):
    """Return a mask (F,) of the faces that use a vertex more than once."""
    a, b, c = faces.T
    return (a == b) | (b == c) | (c == a)


def crossing_faces(vertices, faces, question=None, *, extent=None):
    """Return the pairs (m, 2) of faces that meet outside their shared vertices and edges, sorted.

    The test is exact. Faces that merely touch are included, because the closest surface is
    ambiguous where two surfaces touch. So are neighbours that are folded onto each other within
    rounding. Faces that use a vertex twice are left out.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), float64
    faces : ndarray, shape (F, 3), int64
    question : ndarray, shape (F,), bool, optional
        Only pairs with at least one of these faces are returned.
    extent : float, optional
        Longest side of the mesh, if these are not all of its faces: see
        `pandis.engine.faces.folded`.
    """
    sound = np.flatnonzero(~repeats_a_vertex(faces))
    corners = np.sort(faces[sound], axis=1)  # turning a face changes nothing
    if extent is None:
        extent = longest_side(vertices, corners)
    if question is None:
        return sound[_all_crossings(vertices, corners, np.float64(extent))]
    return sound[crossings(vertices, corners, question[sound], extent=extent)]


def longest_side(vertices, faces):
    """Return the longest side of the box around the vertices that faces use."""
    used = used_vertices(faces)
    return np.ptp(vertices[used], axis=0).max() if len(used) else 0.0


@_remembered
def _all_crossings(vertices, faces, extent):
    return crossings(vertices, faces, extent=extent)


def folded_halves(vertices, faces):
    """Return the pairs (m, 2) of half-edges at which a face lies on its neighbour.

    Only neighbours that agree in orientation are compared: see `pandis.engine.faces.folded`.
    """
    edges = edges_of(faces)
    pairs = edges.pairs()
    pairs = pairs[edges.runs_forward[pairs[:, 0]] != edges.runs_forward[pairs[:, 1]]]
    corners = np.concatenate([edges.directed[pairs[:, 0]], opposite(faces, pairs)], axis=1)
    return pairs[folded(vertices, corners, extent=longest_side(vertices, faces))]


def opposite(faces, halves):
    """Return the vertices of faces (F, 3) that lie opposite to half-edges, in the same shape."""
    return faces[halves // 3, (halves % 3 + 2) % 3]


def rotate_to_smallest(faces):
    """Rotate each face so that it begins with its smallest index; its orientation is unchanged."""
    start = np.argmin(faces, axis=1)
    return np.take_along_axis(faces, (start[:, None] + [0, 1, 2]) % 3, axis=1)


def used_vertices(faces):
    """Return the indices of the vertices that faces use, in ascending order."""
    corners = faces.reshape(-1)
    if len(corners) and corners.max() <= 8 * len(corners):
        return np.flatnonzero(np.bincount(corners))  # ten times as fast as np.unique
    return np.unique(corners)


def compact(vertices, faces):
    """Drop vertices that no face uses; the others are bitwise unchanged and in the same order."""
    used = used_vertices(faces)
    index = np.empty(used[-1] + 1 if len(used) else 0, np.int64)
    index[used] = np.arange(len(used))
    return vertices[used], index[faces]
