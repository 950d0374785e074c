"""Counter of PLY, as text and binary."""

import re
from typing import NamedTuple

import numpy as np

from counting.base import Refused, Tally, fan, integer, number, text

_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
#: Names under which a polygon's corners go.
_CORNERS = {"vertex_indices", "vertex_index"}


class _Property(NamedTuple):
    """A property: its name, its type, and the type of its count if it is a list."""

    name: str
    type: str
    counts: str | None


class _Element(NamedTuple):
    """An element: its name, how many there are, and its properties."""

    name: str
    count: int
    properties: list


def _type(word, where):
    if word not in _TYPES:
        raise Refused(f"{where}: no type {word!r}")
    return _TYPES[word]


def _header(data):
    """Return the byte order, the elements, the rest, and the number of the line it begins in."""
    mark = re.match(rb"ply[ \t]*(\r\n|\n|\r)", data)
    if not mark:
        raise Refused("line 1: no header of PLY")
    at, place, order, elements = 1, mark.end(), None, []
    while True:
        end = data.find(mark[1], place)
        if end < 0:
            raise Refused("the header does not end")
        line, place, at = text(data[place:end]).split(), end + len(mark[1]), at + 1
        where = f"line {at}"
        match line:
            case ["comment" | "obj_info", *_]:
                pass
            case ["format", form, "1.0"] if form in _ORDERS and order is None:
                order = _ORDERS[form]
            case ["element", name, count] if name not in {known.name for known in elements}:
                elements.append(_Element(name, integer(count, where), []))
                if elements[-1].count < 0:
                    raise Refused(f"{where}: a count of {count}")
            case ["property", "list", counts, kind, name] if elements:
                counted = _type(counts, where)
                if counted[0] == "f":
                    raise Refused(f"{where}: a list counted by {counts}")
                elements[-1].properties.append(_Property(name, _type(kind, where), counted))
            case ["property", kind, name] if elements and kind != "list":
                elements[-1].properties.append(_Property(name, _type(kind, where), None))
            case ["end_header"]:
                break
            case _:
                raise Refused(f"{where}: {' '.join(line)!r} is no line of a header")
    if order is None:
        raise Refused("the header names no format")
    return order, elements, data[place:], at + 1


class _Text:
    """The values of a text: one element a line."""

    def __init__(self, body, first):
        lines = re.split(r"\r\n|\n|\r", text(body))
        self.lines = [(at, line.split()) for at, line in enumerate(lines, first) if line.strip()]
        self.row, self.where, self.left = 0, "", []

    def begin(self, element):
        if self.row >= len(self.lines):
            raise Refused(f"the file ends before the {element.count} {element.name} it declares")
        at, line = self.lines[self.row]
        self.where, self.left = f"line {at}", line[::-1]
        self.row += 1

    def end(self):
        if self.left:
            raise Refused(f"{self.where}: {self.left[-1]!r} is more than an element has")

    def take(self, kind, count):
        if count > len(self.left):
            raise Refused(f"{self.where}: fewer values than an element has")
        return [self._value(kind, self.left.pop()) for _ in range(count)]

    def _value(self, kind, token):
        if kind[0] == "f":
            return number(token, self.where)
        value, limits = integer(token, self.where), np.iinfo(kind)
        if not limits.min <= value <= limits.max:
            raise Refused(f"{self.where}: {token!r} is beyond its type")
        return value

    def finish(self):
        if self.row < len(self.lines):
            raise Refused(f"line {self.lines[self.row][0]} is more than the header declares")


class _Binary:
    """The values of a binary body."""

    def __init__(self, body, order):
        self.body, self.order, self.place = body, order, 0
        self.where = "the binary part"

    def begin(self, element):
        pass

    def end(self):
        pass

    def take(self, kind, count):
        kind = np.dtype(self.order + kind)
        end = self.place + kind.itemsize * count
        if end > len(self.body):
            raise Refused(f"the file ends {end - len(self.body)} bytes before what it declares")
        values = np.frombuffer(self.body, kind, count, self.place).tolist()
        self.place = end
        return values

    def finish(self):
        if self.place < len(self.body):
            raise Refused(f"{len(self.body) - self.place} bytes more than the header declares")


def _strips(indices):
    """Return the triangles of strips that −1 parts; every second one of a strip is turned."""
    triangles, strip = [], []
    for index in indices:
        if index == -1:
            strip = []
            continue
        strip.append(index)
        if len(strip) >= 3:
            a, b, c = strip[-3:]
            triangles.append((a, b, c) if len(strip) % 2 else (b, a, c))
    return triangles


def ply(data):
    """Count a PLY: polygons of ``face``, strips of ``tristrips``."""
    order, elements, body, first = _header(data)
    source = _Binary(body, order) if order else _Text(body, first)
    vertices = sum(known.count for known in elements if known.name == "vertex")
    points, faces = [], []
    for element in elements:
        names = [known.name for known in element.properties]
        if len(set(names)) < len(names):
            raise Refused(f"{element.name} has two properties of one name")
        if element.name == "vertex" and not set("xyz") <= {
            known.name for known in element.properties if not known.counts
        }:
            raise Refused("vertices without x, y and z")
        lists = [known.name for known in element.properties if known.counts
                 and known.name in _CORNERS and known.type[0] != "f"]  # fmt: skip
        if element.name in ("face", "tristrips") and len(lists) != 1:
            raise Refused(f"{element.name} without a list of vertices")
        for _ in range(element.count):
            source.begin(element)
            row = {}
            for name, kind, counts in element.properties:
                count = 1 if counts is None else source.take(counts, 1)[0]
                if count < 0:
                    raise Refused(f"{source.where}: a list of {count}")
                values = source.take(kind, count)
                row[name] = values[0] if counts is None else values
            source.end()
            if element.name == "vertex":
                points.append([row[axis] for axis in "xyz"])
            elif element.name in ("face", "tristrips"):
                corners = row[lists[0]]
                lowest = -1 if element.name == "tristrips" else 0
                if corners and (min(corners) < lowest or max(corners) >= vertices):
                    raise Refused(f"{source.where}: {corners} names no vertex")
                if lowest == 0 and len(corners) < 3:
                    raise Refused(f"{source.where}: a face of {len(corners)} corners")
                faces += fan(corners) if lowest == 0 else _strips(corners)
    source.finish()
    tally = Tally()
    tally.add(points, faces)
    return tally.counted()
