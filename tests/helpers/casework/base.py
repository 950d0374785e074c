"""Shapes with known volumes, what is right for a file, and writers of text and STL."""

import gzip
import re
from typing import NamedTuple

import numpy as np

#: Corners of a unit box in binary order, and its triangles, which look outwards.
_CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
BOX_FACES = np.array([
    (0, 2, 1), (1, 2, 3), (4, 5, 6), (5, 7, 6), (0, 1, 4), (1, 5, 4),
    (2, 6, 3), (3, 6, 7), (0, 4, 2), (2, 4, 6), (1, 3, 5), (3, 7, 5),
])  # fmt: skip
TETRA = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], float)
TETRA_FACES = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
#: The box that most cases hold: no two of its sides and none of its places alike.
LOW, HIGH = (1.0, 2.0, 3.0), (2.0, 4.0, 6.0)


class Reads(NamedTuple):
    """A file is read: its triangles, signed volume, and bounds of the vertices that are used."""

    triangles: int
    volume: float
    low: tuple
    high: tuple

    def differs(self, triangles, volume, low, high, tolerance=1e-5):
        """Return what of a reading is wrong, as names; lengths to a share of the diagonal."""
        diagonal = float(np.linalg.norm(np.subtract(self.high, self.low)))
        wrong = {
            "triangles": triangles != self.triangles,
            "volume": not abs(volume - self.volume) <= tolerance * diagonal**3,
            "low": not np.abs(np.subtract(low, self.low)).max() <= tolerance * diagonal,
            "high": not np.abs(np.subtract(high, self.high)).max() <= tolerance * diagonal,
        }
        return [name for name, bad in wrong.items() if bad]


class Refuses(NamedTuple):
    """A file is refused, with a message that holds some words."""

    words: tuple = ()

    def lacks(self, message):
        """Return the words that a message lacks: in any case, numbers as a whole."""
        return [
            word
            for word in self.words
            if not re.search(
                r"(?<![\w.])" * word[0].isdigit()
                + re.escape(word)
                + r"(?![0-9])" * word[-1].isdigit(),
                message,
                re.IGNORECASE,
            )
        ]


def box(low=LOW, high=HIGH):
    """Return points (8, 3) and triangles (12, 3) of a box."""
    return np.asarray(low) + _CORNERS * np.subtract(high, low), BOX_FACES


def reads_box(low=LOW, high=HIGH, triangles=12):
    """Return what is right for a box."""
    sides = np.subtract(high, low)
    return Reads(triangles, float(np.prod(sides)), tuple(low), tuple(high))


def sphere(radius=1.0, centre=(0.0, 0.0, 0.0), rounds=2):
    """Return points and triangles of an octahedron, refined on the sphere."""
    points = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    points = [np.array(point, float) for point in points]
    faces = [(a, b, 4) for a, b in ((0, 2), (2, 1), (1, 3), (3, 0))]
    faces += [(b, a, 5) for a, b, _ in faces]
    for _ in range(rounds):
        middles, finer = {}, []

        def middle(a, b, middles=middles):
            key = min(a, b), max(a, b)
            if key not in middles:
                points.append((points[a] + points[b]) / np.linalg.norm(points[a] + points[b]))
                middles[key] = len(points) - 1
            return middles[key]

        for a, b, c in faces:
            d, e, f = middle(a, b), middle(b, c), middle(c, a)
            finer += [(a, d, f), (d, b, e), (f, e, c), (d, e, f)]
        faces = finer
    return np.array(points) * radius + centre, np.array(faces)


def reads(points, faces):
    """Return what is right for a mesh, from its arrays."""
    corners = np.asarray(points, float)[faces]
    volume = float(np.linalg.det(corners).sum() / 6)
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    return Reads(len(faces), volume, tuple(low.tolist()), tuple(high.tolist()))


def both(*answers):
    """Return what is right for several meshes in one file."""
    low = np.min([each.low for each in answers], axis=0)
    high = np.max([each.high for each in answers], axis=0)
    triangles, volume = (sum(each[k] for each in answers) for k in (0, 1))
    return Reads(triangles, volume, tuple(low.tolist()), tuple(high.tolist()))


def packed(data):
    """Return data in gzip, the same on every run."""
    return gzip.compress(data, mtime=0)


def _row(values):
    return " ".join(f"{value:.9g}" for value in values)


def obj(points, faces):
    """Return an OBJ."""
    rows = [f"v {_row(point)}" for point in points]
    rows += ["f " + " ".join(str(index + 1) for index in face) for face in faces]
    return ("\n".join(rows) + "\n").encode()


def off(points, faces):
    """Return an OFF."""
    rows = ["OFF", f"{len(points)} {len(faces)} 0", *map(_row, points)]
    rows += [f"{len(face)} " + " ".join(map(str, face)) for face in faces]
    return ("\n".join(rows) + "\n").encode()


def stl(points, faces, name="part"):
    """Return an STL as text."""
    rows = [f"solid {name}"]
    for face in faces:
        rows += ["facet normal 0 0 0", "outer loop"]
        rows += [f"vertex {_row(points[index])}" for index in face]
        rows += ["endloop", "endfacet"]
    return ("\n".join([*rows, f"endsolid {name}"]) + "\n").encode()


def binary_stl(points, faces, head=b"made for a test", declared=None):
    """Return a binary STL, which may declare another count than is there."""
    record = np.zeros(len(faces), np.dtype([("n", "<f4", 3), ("c", "<f4", (3, 3)), ("r", "<u2")]))
    record["c"] = np.asarray(points)[faces]
    count = len(faces) if declared is None else declared
    return head.ljust(80, b"\0") + count.to_bytes(4, "little") + record.tobytes()


def ply(points, faces, form="ascii", vertices=None, polygons=None):
    """Return a PLY, which may declare other counts than are there."""
    head = f"""ply
format {form} 1.0
element vertex {len(points) if vertices is None else vertices}
property float x
property float y
property float z
element face {len(faces) if polygons is None else polygons}
property list uchar int vertex_indices
end_header
"""
    if form == "ascii":
        rows = [*map(_row, points), *(f"{len(face)} " + " ".join(map(str, face)) for face in faces)]
        return (head + "\n".join(rows) + "\n").encode()
    order = "<" if "little" in form else ">"
    body = np.asarray(points, order + "f4").tobytes()
    for face in faces:
        body += bytes([len(face)]) + np.asarray(face, order + "i4").tobytes()
    return head.encode() + body
