"""The worst query of a mesh; write docs/figures/worst.csv.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/worst.py

Five bodies of revolution, in whose middle, on whose axis or along whose ring many faces are about
equally near, and three scans, as `exact` and as `compact-16`. Of each: the slowest query (the
best of three tries at each point, in C) at the middle, along the axis, around the ring and at 2,000
places of the box, and the median of the latter; queries that are cut, of the contact set and of
200,000 points of the box; and by how much a distance is too large where it is cut.
"""

import itertools
import sys

import numpy as np
from common import SCANS, load, write

from pandis.base.frame import UNIT
from pandis.base.physical import Scale
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.measure import draw_contacts
from pandis.pipeline.kinds.compact.file import file_parts
from pandis.pipeline.kinds.compact.packing import build_compact
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.kinds.native import native_bytes
from pandis.runtime.field import NativeField
from pandis.runtime.field.files import pack

COLUMNS = (
    *("mesh", "field", "faces", "slowest_us", "box_us"),
    *("cut_contact", "contact", "cut_box", "box", "off_contact", "off_box"),
)
TRIES, CONTACTS, BOX = 3, 50_000, 200_000


def turned(profile, count):
    """Return the surface that a profile (radius, height) makes around z, in so many sectors."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    vertices, rows = [], []
    for radius, height in profile:
        ring = 1 if radius == 0 else count
        start = sum(map(len, vertices))
        at = [radius * np.cos(angle), radius * np.sin(angle), np.full(count, height)]
        vertices.append(np.stack(at, axis=1)[:ring])
        rows.append(start + np.arange(count) % ring)
    faces = []
    for low, high in itertools.pairwise(rows):
        low_next, high_next = np.roll(low, -1), np.roll(high, -1)
        faces += [np.stack([low, low_next, high_next], 1), np.stack([low, high_next, high], 1)]
    faces = np.concatenate(faces)
    a, b, c = faces.T
    return np.concatenate(vertices), faces[(a != b) & (b != c) & (c != a)].astype(np.int32)


def bodies():
    """Yield the name, vertices and faces of each mesh, unit frame."""
    turn = np.linspace(-np.pi / 2, np.pi / 2, 206)
    round_side = [(0.9 * np.cos(at), 0.9 * np.sin(at)) for at in turn[1:-1]]
    ball = [(0.0, -0.9), *round_side, (0.0, 0.9)]
    yield "ball", *turned(ball, 800)
    straight = [(0.3, height) for height in np.linspace(-0.9, 0.9, 204)]
    yield "cylinder", *turned([(0.0, -0.9), *straight, (0.0, 0.9)], 800)
    yield "bicone", *turned([(0.0, -0.9), (0.9, 0.0), (0.0, 0.9)], 8000)
    yield "cone", *turned([(0.0, -0.9), (0.5, -0.9), (0.0, 0.9)], 8000)
    around = np.linspace(0, 2 * np.pi, 204)
    ring = [(0.6 + 0.3 * np.cos(at), 0.3 * np.sin(at)) for at in around[:-1]]
    yield "torus", *turned([*ring, ring[0]], 800)
    for name, source in SCANS.items():
        yield name, *load(source)


def joined(vertices, faces):
    """Return a mesh whose vertices at equal places are one."""
    _, first, index = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    return vertices[first], index.ravel()[faces].astype(np.int32)


def hard_points(rng):
    """Return points at the middle, along the axis, on the ring, and anywhere in the box."""
    height = np.linspace(-0.95, 0.95, 400)
    axis = np.stack([0 * height, 0 * height, height], axis=1)
    axis[1::2] += rng.normal(0, 1e-4, (200, 3))
    angle = np.linspace(0, 2 * np.pi, 100)
    ring = 0.6 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    middle = np.concatenate([np.zeros((1, 3)), rng.normal(0, 1e-3, (200, 3))])
    return np.concatenate([middle, axis, ring]), rng.uniform(-1, 1, (2000, 3))


def contact_points(body, rng):
    """Return the points of a contact set, shallow and deep."""
    contacts = draw_contacts(body, Scale(0.1, 400.0), CONTACTS, rng=rng)
    return np.concatenate([part.points for part in contacts.sets.values()])


def cut_of(field, body, points):
    """Return how many queries are cut, and by how much the distance is too large there."""
    found, clear = field.query(points), field.clear(points)
    cut = clear < np.abs(found.distance)
    if not cut.any():
        return 0, 0.0
    exact, _ = body.distance.distance_and_normal(points[cut], check=False)
    return int(cut.sum()), float((np.abs(found.distance[cut]) - np.abs(exact)).max())


def main():
    """Measure all bodies."""
    rows = []
    for mesh, vertices, faces in bodies():
        rng = np.random.default_rng(0)
        body = Body(*joined(vertices, faces), UNIT)
        hard, box = hard_points(rng)
        contacts, many = contact_points(body, rng), rng.uniform(-1, 1, (BOX, 3))
        packed = file_parts(*build_compact(body, 16, 0, log=lambda text: None))
        fields = {
            "exact": native_bytes(ExactField("exact", body), {}),
            "compact-16": pack(UNIT, packed, {}, version=3),
        }
        for name, data in fields.items():
            field, row = NativeField(data), {"mesh": mesh, "field": name, "faces": len(faces)}
            times = [
                field.time(points, TRIES * len(points)).reshape(TRIES, -1).min(axis=0) * 1e6
                for points in (hard, box)
            ]
            row["slowest_us"] = float(max(taken.max() for taken in times))
            row["box_us"] = float(np.median(times[1]))
            for where, points in (("contact", contacts), ("box", many)):
                row[f"cut_{where}"], row[f"off_{where}"] = cut_of(field, body, points)
                row[where] = len(points)
            rows.append(row)
            print(row, file=sys.stderr, flush=True)
    write("worst", COLUMNS, rows)


if __name__ == "__main__":
    main()
