"""What every counter shares: the answer, the refusal, numbers, and the sum of placed parts."""

import re
from itertools import pairwise
from typing import NamedTuple

import numpy as np

#: A decimal number as C's strtod reads it in the C locale, without its words and hexadecimals.
NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
INTEGER = re.compile(r"[+-]?[0-9]{1,18}")
#: A file may place a part again and again in parts of parts: more than this is an attack.
MOST_TRIANGLES = 50_000_000


class Refused(ValueError):
    """A file that its format's standard does not allow, with the reason."""


class Counted(NamedTuple):
    """What a file holds.

    Attributes
    ----------
    triangles : int
    low, high : ndarray, shape (3,)
        Bounds of the vertices that faces use, in world coordinates and the file's unit.
    volume : float
        Signed, summed over all triangles from the origin (a surface that is not closed has one
        too, which moves with it).
    instances : int
        Parts as placed: 1 but for scenes.
    unit : str or None
        The unit, where the format names it.
    """

    triangles: int
    low: np.ndarray
    high: np.ndarray
    volume: float
    instances: int
    unit: str | None = None


def number(token, where):
    """Return a decimal number, or refuse the token."""
    if not NUMBER.fullmatch(token):
        raise Refused(f"{where}: {token!r} is no number")
    value = float(token)
    if not np.isfinite(value):
        raise Refused(f"{where}: {token!r} is beyond what a float holds")
    return value


def integer(token, where):
    """Return an integer, or refuse the token."""
    if not INTEGER.fullmatch(token):
        raise Refused(f"{where}: {token!r} is no integer")
    return int(token)


def text(data):
    """Return bytes as text of one character a byte, and refuse what is no text."""
    if b"\0" in data:
        raise Refused("this is no text: it holds zero bytes")
    return data.decode("latin-1")


def words(line):
    """Split at spaces and tabs, up to a comment: ``1.#QNAN`` holds none."""
    found = line.split()
    for place, word in enumerate(found):
        if word.startswith("#"):
            return found[:place]
    return found


def fan(corners):
    """Return a polygon's triangles, from its first corner: none of fewer than three."""
    return [(corners[0], b, c) for b, c in pairwise(corners[1:])]


class Tally:
    """The sum of parts that are placed one after the other."""

    def __init__(self):
        self.triangles, self.volume, self.instances = 0, 0.0, 0
        self.low, self.high = np.full(3, np.inf), np.full(3, -np.inf)

    def add(self, points, faces):
        """Add a part of points (n, 3) and triangles (m, 3), whose indices are in range."""
        faces = np.asarray(faces, np.int64).reshape(-1, 3)
        if len(faces) == 0:
            return
        self.triangles += len(faces)
        if self.triangles > MOST_TRIANGLES:
            raise Refused(f"more than {MOST_TRIANGLES} triangles")
        corners = np.asarray(points, float).reshape(-1, 3)[faces]
        if not np.isfinite(corners).all():
            raise Refused("a coordinate is not finite")
        a, b, c = corners.transpose(1, 0, 2)
        self.volume += float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)
        self.low = np.minimum(self.low, corners.min(axis=(0, 1)))
        self.high = np.maximum(self.high, corners.max(axis=(0, 1)))
        self.instances += 1

    def counted(self, unit=None):
        """Return the sum; a file without a triangle is refused."""
        if not self.triangles:
            raise Refused("no triangles")
        return Counted(self.triangles, self.low, self.high, self.volume, self.instances, unit)
