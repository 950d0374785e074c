"""Whether a proxy comes out of corners of 3 to 8 walls, judged by a projection onto their planes.

Usage: .venv/bin/python tests/benchmarks/leaving.py [CORNERS [SEED]]

Each corner is a cone of 3 to 8 planes cut out of a block of 100 mm, turned anyhow. A probe without
friction is pressed into it, led away, and left where it is for half a second. Between the planes
the place nearest to a probe is unique: it is found by trying all sets of planes that may hold it.
Printed are, by the number of walls, the presses that end more than 0.05 mm from there, and by how
much they are off at most.
"""

import sys
from itertools import combinations, pairwise

import numpy as np
import trimesh
from common import ROOT

sys.path.insert(0, str(ROOT / "tests"))

from igl.copyleft.cgal import mesh_boolean
from scipy.spatial import ConvexHull

from pandis.export.native import export_native
from pandis.fields.exact import ExactField
from pandis.geometry.body import Body
from pandis.native.contact import NativeContact
from pandis.native.runtime import NativeField
from pandis.native.scene import Placed
from shapes import opened

#: A cone's angles to its axis, the widest gap between two of its edges, the edges' length (mm).
TILTS, GAP, LENGTH = (0.35, 1.2), 2.6, 120.0
#: Radii of the probe, way of a tick, how near the end has to be (mm); presses for each radius.
RADII, PACE, NEAR, PRESSES = (0.0, 0.5), 0.2, 0.05, 10
#: Ticks in the corner, and at the end.
PRESSED, WAIT = 50, 500


def nearest(normals, radius, point):
    """Return the place (3,) nearest to a point, at least a radius in front of all planes."""
    best, least = point, 0.0 if (normals @ point >= radius - 1e-12).all() else np.inf
    for which in (c for k in (1, 2, 3) for c in combinations(range(len(normals)), k)):
        some = normals[list(which)]
        gram = some @ some.T
        if least == 0 or abs(np.linalg.det(gram)) < 1e-12:
            continue
        push = np.linalg.solve(gram, radius - some @ point)
        place = point + some.T @ push
        apart = np.linalg.norm(place - point)
        if (push >= -1e-9).all() and (normals @ place >= radius - 1e-9).all() and apart < least:
            best, least = place, apart
    return best


def corner(walls, rng):
    """Return the inward normals (n, 3) of a cone, and the block without it; None: not convex."""
    around = np.sort(rng.uniform(0, 2 * np.pi, walls))
    if np.diff(around, append=around[0] + 2 * np.pi).max() > GAP:
        return None
    tilt = rng.uniform(*TILTS)
    edges = np.column_stack([np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around),
                             np.full(walls, np.cos(tilt))])  # fmt: skip
    points = np.concatenate([np.zeros((1, 3)), LENGTH * edges])
    cone = trimesh.Trimesh(points, ConvexHull(points).simplices, process=False)
    cone.fix_normals()
    block = trimesh.creation.box((100, 100, 100)).apply_translation((0, 0, 10))
    arrays = [(np.asarray(m.vertices, float), np.asarray(m.faces, np.int64)) for m in (block, cone)]
    vertices, faces, _ = mesh_boolean(*arrays[0], *arrays[1], "minus")
    normals = np.cross(edges, np.roll(edges, -1, axis=0))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return normals, trimesh.Trimesh(vertices, faces, process=False)


def way(*places):
    """Return paths (n, 3), each from one place to the next."""
    return [np.linspace(a, b, max(2, int(np.linalg.norm(b - a) / PACE) + 1))
            for a, b in pairwise(places)]  # fmt: skip


def misses(normals, mesh, rng):
    """Yield how far (mm) each press ends from where it belongs."""
    turn = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
    mesh.vertices = mesh.vertices @ turn.T
    body = Body.open(opened(mesh).mesh)
    data = export_native(ExactField("exact", body), "exact", {}, 32, body, lambda text: None)
    placed = Placed(NativeField(data), np.eye(3), np.zeros(3), 1e-3, 400.0)
    for radius in RADII:
        for _ in range(PRESSES):
            begin = np.array([0, 0, 25.0]) + rng.normal(0, 2, 3)
            pressed = nearest(normals, radius, rng.normal(0, 1, 3)) - [0, 0, rng.uniform(0.3, 3)]
            end = pressed + rng.normal(0, rng.choice([1, 4]), 3)
            if (normals @ begin < radius + 1).any():
                continue
            into, out = way(begin, pressed, end)
            path = [into, np.repeat(pressed[None], PRESSED, 0), out, np.repeat(end[None], WAIT, 0)]
            contact = NativeContact(placed, 1e-3 * radius)
            steps = contact.follow(1e-3 * np.concatenate(path) @ turn.T, 1e-3)
            place = 1e3 * steps.proxy[-1] @ turn
            yield float(np.linalg.norm(place - nearest(normals, radius, end)))


def main(corners=10, seed=0):
    """Press into so many corners of each number of walls; print what became of it."""
    rng = np.random.default_rng(seed)
    for walls in range(3, 9):
        off, done = [], 0
        while done < corners:
            made = corner(walls, rng)
            if made is not None and made[1].is_watertight:
                off.extend(misses(*made, rng))
                done += 1
        bad = sum(one > NEAR for one in off)
        print(
            f"{walls} walls: {bad} of {len(off)} not where they belong, {max(off):.2g} mm at most",
            flush=True,
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
