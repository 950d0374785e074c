"""The lossless rung: weld, drop degenerate and duplicate faces, unfold, orient, split contacts.

Each weld spans at most the tolerance, but a chain of welds may span more. Each copy of a
split vertex moves by `PARTING` times the diagonal, so that surfaces no longer touch.
"""

import numpy as np

from pandis.engine.faces import close, connected
from pandis.pipeline.mesh.diagnosis import altitudes
from pandis.pipeline.mesh.flips import flip_flat_faces, unfold
from pandis.pipeline.mesh.nesting import must_turn, nesting_depth, signed_volumes
from pandis.pipeline.mesh.topology import (
    compact,
    components,
    count_distinct,
    crossing_faces,
    edges_of,
    face_keys,
    fans,
    oriented,
    repeats_a_vertex,
    rotate_to_smallest,
    same_place,
    used_vertices,
)

#: Distance by which copies of a split vertex move into their solids, as a fraction of the diagonal.
PARTING = 1e-7
#: An inward direction runs along a face if it gains at most this much depth per unit length.
_SADDLE = 0.05
#: A model counts as made of two-sided sheets if more than this share of its area would cancel.
SHEETS = 0.1


def clean(vertices, faces, tolerance=0.0):
    """Weld vertices; drop degenerate, duplicate and folded faces and unreferenced vertices.

    Folded faces stay if more than `SHEETS` of the area would go: then they are sheets.

    Parameters
    ----------
    vertices, faces : ndarray
    tolerance : float
        Distance (mesh units) within which vertices are merged into the first of them. With 0,
        only equal ones are merged.

    Returns
    -------
    vertices, faces : ndarray
        The remaining vertices are bitwise unchanged and in the same order.
    """
    if tolerance:
        # igl.remove_duplicate_vertices rounds to a lattice, which separates some close pairs
        finite = np.flatnonzero(np.isfinite(vertices).all(axis=1))
        representative = connected(finite[close(vertices[finite], tolerance)], len(vertices))
    else:
        representative = same_place(vertices)
    welded = representative[faces]
    welded = resolve_duplicates(vertices, welded[~repeats_a_vertex(welded)])
    if not len(welded):
        return vertices, faces
    faces = flip_flat_faces(vertices, welded)
    unfolded = unfold(vertices, faces)
    if unfolded is not faces:
        after, before = (altitudes(vertices[some])[1].sum() for some in (unfolded, faces))
        if after >= (1 - SHEETS) * before:
            faces = flip_flat_faces(vertices, unfolded)
    return compact(vertices, faces)


def resolve_duplicates(vertices, faces):
    """Cancel opposite faces on the same three vertices, because they enclose nothing.

    The remaining faces on the same vertices have the same orientation. Of several exact copies,
    one is kept. If removing the others would open the mesh, all are kept, because the exact union
    resolves them later. If cancelling would remove more than `SHEETS` of the area, the faces are
    taken to be the two sides of sheets, and one side of each sheet is kept.
    """
    if count_distinct(faces) == len(faces):
        return faces
    _, index = np.unique(face_keys(faces), return_inverse=True)
    # the parity of the vertex order determines a face's orientation
    rolled = rotate_to_smallest(faces)
    side = np.where(rolled[:, 1] < rolled[:, 2], 1, -1)
    index = index.reshape(-1)
    net = np.bincount(index, side).astype(np.int64)
    order = np.lexsort((side, index))
    starts = np.concatenate([[0], np.cumsum(np.bincount(index[order] * 2 + (side[order] > 0)))])
    nth = np.empty(len(faces), np.int64)
    nth[order] = np.arange(len(faces)) - starts[index[order] * 2 + (side[order] > 0)]
    stays = (np.sign(net)[index] == side) & (nth < np.abs(net)[index])
    area = altitudes(vertices[faces])[1]
    if area[~stays].sum() > SHEETS * area.sum():
        _, first = np.unique(index, return_index=True)
        stays[first[net == 0]] = True
    return _once(faces[stays])


def _once(faces):
    """Return the faces without copies, or unchanged if removing copies would open the mesh."""
    _, first = np.unique(face_keys(faces), return_index=True)
    if len(first) == len(faces):
        return faces
    once = faces[np.sort(first)]
    faults = [(edges.boundary.sum(), (2 * edges.forward != edges.uses).sum())
              for edges in (edges_of(once), edges_of(faces))]  # fmt: skip
    opened = any(after > before for after, before in zip(*faults, strict=True))
    return faces if opened else once


def orient(vertices, faces, nested="cavity"):
    """Orient neighbours consistently, then each closed component outward (cavities inward).

    Parameters
    ----------
    vertices, faces : ndarray
    nested : {"cavity", "solid"}
        How to interpret a component wholly inside another. ``cavity``: as a cavity or a
        solid, alternating with nesting depth. ``solid``: always as a solid.

    Returns
    -------
    vertices, faces : ndarray
    """
    faces = np.ascontiguousarray(faces, np.int64)
    edges = edges_of(faces)
    if edges.conflicts.any() or (edges.nonmanifold.any() and not edges.balanced):
        faces = oriented(faces)
    component, count = components(faces)
    volumes = signed_volumes(vertices, faces, component, count=count)
    depth = np.zeros(count, np.int64)
    if nested == "cavity":
        depth = nesting_depth(vertices, faces, component, count=count)
    turn = must_turn(volumes, depth)[component]
    faces = faces.copy()
    faces[turn] = faces[turn][:, ::-1]
    return vertices, faces


def split(vertices, faces, straight=False):
    """Give every fan of faces its own vertices, so that all edges and vertices are manifold.

    At an edge with more than two faces, faces that bound the same wedge of the solid are
    joined (Guéziec et al. 2001, "Cutting and Stitching"). For any other face the edge
    becomes a boundary. An edge whose wedges meet again at both ends is halved first.
    Each copy of a vertex moves by `PARTING` into the solid that its faces bound.

    Parameters
    ----------
    vertices, faces : ndarray
        Consistently oriented.
    straight : bool
        If moving copies against their mean normals makes surfaces cross: whether to move them
        inward from all their faces instead.

    Returns
    -------
    vertices, faces : ndarray
    """
    apart, torn_faces, torn = _separate(vertices, faces)
    pinched = edges_of(torn_faces).nonmanifold.any()
    if pinched:
        vertices, faces = _halve_nonmanifold_edges(vertices, faces)
        apart, torn_faces, torn = _separate(vertices, faces)
    if len(torn):
        apart = _part(apart, torn_faces, torn, straight=straight)
    return compact(apart, torn_faces)


def _separate(vertices, faces):
    """Return the vertices and their copies, the faces that use them, and all copies' indices."""
    edges = edges_of(faces)
    fan = fans(faces, edges, _wedges(vertices, faces, edges))
    roots, index = np.unique(fan, return_inverse=True)
    owner = faces.reshape(-1)[roots]
    first = np.full(len(vertices), -1)
    first[owner[::-1]] = np.arange(len(roots))[::-1]
    is_copy = first[owner] != np.arange(len(roots))
    name = np.where(is_copy, len(vertices) + np.cumsum(is_copy) - 1, owner)
    copies = np.unique(name[np.isin(owner, owner[is_copy])])
    renamed = name[index.reshape(-1)].reshape(-1, 3).astype(np.int64)
    return np.concatenate([vertices, vertices[owner[is_copy]]]), renamed, copies


def _halve_nonmanifold_edges(vertices, faces):
    """Insert a vertex at the midpoint of every edge with more than two faces."""
    edges = edges_of(faces)
    crowded = np.flatnonzero(edges.nonmanifold)
    middle = vertices[edges.edges[crowded]].mean(axis=1)
    number = np.full(edges.count, -1)
    number[crowded] = len(vertices) + np.arange(len(crowded))
    halves = number[edges.edge_of].reshape(-1, 3)
    pieces = []
    cut = (halves >= 0).any(axis=1)
    for face, mid in zip(faces[cut].tolist(), halves[cut].tolist(), strict=True):
        pieces += _cut(face, mid)
    whole = faces[~cut]
    return np.concatenate([vertices, middle]), np.concatenate([whole, np.array(pieces, np.int64)])


def _cut(face, mid):
    """Triangulate a face with extra vertices ``mid`` (−1: none) on its edges."""
    polygon = []
    for k in range(3):
        polygon.append(face[k])
        if mid[k] >= 0:
            polygon.append(mid[k])
    # start at an edge's midpoint: a fan from a corner could have a flat triangle
    k = polygon.index(next(m for m in mid if m >= 0))
    polygon = polygon[k:] + polygon[:k]
    if len(polygon) == 6:
        a, b, c, d, e, f = polygon
        return [[a, b, c], [c, d, e], [e, f, a], [a, c, e]]
    return [[polygon[0], polygon[i], polygon[i + 1]] for i in range(1, len(polygon) - 1)]


def _wedges(vertices, faces, edges):
    """Return the pairs (m, 2) of half-edges that bound a wedge at a non-manifold edge."""
    order = np.argsort(edges.edge_of, kind="stable")
    starts = np.concatenate([[0], np.cumsum(edges.uses)])
    pairs = []
    for edge in np.flatnonzero(edges.nonmanifold):
        half = order[starts[edge] : starts[edge + 1]]
        u, v = vertices[edges.edges[edge]]
        along = (v - u) / max(np.linalg.norm(v - u), 1e-300)
        arm = vertices[faces[half // 3, (half % 3 + 2) % 3]] - u
        arm -= (arm @ along)[:, None] * along
        x = arm[0] / max(np.linalg.norm(arm[0]), 1e-300)
        angle = np.arctan2(arm @ np.cross(along, x), arm @ x)
        forward = edges.runs_forward[half]
        # around the edge, each backward face begins a wedge and each forward face ends one
        round_trip = half[np.lexsort((forward, angle))]
        opened = []
        closed = set()
        for h in [*round_trip, *round_trip]:
            if h in closed:
                continue
            if not edges.runs_forward[h]:
                if h not in opened:
                    opened.append(h)
            elif opened:
                pairs.append((opened.pop(), h))
                closed |= set(pairs[-1])
    return np.asarray(pairs, np.int64).reshape(-1, 2)


def _part(vertices, faces, moving, *, straight):
    """Move each copy of a vertex by `PARTING` into the solid that its faces bound.

    Copies move against their mean normals. If surfaces then cross and ``straight`` is set, all
    copies move along `_ways_in` instead. If it is not set, the copies at crossing faces move
    outward, provided that fewer faces then cross.
    """
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    size = PARTING * np.linalg.norm(np.ptp(vertices[used_vertices(faces)], axis=0))
    sums = np.zeros_like(vertices)
    np.add.at(sums, faces.reshape(-1), np.repeat(normal, 3, axis=0))
    length = np.linalg.norm(sums[moving], axis=1, keepdims=True)
    way = np.zeros_like(vertices)
    way[moving] = -size * sums[moving] / np.maximum(length, 1e-300)
    pairs = crossing_faces(vertices + way, faces)
    if not len(pairs):
        return vertices + way
    if straight:
        return vertices + size * _ways_in(vertices, faces, normal, moving=moving)
    way[np.intersect1d(faces[pairs.reshape(-1)], moving)] *= -1
    outward = vertices + way
    way[moving] = -size * sums[moving] / np.maximum(length, 1e-300)
    return outward if len(crossing_faces(outward, faces)) < len(pairs) else vertices + way


def _ways_in(vertices, faces, normal, *, moving):
    """Return unit vectors (V, 3) that point from copies of vertices into their solids, 0 elsewhere.

    Each points inward from all faces of its copy, so that moved surfaces meet no others. At a
    saddle there is no such direction: of the copies at one place, the one that would gain the
    least depth stays.
    """
    order = np.argsort(faces.reshape(-1), kind="stable")
    owner = faces.reshape(-1)[order]
    starts, ends = np.searchsorted(owner, moving), np.searchsorted(owner, moving, "right")
    ways, depths = np.zeros((len(moving), 3)), np.zeros(len(moving))
    for k, (start, end) in enumerate(zip(starts, ends, strict=True)):
        ways[k], depths[k] = _inward(normal[order[start:end] // 3])
    _, place = np.unique(vertices[moving], axis=0, return_inverse=True)
    place = place.reshape(-1)
    worst = np.full(place.max() + 1, np.inf)
    np.minimum.at(worst, place, depths)
    ways[(depths <= _SADDLE) & (depths == worst[place])] = 0
    way = np.zeros_like(vertices)
    way[moving] = ways
    return way


def _inward(normals, rounds=60):
    """Return the direction that leads deepest below all planes with normals (n, 3), and its depth.

    Each round turns the unit vector away from the plane below which it is least deep.
    """
    way, best = -normals.sum(axis=0), (np.zeros(3), -1.0)
    for turn in range(rounds):
        way /= max(np.linalg.norm(way), 1e-300)
        along = normals @ way
        if -along.max() > best[1]:
            best = way.copy(), float(-along.max())
        way = way - normals[along.argmax()] / (turn + 1)
    return best


def loosen(vertices, faces, *, tries=40):
    """Perturb the corners of the few faces that still cross or touch.

    After the coordinates of an exact union are rounded to float64, a few faces may touch
    along a line. Each try moves their corners at random, by 1e-9 to 1e-6 of the diagonal.
    The new positions are kept if fewer faces cross.

    Parameters
    ----------
    vertices, faces : ndarray

    Returns
    -------
    vertices, faces : ndarray
    """
    rng = np.random.default_rng(0)
    sides = np.ptp(vertices[used_vertices(faces)], axis=0)
    diagonal, extent = np.linalg.norm(sides), sides.max()
    pairs = crossing_faces(vertices, faces)
    if not 0 < len(pairs) <= 1000:
        return vertices, faces
    around = faces[
        _near(vertices, faces, np.unique(faces[pairs.reshape(-1)]), margin=1e-5 * diagonal)
    ]
    pairs = crossing_faces(vertices, around, extent=extent)
    for amount in np.geomspace(1e-9, 1e-6, tries) * diagonal:
        if not len(pairs):
            break
        moving = np.unique(around[pairs.reshape(-1)])
        moved = vertices.copy()
        moved[moving] += amount * rng.uniform(-1, 1, (len(moving), 3))
        now = crossing_faces(moved, around, extent=extent)
        if len(now) < len(pairs):
            vertices, pairs = moved, now
    return vertices, faces


def _near(vertices, faces, moving, *, margin):
    """Return the faces whose boxes overlap those of the faces at ``moving`` vertices."""
    corners = vertices[faces]
    low, high = corners.min(axis=1) - margin, corners.max(axis=1)
    active = np.isin(faces, moving).any(axis=1)
    near = active.copy()
    for k in np.flatnonzero(active):
        near |= ((low <= high[k]) & (high >= low[k])).all(axis=1)
    return np.flatnonzero(near)
