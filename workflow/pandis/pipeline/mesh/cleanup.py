"""The lossless rung: weld, drop what bounds nothing, split what only touches, face outward.

No surface moves by more than the weld's tolerance; vertices that were split are
parted by `PARTING` of the diagonal, so that surfaces no longer touch.
"""

import igl
import numpy as np
from scipy.spatial import cKDTree

from pandis.pipeline.mesh.diagnosis import FLAT, altitudes, crossing_faces
from pandis.pipeline.mesh.nesting import must_turn, nesting_depth, signed_volumes
from pandis.pipeline.mesh.topology import (
    EdgeTable,
    compact,
    components,
    connected,
    fans,
    repeats_a_vertex,
    rotate_to_smallest,
    same_place,
)

#: How far copies of a split vertex move into their own matter, as a share of the diagonal.
PARTING = 1e-7
#: A way into the matter that leads less far in than this, of its length, leads along a face.
_SADDLE = 0.05
#: More of the area than this in opposite doubles: a model made of two-sided sheets.
SHEETS = 0.1


def clean(vertices, faces, tolerance=0.0):
    """Weld vertices; drop degenerate and duplicate faces and unreferenced vertices.

    Parameters
    ----------
    vertices, faces : ndarray
    tolerance : float
        Vertices this close become one (the first of them); 0 welds equal ones only.

    Returns
    -------
    vertices, faces : ndarray
        Kept vertices keep their bits and their order.
    """
    if tolerance:
        # not igl.remove_duplicate_vertices: that rounds to a lattice and parts close pairs
        finite = np.where(np.isfinite(vertices), vertices, 0)
        pairs = cKDTree(finite).query_pairs(tolerance, output_type="ndarray")
        representative = connected(pairs, len(vertices))
    else:
        representative = same_place(vertices)
    welded = representative[faces]
    welded = resolve_duplicates(vertices, welded[~repeats_a_vertex(welded)])
    if not len(welded):
        return vertices, faces
    return compact(vertices, flip_flat_faces(vertices, welded))


def resolve_duplicates(vertices, faces):
    """Let faces over the same three vertices cancel: opposite ones enclose nothing.

    What is left of such a set all faces one way. Of exact copies one stays, unless taking the
    others away would open a mesh that is closed (the exact union resolves it).
    Where cancelling would take more than `SHEETS` of the area, the faces are the
    two sides of sheets, and one side of each stays.
    """
    _, index, counts = np.unique(
        np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    if (counts == 1).all():
        return faces
    # the parity of the vertex order is the side a face shows
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
    """Return faces without copies, if that opens nothing."""
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    if len(first) == len(faces):
        return faces
    once = faces[np.sort(first)]
    faults = [(edges.boundary.sum(), (2 * edges.forward != edges.uses).sum())
              for edges in (EdgeTable(once), EdgeTable(faces))]  # fmt: skip
    opened = any(after > before for after, before in zip(*faults, strict=True))
    return faces if opened else once


def flip_flat_faces(vertices, faces, rounds=20):
    """Turn the longest edge of every face without area, so that it and its neighbour have some.

    A flat face's corner lies on its longest edge: with the neighbour across
    that edge it covers the same surface as the two faces after the flip.
    """
    faces = faces.copy()
    for _ in range(rounds):
        flat = np.flatnonzero(altitudes(vertices[faces])[0] <= FLAT)
        if not len(flat):
            break
        edges = EdgeTable(faces)
        known = {tuple(edge) for edge in edges.edges.tolist()}
        order = np.argsort(edges.edge_of, kind="stable")
        starts = np.concatenate([[0], np.cumsum(edges.uses)])
        corners = vertices[faces[flat]]
        longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).argmax(axis=1)
        touched, flipped = set(), 0
        for face, k in zip(flat.tolist(), longest.tolist(), strict=True):
            edge = edges.edge_of[3 * face + k]
            if edges.uses[edge] != 2 or edges.forward[edge] != 1:
                continue
            half = order[starts[edge] : starts[edge] + 2]
            other = int(half[half != 3 * face + k][0])
            neighbour, j = divmod(other, 3)
            a, b, tip = (faces[face, (k + i) % 3] for i in range(3))
            far = faces[neighbour, (j + 2) % 3]
            new = (min(tip, far), max(tip, far))
            if {face, neighbour} & touched or tip == far or new in known:
                continue
            faces[face], faces[neighbour] = (a, far, tip), (far, b, tip)
            touched |= {face, neighbour}
            known.add(new)
            flipped += 1
        if not flipped:
            break
    return faces


def orient(vertices, faces, nested="cavity"):
    """Make neighbours agree, then turn each closed component outward (cavities inward).

    Parameters
    ----------
    vertices, faces : ndarray
    nested : {"cavity", "solid"}
        What a component wholly inside another bounds: by nesting parity a
        cavity (and in it an island, …), or always matter.

    Returns
    -------
    vertices, faces : ndarray
    """
    faces = np.ascontiguousarray(faces, np.int64)
    edges = EdgeTable(faces)
    if edges.conflicts.any() or (edges.nonmanifold.any() and not edges.balanced):
        faces = np.ascontiguousarray(igl.bfs_orient(faces)[0], np.int64)
    component, count = components(faces)
    volumes = signed_volumes(vertices, faces, component, count)
    depth = np.zeros(count, np.int64)
    if nested == "cavity":
        crossings = crossing_faces(vertices, faces) if count > 1 else np.empty((0, 2), np.int64)
        depth = nesting_depth(vertices, faces, component, count, crossings)
    turn = must_turn(volumes, depth)[component]
    faces = faces.copy()
    faces[turn] = faces[turn][:, ::-1]
    return vertices, faces


def split(vertices, faces, straight=False):
    """Give every fan of faces its own vertices, so that all edges and vertices are manifold.

    At an edge of four faces and more, those are joined that bound the same
    wedge of matter (Guéziec et al. 2001, "Cutting and Stitching"); faces left
    over keep the edge as a boundary. An edge whose wedges meet again at both
    ends is halved first. The copies of a vertex are parted by `PARTING`, each
    into its own matter.

    Parameters
    ----------
    vertices, faces : ndarray
        Consistently oriented.
    straight : bool
        Where copies cross if they move against the mean of their normals, they move straight in
        from all faces.

    Returns
    -------
    vertices, faces : ndarray
    """
    apart, torn_faces, torn = _separate(vertices, faces)
    pinched = EdgeTable(torn_faces).nonmanifold.any()
    if pinched:
        vertices, faces = _halve_nonmanifold_edges(vertices, faces)
        apart, torn_faces, torn = _separate(vertices, faces)
    if len(torn):
        apart = _part(apart, torn_faces, torn, straight)
    return compact(apart, torn_faces)


def _separate(vertices, faces):
    """Return vertices with copies, faces that use them, and the indices of all copies."""
    edges = EdgeTable(faces)
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
    """Put a vertex into the middle of every edge of more than two faces."""
    edges = EdgeTable(faces)
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
    # a fan from a vertex in the middle of an edge has no flat piece
    k = polygon.index(next(m for m in mid if m >= 0))
    polygon = polygon[k:] + polygon[:k]
    if len(polygon) == 6:
        a, b, c, d, e, f = polygon
        return [[a, b, c], [c, d, e], [e, f, a], [a, c, e]]
    return [[polygon[0], polygon[i], polygon[i + 1]] for i in range(1, len(polygon) - 1)]


def _wedges(vertices, faces, edges):
    """Return pairs (m, 2) of half-edges at edges of more than two faces that bound one wedge."""
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
        # matter lies beyond a backward face and before a forward one: brackets, on a circle
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


def _part(vertices, faces, moving, straight):
    """Part the copies of vertices: each moves by `PARTING` into its own matter.

    Against the mean of its normals; where surfaces cross by that, out of the matter if fewer do so
    then, or straight in from all its faces.
    """
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    size = PARTING * np.linalg.norm(np.ptp(vertices[np.unique(faces)], axis=0))
    sums = np.zeros_like(vertices)
    np.add.at(sums, faces.reshape(-1), np.repeat(normal, 3, axis=0))
    length = np.linalg.norm(sums[moving], axis=1, keepdims=True)
    way = np.zeros_like(vertices)
    way[moving] = -size * sums[moving] / np.maximum(length, 1e-300)
    pairs = crossing_faces(vertices + way, faces)
    if not len(pairs):
        return vertices + way
    if straight:
        return vertices + size * _ways_in(vertices, faces, normal, moving)
    way[np.intersect1d(faces[pairs.reshape(-1)], moving)] *= -1
    outward = vertices + way
    way[moving] = -size * sums[moving] / np.maximum(length, 1e-300)
    return outward if len(crossing_faces(outward, faces)) < len(pairs) else vertices + way


def _ways_in(vertices, faces, normal, moving):
    """Return unit vectors (V, 3) that lead copies of vertices into their matter, 0 for the others.

    Straight in from all faces, so that surfaces that have moved meet no others. Around a saddle no
    way leads so: of the copies at one place such a one stays where it is.
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
    """Return the unit vector that leads farthest in from all planes of normals (n, 3), and how far.

    By turning it away from the plane that it leads least far from.
    """
    way, best = -normals.sum(axis=0), (np.zeros(3), -1.0)
    for turn in range(rounds):
        way /= max(np.linalg.norm(way), 1e-300)
        along = normals @ way
        if -along.max() > best[1]:
            best = way.copy(), float(-along.max())
        way = way - normals[along.argmax()] / (turn + 1)
    return best


def loosen(vertices, faces, crossings=crossing_faces, tries=40):
    """Move the corners of the last faces that cross or touch by next to nothing.

    After an exact union its coordinates are rounded to float64; a few faces may
    then touch along a line. Each try moves their corners at random, by 1e-9 to
    1e-6 of the diagonal, and counts if fewer cross.

    Parameters
    ----------
    vertices, faces : ndarray
    crossings : callable
        From vertices and faces to the pairs of faces that cross.

    Returns
    -------
    vertices, faces : ndarray
    """
    rng = np.random.default_rng(0)
    diagonal = np.linalg.norm(np.ptp(vertices[np.unique(faces)], axis=0))
    pairs = crossings(vertices, faces)
    if not 0 < len(pairs) <= 1000:
        return vertices, faces
    around = faces[_near(vertices, faces, np.unique(faces[pairs.reshape(-1)]), 1e-5 * diagonal)]
    pairs = crossings(vertices, around)
    for amount in np.geomspace(1e-9, 1e-6, tries) * diagonal:
        if not len(pairs):
            break
        moving = np.unique(around[pairs.reshape(-1)])
        moved = vertices.copy()
        moved[moving] += amount * rng.uniform(-1, 1, (len(moving), 3))
        now = crossings(moved, around)
        if len(now) < len(pairs):
            vertices, pairs = moved, now
    return vertices, faces


def _near(vertices, faces, moving, margin):
    """Return the faces whose boxes meet those of the faces at ``moving`` vertices."""
    corners = vertices[faces]
    low, high = corners.min(axis=1) - margin, corners.max(axis=1)
    active = np.isin(faces, moving).any(axis=1)
    near = active.copy()
    for k in np.flatnonzero(active):
        near |= ((low <= high[k]) & (high >= low[k])).all(axis=1)
    return np.flatnonzero(near)
