"""A judge of contacts that shares no code with them: libigl's closest points, and a slow walk."""

from itertools import combinations

import igl
import numpy as np


class Solid:
    """A closed mesh, as libigl sees it.

    Parameters
    ----------
    vertices : ndarray, shape (v, 3)
    faces : ndarray of int, shape (f, 3)
        Wound outwards.
    """

    def __init__(self, vertices, faces):
        self.vertices = np.asfortranarray(vertices, np.float64)
        self.faces = np.asfortranarray(faces, np.int64)
        self._tree = igl.AABB()
        self._tree.init(self.vertices, self.faces)
        corners = self.vertices[self.faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self.areas = 0.5 * np.linalg.norm(across, axis=1)
        self.normals = across / np.maximum(2 * self.areas, 1e-300)[:, None]
        self._vertex, self._edge = self._pseudonormals(corners)

    def _pseudonormals(self, corners):
        """Return the angle-weighted normals of vertices (v, 3), and of each face's edges."""
        at_vertex = np.zeros_like(self.vertices)
        for k in range(3):
            a, b = (corners[:, (k + i) % 3] - corners[:, k] for i in (1, 2))
            lengths = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
            cosine = np.einsum("ij,ij->i", a, b) / np.maximum(lengths, 1e-300)
            angle = np.arccos(np.clip(cosine, -1, 1))
            np.add.at(at_vertex, self.faces[:, k], angle[:, None] * self.normals)
        ends = np.sort(self.faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
        _, which = np.unique(ends, axis=0, return_inverse=True)
        at_edge = np.zeros((which.max() + 1, 3))
        np.add.at(at_edge, which.ravel(), np.repeat(self.normals, 3, axis=0))
        return at_vertex, at_edge[which.ravel()].reshape(-1, 3, 3)

    def points(self, count):
        """Return points (count, 3) of the surface."""
        rng = np.random.default_rng(0)
        picked = rng.choice(len(self.areas), count, p=self.areas / self.areas.sum())
        share = rng.dirichlet(np.ones(3), count)
        return np.einsum("ij,ijk->ik", share, self.vertices[self.faces[picked]])

    def distance(self, points):
        """Return signed distances (n,) and outward directions (n, 3)."""
        points = np.asfortranarray(points)
        squared, face, foot = self._tree.squared_distance(self.vertices, self.faces, points)
        a, b, c = (self.vertices[self.faces[face, k]] for k in range(3))
        weight = np.stack(
            [
                np.einsum("ij,ij->i", np.cross(y - foot, z - foot), self.normals[face])
                for y, z in ((b, c), (c, a), (a, b))
            ],
            axis=1,
        )
        weight /= np.maximum(2 * self.areas[face], 1e-300)[:, None]
        zero = weight < 1e-9
        normal = self.normals[face].copy()
        on_edge = zero.sum(axis=1) == 1
        opposite = (np.argmax(zero, axis=1) + 1) % 3  # of corner k the edge from k + 1 to k + 2
        normal[on_edge] = self._edge[face[on_edge], opposite[on_edge]]
        at_corner = zero.sum(axis=1) >= 2
        normal[at_corner] = self._vertex[
            self.faces[face[at_corner], np.argmax(weight[at_corner], axis=1)]
        ]
        off = points - foot
        sign = np.where(np.einsum("ij,ij->i", off, normal) < 0, -1.0, 1.0)
        length = np.sqrt(squared)
        away = np.where((length > 1e-9)[:, None], sign[:, None] * off, normal)
        return sign * length, away / np.maximum(np.linalg.norm(away, axis=1), 1e-300)[:, None]


def nearest(normals, offsets, goals):
    """Return the points (n, 3) nearest to goals in front of planes (n, k, 3); NaN: none."""
    best, least = np.full_like(goals, np.nan), np.full(len(goals), np.inf)
    count = normals.shape[1]
    for which in (c for size in (0, 1, 2, 3) for c in combinations(range(count), size)):
        some = normals[:, which]
        gram = some @ some.transpose(0, 2, 1)
        flat = np.abs(np.linalg.det(gram)) < 1e-9
        gram[flat] = np.eye(len(which))
        lacks = offsets[:, which] - np.einsum("nki,ni->nk", some, goals)
        push = np.linalg.solve(gram, lacks[..., None])[..., 0]
        to = goals + np.einsum("nk,nki->ni", push, some)
        front = (np.einsum("nki,ni->nk", normals, to) >= offsets - 1e-12).all(axis=1)
        far = np.linalg.norm(to - goals, axis=1)
        good = front & ~flat & (push >= 0).all(axis=1) & (far < least)
        best[good], least[good] = to[good], far[good]
    return best


def out(distance, goals, radii):
    """Return places (n, 3) near goals that all walls leave free, and whether they do (n,).

    In its corners the distance of an approximate field grows by less than the way, by as little as
    a tenth, so that the surface lies farther off than the distance says: the last two looks tell.
    """
    to, planes, slope, before = goals.copy(), [], np.ones(len(goals)), None
    for _ in range(5):
        away, normal = distance(to)
        if (away >= radii - 1e-9).all():
            break
        if before:
            way = np.einsum("ij,ij->i", to - before[0], before[2])
            alike = (np.einsum("ij,ij->i", normal, before[2]) > 0.9) & (way > 1e-12)
            slope[alike] = np.clip((away - before[1])[alike] / way[alike], 0.05, 1)
        before = to, away, normal
        foot = np.einsum("ij,ij->i", normal, to) - (away - radii) / slope
        planes.append((normal, np.where(away < radii, foot, -np.inf)))
        normals = np.stack([n for n, _ in planes], axis=1)
        offsets = np.stack([o for _, o in planes], axis=1)
        offsets[~np.isfinite(offsets)] = -1e9
        found = nearest(normals, offsets, goals)
        to = np.where(np.isfinite(found), found, to + np.maximum(radii - away, 0)[:, None] * normal)
    return to, distance(to)[0] >= radii - 1e-7


def walk(distance, places, goals, radii, step, rounds=600):
    """Walk towards goals in small steps, outside of a surface thickened by radii.

    Parameters
    ----------
    distance : callable
        Gives the distances (n,) and outward directions (n, 3) of points (n, 3).
    places, goals : ndarray, shape (n, 3)
    radii : ndarray, shape (n,)
    step : float
        The longest step; the first is a twentieth of it, and one that leads no nearer is halved.
    rounds : int

    Returns
    -------
    ends : ndarray, shape (n, 3)
    gains : ndarray, shape (n,)
        How much nearer the way leads for its length, of the first step or of the first two and a
        half, whichever is less: the sine of the angle between the pull and what the surface can
        hold without friction. (The first may lead into a groove, the others around an edge.)
    """
    at, goals = np.array(places, float), np.asarray(goals, float)
    steps = np.full(len(at), 0.05 * step)
    begun = np.linalg.norm(goals - at, axis=1)
    gains, gone, first = np.zeros(len(at)), np.zeros(len(at)), np.full(len(at), np.nan)
    for _ in range(rounds):
        busy = np.flatnonzero(steps > 1e-3 * step)
        if not len(busy):
            break
        here, goal, radius = at[busy], goals[busy], radii[busy]
        off = goal - here
        left = np.linalg.norm(off, axis=1)
        to = here + off * (np.minimum(steps[busy], left) / np.maximum(left, 1e-300))[:, None]
        to, free = out(distance, to, radius)
        nearer = left - np.linalg.norm(goal - to, axis=1)
        way = np.linalg.norm(to - here, axis=1)
        good = free & (nearer > 1e-4 * steps[busy]) & (way < 3 * steps[busy])
        at[busy[good]] = to[good]
        new = good & np.isnan(first[busy])
        first[busy[new]] = nearer[new] / way[new]
        early = good & (gone[busy] < 2.5 * step)
        gone[busy[early]] += way[early]
        gains[busy[early]] = (begun[busy[early]] - (left - nearer)[early]) / gone[busy[early]]
        steps[busy[~good]] /= 2
        steps[busy[good]] = np.minimum(1.5 * steps[busy[good]], step)
    return at, np.fmin(gains, first)
