"""What the readers of all formats share: what they return, how they refuse, numbers, polygons."""

import re
from typing import NamedTuple

import numpy as np

#: What faces without a material are made of.
UNNAMED = "none"
#: A decimal number, in the C locale, without words and hexadecimals; and a whole one.
NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
INTEGER = re.compile(r"[+-]?[0-9]{1,18}")
#: Triangles that a file may place in all: parts of parts multiply, and a short file fills a disk.
MOST = 50_000_000
#: What is left to say where a file is damaged.
AGAIN = "export it again"


class FormatError(ValueError):
    """A file is not what its format allows, or holds what cannot be read; the message says what."""


class Reading(NamedTuple):
    """What a file holds.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3), float64
    faces : ndarray, shape (F, 3), int64
    materials : ndarray, shape (F,), of text, or None
        Names; `UNNAMED` where there is none. None where the format names none.
    notes : list of str
        What was left out, or taken in a way that somebody may want to know of.
    unit : str
        As the format declares it, else ``unknown``.
    """

    vertices: np.ndarray
    faces: np.ndarray
    materials: np.ndarray | None = None
    notes: tuple = ()
    unit: str = "unknown"


def number(token, where):
    """Return a token as a number, or refuse it; ``where`` begins the sentence."""
    if not NUMBER.fullmatch(token):
        raise FormatError(
            f"{where}: '{token[:40]}' is no number (numbers are written like -1.25 or 3e-4)"
        )
    value = float(token)
    if not np.isfinite(value):
        raise FormatError(f"{where}: '{token[:40]}' is larger than any number can be stored")
    return value


def whole(token, where):
    """Return a token as a whole number, or refuse it."""
    if not INTEGER.fullmatch(token):
        raise FormatError(f"{where}: '{token[:40]}' is no whole number")
    return int(token)


def numbers(rows, where):
    """Return rows of tokens as an array of numbers.

    Parameters
    ----------
    rows : list of list of str
        Rows of equal length.
    where : callable
        Says where a row stands, by its index.
    """
    try:
        # whatever else float() takes (nan, 1_0, 0x1) has other characters
        if not re.search(r"[^0-9eE.+\- ]", " ".join([" ".join(row) for row in rows])):
            values = np.array([[float(token) for token in row] for row in rows])
            if np.isfinite(values).all():
                return values
    except ValueError:
        pass
    return np.array([[number(t, where(i)) for t in row] for i, row in enumerate(rows)])


def text_of(data, form):
    """Return bytes as text; refuse what is none."""
    if b"\0" in data:
        raise FormatError(f"it is no text, as {form} is: it holds zero bytes; {AGAIN}")
    return data.decode("utf-8", "replace").removeprefix("﻿")


def lines_of(text):
    """Return the lines of a text: of no other sign than the three that end one."""
    return re.split(r"\r\n|\r|\n", text)


def words(line):
    """Return the words of a line up to a comment: a ``#`` that begins a word.

    Other spaces than those of ASCII part nothing.
    """
    parts = line.split() if line.isascii() else re.findall(r"[^ \t\v\f]+", line)
    if "#" in line:
        for place, word in enumerate(parts):
            if word.startswith("#"):
                return parts[:place]
    return parts


def triangles(vertices, polygons, where, first=0):
    """Cut polygons, whose indices are checked, into triangles.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
    polygons : list of list of int
    where : callable
        Says where a polygon stands, by its index.
    first : int
        What the format calls the first vertex.

    Returns
    -------
    faces : ndarray, shape (F, 3), int64
    counts : ndarray, shape (len(polygons),)
        Triangles of each polygon.
    """
    count = len(vertices)
    sizes = np.fromiter(map(len, polygons), np.int64, len(polygons))
    flat = np.fromiter((c for polygon in polygons for c in polygon), np.int64, int(sizes.sum()))
    bad = np.flatnonzero((flat < 0) | (flat >= count))
    if len(bad):
        polygon = int(np.searchsorted(np.cumsum(sizes), bad[0], side="right"))
        raise FormatError(
            f"{where(polygon)}: a face names vertex {flat[bad[0]] + first}, and there are "
            f"{count:,}, counted from {first}; the file is cut or damaged: {AGAIN}"
        )
    if len(sizes) and (sizes == 3).all():
        return flat.reshape(-1, 3), np.ones(len(sizes), np.int64)
    from pandis.pipeline.mesh.polygons import triangulate_polygons  # imports libigl

    return triangulate_polygons(vertices, polygons), np.maximum(sizes - 2, 0)


def joined(parts, notes=(), unit="unknown"):
    """Return parts (vertices, faces, material) as one `Reading`."""
    total = sum(len(faces) for _, faces, _ in parts)
    if total > MOST:
        raise FormatError(f"it places {total:,} triangles, more than {MOST:,}: leave parts out")
    if not parts:
        return Reading(np.empty((0, 3)), np.empty((0, 3), np.int64), None, notes, unit)
    starts = np.cumsum([0, *(len(vertices) for vertices, _, _ in parts)])
    vertices = np.concatenate([vertices for vertices, _, _ in parts])
    faces = np.concatenate([faces + s for (_, faces, _), s in zip(parts, starts, strict=False)])
    named = [np.broadcast_to(_names(m), len(faces)) for _, faces, m in parts]
    return Reading(vertices, faces, np.concatenate(named), notes, unit)


def _names(material):
    """Return a name, or one for each face, with `UNNAMED` where there is none."""
    if material is None or isinstance(material, str):
        return np.array(material or UNNAMED)
    return np.array([name or UNNAMED for name in material])


def placed(vertices, faces, matrix):
    """Return a part moved by a matrix (4, 4); what is mirrored keeps its outside."""
    moved = vertices @ matrix[:3, :3].T + matrix[:3, 3]
    return moved, faces[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else faces
