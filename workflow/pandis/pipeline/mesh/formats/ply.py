"""PLY, as text or as binary in either byte order."""

import re
from itertools import chain
from typing import NamedTuple

import numpy as np

from pandis.pipeline.mesh.formats.base import (
    AGAIN,
    NUMBER,
    FormatError,
    Reading,
    lines_of,
    number,
    numbers,
    whole,
    words,
)
from pandis.pipeline.mesh.formats.base import triangles as cut

_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
#: Possible names of the list property that contains a face's corners.
_CORNERS = ("vertex_indices", "vertex_index")
#: A triangle, as nearly all rows of faces are.
_TRIANGLE = r"3(?:[ \t]+[0-9]{1,18}){3}"


class Element(NamedTuple):
    """An element: name, number of rows, and properties (see `_property`)."""

    name: str
    count: int
    properties: list


def read(path, folder=None):
    """Read a PLY file.

    Parameters
    ----------
    path, folder
        As in `pandis.pipeline.mesh.formats.obj.read`.

    Returns
    -------
    pandis.pipeline.mesh.formats.base.Reading

    Raises
    ------
    pandis.pipeline.mesh.formats.base.FormatError
    """
    del folder
    data = path.read_bytes()
    order, elements, start, notes = _header(data)
    _check_kinds(elements)
    rows = _Text(data, start) if order == "" else _Binary(data, start, order)
    vertices, parts, where = None, [], "vertex"
    for element in elements:
        columns = rows.take(element)
        if element.name == "vertex":
            lacking = [axis for axis in "xyz" if axis not in columns]
            if lacking:
                raise FormatError(f"its vertices have no {lacking[0]}; {AGAIN}")
            vertices = np.stack([columns[axis] for axis in "xyz"], axis=1).astype(np.float64)
        elif element.name in ("face", "tristrips"):
            name = next((name for name in _CORNERS if name in columns), None)
            if name is None:
                raise FormatError(f"its element {element.name} has no list vertex_indices; {AGAIN}")
            lists, where = columns[name], element.name
            if element.name == "face":
                _check_sizes(lists)
            else:
                lists = _strips(lists)
            parts.append(lists)
    rows.finish(notes)
    if vertices is None:
        raise FormatError(f"it has no vertices; {AGAIN}")
    polygons = parts[0] if len(parts) == 1 else list(chain.from_iterable(parts))
    faces, _ = cut(vertices, polygons, lambda i: f"{where} {i + 1:,}")
    return Reading(vertices, faces, None, notes)


def _header(data):
    end = data.find(b"end_header")
    if not data.startswith(b"ply") or end < 0:
        raise FormatError(f"it has no complete PLY header; {AGAIN}")
    stop = data.find(b"\n", end)
    order, elements, notes = None, [], []
    for line, content in enumerate(lines_of(data[:end].decode("latin-1")), 1):
        row = content.split()
        if not row or line == 1 or row[0] in ("comment", "obj_info"):
            continue
        where = f"line {line}"
        if row[0] == "format" and len(row) > 1:
            if row[1] not in _ORDERS:
                raise FormatError(f"{where}: unknown format '{row[1][:40]}'; {AGAIN}")
            order = _ORDERS[row[1]]
        elif row[0] == "element" and len(row) == 3:
            count = whole(row[2], where)
            if count < 0:
                raise FormatError(f"{where}: negative count {count} of {row[1]}; {AGAIN}")
            elements.append(Element(row[1], count, []))
        elif row[0] == "property" and elements:
            known = elements[-1].properties
            known.append(_property(row, f"line {line}"))
            if len({name for name, *_ in known}) < len(known):
                raise FormatError(f"line {line}: repeated property {row[-1][:40]}; {AGAIN}")
        else:
            notes.append(f"line {line} of its header is not a PLY statement: '{content[:40]}'")
    if order is None:
        raise FormatError(f"its header declares no format; {AGAIN}")
    return order, elements, stop + 1 if stop >= 0 else len(data), notes


def _property(row, where):
    """Return a property's name, its type, and its list length's type, or None if not a list."""
    least = 2 if row[1:2] == ["list"] else 1
    kinds, name = row[least : 2 * least], row[-1]
    if len(row) != 2 * least + 1 or any(kind not in _TYPES for kind in kinds):
        raise FormatError(f"{where}: '{' '.join(row)[:60]}' is not a PLY property; {AGAIN}")
    if least == 2 and _TYPES[kinds[0]][0] == "f":
        raise FormatError(f"{where}: a list length must have an integer type; {AGAIN}")
    return name, _TYPES[kinds[-1]], _TYPES[kinds[0]] if least == 2 else None


def _check_kinds(elements):
    """Reject positions that are lists, and corners that are not lists of whole numbers."""
    for element in elements:
        if not element.properties:
            raise FormatError(f"its element {element.name} has no properties; {AGAIN}")
        for name, kind, size in element.properties:
            place = element.name == "vertex" and name in ("x", "y", "z")
            corners = element.name in ("face", "tristrips") and name in _CORNERS
            if (place and size) or (corners and (not size or kind[0] == "f")):
                raise FormatError(f"its {element.name} has a {name} of the wrong type; {AGAIN}")


def _check_sizes(lists):
    if isinstance(lists, np.ndarray):  # triangles
        return
    for place, corners in enumerate(lists, 1):
        if len(corners) < 3:
            raise FormatError(
                f"face {place:,} has only {len(corners)} corners; the file is truncated or its "
                f"counts are wrong: {AGAIN}"
            )


def _strips(lists):
    """Return the triangles of strips; -1 ends a strip."""
    faces = []
    for strip in lists:
        run = []
        for index in [*map(int, strip), -1]:
            if index == -1:
                for k in range(len(run) - 2):
                    a, b, c = run[k : k + 3]
                    faces.append([a, c, b] if k % 2 else [a, b, c])
                run = []
            else:
                run.append(index)
    return faces


class _Text:
    """Reads rows from text, one per line."""

    def __init__(self, data, start):
        if b"\0" in data[start:]:
            raise FormatError(f"its header declares text, but NUL bytes follow; {AGAIN}")
        self.text, self.line = data[start:].decode("latin-1"), data[:start].count(b"\n") + 1
        self.lines, self.place = None, 0

    def _split(self):
        """Split what was not read at once into lines and words; from then on, read lines."""
        if self.lines is None:
            lines = enumerate(lines_of(self.text[self.place :]), self.line)
            self.lines, self.place = [(i, row) for i, line in lines if (row := words(line))], 0

    def take(self, element):
        """Return an element's columns by name, with one value or one list per row."""
        if self.lines is None and (columns := self._run(element)) is not None:
            return columns
        self._split()
        rows = self.lines[self.place : self.place + element.count]
        if len(rows) < element.count:
            raise FormatError(
                f"its header declares {element.count:,} {element.name} rows, but {len(rows):,} "
                f"lines follow; it is truncated or damaged: {AGAIN}"
            )
        self.place += element.count
        if all(size is None for _, _, size in element.properties):
            return self._plain(element, rows)
        columns = {name: [] for name, _, _ in element.properties}
        for line, line_words in rows:
            place = 0
            for name, kind, size in element.properties:
                count = 1
                if size:
                    count = whole(_word(line_words, place, line), f"line {line}")
                    place += 1
                values = line_words[place : place + count]
                if count < 0 or len(values) < count:
                    raise FormatError(
                        f"line {line}: {len(line_words)} numbers, but more are declared; {AGAIN}"
                    )
                place += count
                read_word = number if kind[0] == "f" else whole
                row = [read_word(word, f"line {line}") for word in values]
                columns[name].append(row if size else row[0])
            if place != len(line_words):
                raise FormatError(
                    f"line {line}: {len(line_words)} numbers, but {place} are declared; its counts "
                    f"are wrong: {AGAIN}"
                )
        return columns

    def _run(self, element):
        """Read all rows at once if they are plain numbers or triangles alone, else return None."""
        names, lists = [name for name, *_ in element.properties], element.properties[0][2]
        row, kind = rf"{NUMBER.pattern}(?:[ \t]+{NUMBER.pattern}){{{len(names) - 1}}}", np.float64
        if lists and len(names) == 1 and element.properties[0][1][0] != "f":
            row, kind = _TRIANGLE, np.int64
        elif any(size for _, _, size in element.properties):
            return None
        if not 0 < element.count <= len(self.text):  # more than `re` may repeat
            return None
        rows = re.compile(rf"(?>[ \t]*{row}[ \t]*(?:\r?\n|\Z)){{{element.count}}}+")
        if not (match := rows.match(self.text, self.place)):
            return None
        values = np.fromstring(match[0], kind, sep=" ").reshape(element.count, -1)
        if not np.isfinite(values).all():
            return None
        self.place, self.line = match.end(), self.line + element.count
        return {names[0]: values[:, 1:]} if lists else dict(zip(names, values.T, strict=True))

    def _plain(self, element, rows):
        names = [name for name, _, _ in element.properties]
        for line, row in rows:
            if len(row) != len(names):
                raise FormatError(
                    f"line {line}: {len(row)} numbers, but {len(names)} are declared for each "
                    f"{element.name}; the counts are wrong or the file is truncated: {AGAIN}"
                )
        values = numbers([row for _, row in rows], lambda i: f"line {rows[i][0]}")
        return dict(zip(names, values.reshape(-1, len(names)).T, strict=True))

    def finish(self, notes):
        """Raise if lines are left."""
        self._split()
        left = len(self.lines) - self.place
        if left:
            raise FormatError(
                f"line {self.lines[self.place][0]}: the file has {left:,} more lines than its "
                f"header declares; {AGAIN}"
            )


def _word(row, place, line):
    if place >= len(row):
        raise FormatError(f"line {line}: {len(row)} numbers, but more are declared; {AGAIN}")
    return row[place]


class _Binary:
    """Reads rows from bytes."""

    def __init__(self, data, start, order):
        self.data, self.place, self.order = data, start, order

    def take(self, element):
        """Return an element's columns by name, with one value or one list per row."""
        lists = [name for name, _, size in element.properties if size]
        if not element.count or not element.properties:
            return {name: [] if name in lists else np.empty(0) for name, *_ in element.properties}
        columns = self._uniform(element)
        if columns is None:
            columns = self._one_by_one(element)
        return columns

    def _uniform(self, element):
        """Return the columns if each list has the same length in all rows, else None."""
        sizes, place = {}, self.place
        for name, kind, size in element.properties:
            if size:
                count = self._number(size, place, element, index=0)
                place += np.dtype(size).itemsize
                sizes[name] = count
                place += max(count, 0) * np.dtype(kind).itemsize
            else:
                place += np.dtype(kind).itemsize
        if any(not 0 <= count <= len(self.data) for count in sizes.values()):
            return None
        fields = []
        for name, kind, size in element.properties:
            if size:
                fields.append((f"#{name}", self.order + size))
                fields.append((name, self.order + kind, (sizes[name],)))
            else:
                fields.append((name, self.order + kind))
        record = np.dtype(fields)
        if self.place + record.itemsize * element.count > len(self.data):
            if not sizes:
                there = (len(self.data) - self.place) // record.itemsize
                raise FormatError(
                    f"its header declares {element.count:,} {element.name} rows, but there are "
                    f"only {there:,}; it is truncated: {AGAIN}"
                )
            return None
        rows = np.frombuffer(self.data, record, element.count, self.place)
        if any((rows[f"#{name}"] != count).any() for name, count in sizes.items()):
            return None
        self.place += record.itemsize * element.count
        columns = {}
        for name, kind, size in element.properties:
            columns[name] = values = rows[name]
            if size and kind[0] != "f":
                values = values.astype(np.int64)
                columns[name] = values if sizes[name] == 3 else values.tolist()
        return columns

    def _one_by_one(self, element):
        columns = {name: [] for name, _, _ in element.properties}
        for index in range(element.count):
            for name, kind, size in element.properties:
                count = 1
                if size:
                    count = self._number(size, self.place, element, index=index)
                    self.place += np.dtype(size).itemsize
                end = self.place + count * np.dtype(kind).itemsize
                if count < 0 or end > len(self.data):
                    raise self._cut(element, index)
                values = np.frombuffer(self.data, self.order + kind, count, self.place)
                self.place = end
                columns[name].append(values.tolist() if size else values[0])
        return columns

    def _number(self, kind, place, element, *, index):
        end = place + np.dtype(kind).itemsize
        if end > len(self.data):
            raise self._cut(element, index)
        return int(np.frombuffer(self.data, self.order + kind, 1, place)[0])

    def _cut(self, element, index):
        return FormatError(
            f"its header declares {element.count:,} {element.name} rows, but it ends in row "
            f"{index + 1:,}; it is truncated, or its counts are wrong: {AGAIN}"
        )

    def finish(self, notes):
        """Raise if data is left over; if it is blank, only add a note."""
        left = len(self.data) - self.place
        if left and self.data[self.place :].strip(b"\0\r\n "):
            raise FormatError(
                f"{left:,} more bytes than its header declares; its counts are wrong: {AGAIN}"
            )
        if left:
            notes.append(f"{left:,} blank bytes follow the data that its header declares")
