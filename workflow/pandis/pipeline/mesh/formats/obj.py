"""Wavefront OBJ."""

import re
from itertools import chain

import numpy as np

from pandis.pipeline.mesh.formats.base import (
    AGAIN,
    NUMBER,
    UNNAMED,
    FormatError,
    Reading,
    lines_of,
    numbers,
    text_of,
)
from pandis.pipeline.mesh.formats.base import triangles as cut
from pandis.pipeline.mesh.formats.base import words as words_of

#: Statements of free-form geometry, which is not supported.
_FREE_FORM = {"surf", "curv", "curv2", "cstype"}
#: Name of a statement. A line that begins with anything else is damaged.
_STATEMENT = re.compile(r"[A-Za-z_][A-Za-z0-9_.]*")
#: Nearly all lines of a file: vertices with three coordinates, and triangles whose indices are
#: positive. Runs of them are read at once. No run begins below a line that ends with a backslash.
_RUN = re.compile(
    rf"(?m)(?<!\\\n)(?<!\\\r\n)^(?:(?P<vertices>(?>v(?>[ \t]+{NUMBER.pattern}){{3}}[ \t]*\r?\n)++)"
    r"|(?>f(?>[ \t]+[1-9][0-9]{0,17}(?>/[0-9]*){0,2}){3}[ \t]*\r?\n)++)"
)
#: A corner of a face: indices of its vertex and, optionally, texture coordinate and normal.
_CORNER = re.compile(r"(-?[0-9]{1,18})(/(-?[0-9]+)?){0,2}")


def read(path, folder=None):
    """Read positions, polygons and material names of an OBJ file.

    Negative indices count back from the last vertex read so far.

    Parameters
    ----------
    path : Path
    folder : Path, optional
        Folder of referenced files; not used, because no other file is read.

    Returns
    -------
    pandis.pipeline.mesh.formats.base.Reading

    Raises
    ------
    pandis.pipeline.mesh.formats.base.FormatError
    """
    del folder
    rows, polygons, names, name = _Lines(), _Lines(), [], UNNAMED
    unknown = []
    for line, words, run in _statements(text_of(path.read_bytes(), "OBJ")):
        key = words[0] if words else None
        if run and run["vertices"]:
            rows.extend(_positions(run[0]), line)
        elif run:
            corners = re.sub(r"/[0-9/]*|f", " ", run[0])
            polygons.extend(np.fromstring(corners, np.int64, sep=" ").reshape(-1, 3) - 1, line)
            names += [name] * (len(polygons.lines) - len(names))
        elif key == "v":
            if len(words) < 4:
                raise FormatError(
                    f"line {line}: a vertex has only {len(words) - 1} numbers; {AGAIN}"
                )
            rows.append(words[1:4], line)
        elif key in ("f", "fo"):
            count = len(rows.lines)
            polygons.append([_index(word, line, count) for word in words[1:]], line)
            names.append(name)
        elif key == "usemtl":
            name = " ".join(words[1:]) or UNNAMED
        elif key in _FREE_FORM:
            raise FormatError(
                f"line {line}: '{key}': free-form curves and surfaces are not supported; export "
                "the object as polygons"
            )
        elif not _STATEMENT.fullmatch(key):
            raise FormatError(f"line {line}: '{key[:40]}' is not an OBJ statement; {AGAIN}")
        elif key.lower() in ("v", "f") or (key not in _SILENT and _is_place(words[1:])):
            raise FormatError(f"line {line}: '{key}' is unknown and may be a vertex; {AGAIN}")
        elif key not in _SILENT:
            unknown.append((line, key))
    vertices = rows.converted(numbers).reshape(-1, 3)
    corners = polygons.merged()
    few = (
        [] if isinstance(corners, np.ndarray) else [i for i, p in enumerate(corners) if len(p) < 3]
    )
    if few:
        count = len(corners[few[0]])
        raise FormatError(f"{polygons.place(few[0])}: a face has {count} corners; {AGAIN}")
    faces, counts = cut(vertices, corners, polygons.place, first=1)
    notes = []
    if unknown:
        line, key = unknown[0]
        notes.append(f"ignored: {len(unknown)} unknown statements (line {line}: '{key}')")
    return Reading(vertices, faces, np.repeat(np.array(names, str), counts), notes)


#: Known statements that define no polygon.
_SILENT = frozenset(
    """vt vn vp p l o g s mg mtllib usemap maplib bevel c_interp d_interp lod shadow_obj trace_obj
    deg bmat step parm trim hole scrv sp end con ctech stech""".split()  # noqa: SIM905
)


class _Lines:
    """What lines define: arrays where runs of lines were read at once, else lists."""

    def __init__(self):
        self.chunks, self.lines = [], []

    def append(self, item, line):
        """Add the item of a line."""
        if not self.chunks or isinstance(self.chunks[-1], np.ndarray):
            self.chunks.append([])
        self.chunks[-1].append(item)
        self.lines.append(line)

    def extend(self, items, line):
        """Add the items of a run that begins at a line."""
        self.chunks.append(items)
        self.lines += range(line, line + len(items))

    def place(self, index):
        """Return the place of an item in the file, for messages."""
        return f"line {self.lines[index]}"

    def converted(self, convert):
        """Return all items as one array, lists converted by a function such as `numbers`."""
        parts, first = [np.empty((0, 3))], 0
        for chunk in self.chunks:
            if isinstance(chunk, list):
                chunk = convert(chunk, lambda i, first=first: self.place(first + i))  # noqa: PLW2901
            parts.append(chunk)
            first += len(chunk)
        return np.concatenate(parts)

    def merged(self):
        """Return all items as one array if all are of runs, else as one list."""
        if any(isinstance(chunk, list) for chunk in self.chunks):
            return list(chain.from_iterable(map(list, self.chunks)))
        return np.concatenate([np.empty((0, 3), np.int64), *self.chunks])


def _positions(text):
    """Return the coordinates (n, 3) of a run of vertices; its words if any is too large."""
    coordinates = text.replace("v", " ")
    values = np.fromstring(coordinates, sep=" ").reshape(-1, 3)
    if np.isfinite(values).all():
        return values
    words = iter(coordinates.split())
    return list(zip(words, words, words, strict=True))


def _is_place(words):
    """Return whether there are at least three words, all of them numbers."""
    return len(words) > 2 and all(NUMBER.fullmatch(word) for word in words)


def _statements(text):
    """Yield the line number and the words of each statement, or a run of statements as a match."""
    line, end = 1, 0
    for run in [*_RUN.finditer(text), None]:
        lines = lines_of(text[end : run.start() if run else None])
        yield from ((*statement, None) for statement in _single(lines, line))
        if run:
            line += len(lines) - 1
            yield line, None, run
            line, end = line + run[0].count("\n"), run.end()


def _single(lines, start):
    """Yield the line number and the words of each statement; a final backslash continues a line."""
    begun, first = [], 0
    for line, content in enumerate(lines, start):
        if content.endswith("\\"):
            first = first or line
            begun += words_of(content[:-1])
            continue
        words = begun + words_of(content)
        if words:
            yield first or line, words
        begun, first = [], 0
    if begun:
        yield first, begun


def _index(word, line, count):
    """Return the vertex index of a corner, counted from 0."""
    match = _CORNER.fullmatch(word)
    if not match:
        raise FormatError(f"line {line}: '{word[:40]}' is not a corner of a face; {AGAIN}")
    index = int(match[1])
    if index > 0:
        return index - 1
    if index == 0:
        raise FormatError(
            f"line {line}: an index is 0, but OBJ counts vertices from 1; this file seems to count "
            "from 0: add 1 to every index"
        )
    if count + index < 0:
        raise FormatError(
            f"line {line}: index {index} reaches back past the {count:,} vertices read; {AGAIN}"
        )
    return count + index
