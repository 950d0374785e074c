"""Definitions shared by the readers of all formats: results, errors, numbers, polygons."""

import re
from itertools import chain
from typing import NamedTuple

import numpy as np

#: Material name of faces without a material.
UNNAMED = "none"
#: NUMBER: a decimal number in the C locale (no nan, inf or hexadecimal). INTEGER: a whole number.
NUMBER = re.compile(r"[+-]?(?:[0-9]++\.?[0-9]*+|\.[0-9]++)(?:[eE][+-]?[0-9]++)?")
INTEGER = re.compile(r"[+-]?[0-9]{1,18}")
#: Maximum number of triangles once all parts are placed. Nesting multiplies parts, so a short file
#: could fill a disk.
MOST = 50_000_000
#: Advice at the end of messages about damaged files.
AGAIN = "export it again"


class FormatError(ValueError):
    """A file violates its format or has unsupported contents; the message describes the fault."""


class Reading(NamedTuple):
    """The contents of a mesh file.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3), float64
    faces : ndarray, shape (F, 3), int64
    materials : ndarray, shape (F,), of text, or None
        Material names; `UNNAMED` for faces without a material. None if the format has none.
    notes : list of str
        Messages about omitted contents and about the interpretation of ambiguous contents.
    unit : str
        The unit of length that the format or the file declares, else ``unknown``.
    """

    vertices: np.ndarray
    faces: np.ndarray
    materials: np.ndarray | None = None
    notes: tuple = ()
    unit: str = "unknown"


def number(token, where):
    """Parse a number, or raise a `FormatError` whose message begins with ``where``."""
    if not NUMBER.fullmatch(token):
        raise FormatError(
            f"{where}: '{token[:40]}' is not a number (numbers are written like -1.25 or 3e-4)"
        )
    value = float(token)
    if not np.isfinite(value):
        raise FormatError(f"{where}: '{token[:40]}' is too large to be stored")
    return value


def whole(token, where):
    """Parse a whole number, or raise `FormatError`."""
    if not INTEGER.fullmatch(token):
        raise FormatError(f"{where}: '{token[:40]}' is not a whole number")
    return int(token)


def numbers(rows, where):
    """Parse rows of tokens into an array of numbers.

    Parameters
    ----------
    rows : list of list of str
        Rows of equal length.
    where : callable
        Takes a row's index; returns the row's place in the file, for messages.
    """
    try:
        # float() also accepts tokens like nan, inf and 1_0, which contain other characters
        if not re.search(r"[^0-9eE.+\- ]", " ".join([" ".join(row) for row in rows])):
            values = np.array([[float(token) for token in row] for row in rows])
            if np.isfinite(values).all():
                return values
    except ValueError:
        pass
    return np.array([[number(t, where(i)) for t in row] for i, row in enumerate(rows)])


def text_of(data, form):
    """Decode bytes as text; reject binary data."""
    if b"\0" in data:
        raise FormatError(f"it is not text, as {form} must be: it contains NUL bytes; {AGAIN}")
    return data.decode("utf-8", "replace").removeprefix("﻿")


def lines_of(text):
    """Split a text into lines at CR LF, CR and LF only."""
    return re.split(r"\r\n|\r|\n", text)


def words(line):
    """Return the words of a line up to its comment, which begins at a word that starts with ``#``.

    Words are separated by ASCII white space only.
    """
    parts = line.split() if line.isascii() else re.findall(r"[^ \t\v\f]+", line)
    if "#" in line:
        for place, word in enumerate(parts):
            if word.startswith("#"):
                return parts[:place]
    return parts


def triangles(vertices, polygons, where, *, first=0):
    """Check the indices of polygons and cut the polygons into triangles.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
    polygons : list of list of int, or ndarray, shape (F, 3)
    where : callable
        Takes a polygon's index; returns the polygon's place in the file, for messages.
    first : int
        Index of the first vertex in the format (0 or 1), for messages.

    Returns
    -------
    faces : ndarray, shape (F, 3), int64
    counts : ndarray, shape (len(polygons),)
        Number of triangles of each polygon.
    """
    count = len(vertices)
    if isinstance(polygons, np.ndarray):
        sizes, flat = np.full(len(polygons), 3), polygons.reshape(-1)
    else:
        sizes = np.fromiter(map(len, polygons), np.int64, len(polygons))
        flat = np.fromiter(chain.from_iterable(polygons), np.int64, int(sizes.sum()))
    bad = np.flatnonzero((flat < 0) | (flat >= count))
    if len(bad):
        polygon = int(np.searchsorted(np.cumsum(sizes), bad[0], side="right"))
        raise FormatError(
            f"{where(polygon)}: a face uses vertex {flat[bad[0]] + first}, but there are only "
            f"{count:,}, counted from {first}; the file is truncated or damaged: {AGAIN}"
        )
    if len(sizes) and (sizes == 3).all():
        return flat.reshape(-1, 3), np.ones(len(sizes), np.int64)
    from pandis.pipeline.mesh.polygons import triangulate_polygons  # imports libigl

    return triangulate_polygons(vertices, polygons), np.maximum(sizes - 2, 0)


def joined(parts, notes=(), unit="unknown"):
    """Join parts (vertices, faces, material) into one `Reading`."""
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
    """Return one material name, or one per face, as an array; missing names become `UNNAMED`."""
    if material is None or isinstance(material, str):
        return np.array(material or UNNAMED)
    return np.array([name or UNNAMED for name in material])


def placed(vertices, faces, matrix):
    """Transform a part by a matrix (4, 4); reverse the faces if the matrix mirrors."""
    moved = vertices @ matrix[:3, :3].T + matrix[:3, 3]
    return moved, faces[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else faces
