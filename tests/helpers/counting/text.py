"""Counters of OBJ, OFF and STL."""

import re

import numpy as np

from counting.base import Refused, Tally, fan, integer, number, text, words

#: Statements of the OBJ standard that place no polygon: curves do not, surfaces are refused.
_OBJ_OTHER = {
    "vt", "vn", "vp", "p", "l", "o", "g", "s", "mg", "usemtl", "mtllib", "usemap", "maplib",
    "bevel", "c_interp", "d_interp", "lod", "shadow_obj", "trace_obj", "cstype", "deg", "bmat",
    "step", "curv", "curv2", "parm", "trim", "hole", "scrv", "sp", "end", "con", "ctech", "stech",
}  # fmt: skip
#: A face's corner: vertex, perhaps texture, perhaps normal.
_CORNER = re.compile(r"(-?[0-9]{1,18})(?:/(-?[0-9]+)?(?:/(-?[0-9]+)?)?)?")
_OFF_HEADER = re.compile(r"(ST)?(C)?(N)?(4)?(n)?OFF")


def _obj_lines(whole):
    """Yield number and text of each line; a backslash at its end joins it with the next."""
    joined, first = "", 1
    for at, line in enumerate(re.split(r"\r\n|\n|\r", whole), 1):
        if not joined:
            first = at
        if line.endswith("\\"):
            joined += line[:-1] + " "
            continue
        yield first, joined + line
        joined = ""
    if joined:
        raise Refused(f"line {first} goes on after the end of the file")


def obj(data):
    """Count an OBJ; texture and normal indices are not looked up, for they place nothing."""
    points, faces = [], []
    for at, line in _obj_lines(text(data)):
        found, where = words(line), f"line {at}"
        if not found:
            continue
        kind, rest = found[0], found[1:]
        if kind == "v":
            # with a weight, a colour, or a colour and its alpha
            if len(rest) not in (3, 4, 6, 7):
                raise Refused(f"{where}: a vertex of {len(rest)} numbers")
            points.append([number(token, where) for token in rest][:3])
        elif kind in ("f", "fo"):  # the second is an older name of the first
            if len(rest) < 3:
                raise Refused(f"{where}: a face of {len(rest)} corners")
            corners = []
            for token in rest:
                match = _CORNER.fullmatch(token)
                if not match:
                    raise Refused(f"{where}: {token!r} is no corner")
                index = int(match[1])
                # a relative index counts back from the vertices so far
                index = index - 1 if index > 0 else len(points) + index if index < 0 else -1
                if index < 0:
                    raise Refused(f"{where}: no vertex {token!r}")
                corners.append(index)
            faces += [(triangle, where) for triangle in fan(corners)]
        elif kind not in _OBJ_OTHER:
            raise Refused(f"{where}: {kind!r} is no statement of OBJ, or one that is not counted")
    for triangle, where in faces:
        if max(triangle) >= len(points):
            raise Refused(f"{where}: no vertex {max(triangle) + 1}, there are {len(points)}")
    tally = Tally()
    tally.add(points, [triangle for triangle, _ in faces])
    return tally.counted()


class _Words:
    """The words of an OFF, each with its line."""

    def __init__(self, whole):
        self.lines = [words(line) for line in re.split(r"\r\n|\n|\r", whole)]
        self.row, self.column = 0, 0

    @property
    def where(self):
        """The place of the word that was taken last."""
        return f"line {self.row + 1}"

    def take(self):
        """Return the next word, on whichever line."""
        while self.row < len(self.lines) and self.column >= len(self.lines[self.row]):
            self.row, self.column = self.row + 1, 0
        if self.row >= len(self.lines):
            raise Refused("the file ends before what its header declares")
        self.column += 1
        return self.lines[self.row][self.column - 1]

    def rest(self):
        """Return what is left of this line."""
        rest = self.lines[self.row][self.column :]
        self.column = len(self.lines[self.row])
        return rest

    def count(self):
        """Return the next word as a count."""
        token = self.take()
        value = integer(token, self.where)
        if value < 0:
            raise Refused(f"{self.where}: a count of {token}")
        return value


def off(data):
    """Count an OFF: Geomview's, of three dimensions, as text."""
    if data[:64].split(b"\n")[0].rstrip().endswith(b"BINARY"):
        raise Refused("a binary OFF")
    source = _Words(text(data))
    match = _OFF_HEADER.fullmatch(source.take())
    if not match:
        raise Refused(f"{source.where}: no header of OFF")
    texture, colour, normal, four, many = match.groups()
    if four or many:
        raise Refused("an OFF that is not of three dimensions")
    vertices, polygons, _ = source.count(), source.count(), source.count()
    width = 3 + 3 * bool(normal) + 4 * bool(colour) + 2 * bool(texture)
    points = []
    for _ in range(vertices):
        values = []
        for _ in range(width):
            token = source.take()
            values.append(number(token, source.where))
        points.append(values[:3])
    faces = []
    for _ in range(polygons):
        corners = []
        for _ in range(source.count()):
            index = integer(source.take(), source.where)
            if not 0 <= index < vertices:
                raise Refused(f"{source.where}: no vertex {index}, there are {vertices}")
            corners.append(index)
        # a colour: a row of a table, or three or four shares
        colours = source.rest()
        if len(colours) not in (0, 1, 3, 4):
            raise Refused(f"{source.where}: a colour of {len(colours)} numbers")
        for token in colours:
            number(token, source.where)
        faces += fan(corners)
    try:
        token = source.take()
    except Refused:
        tally = Tally()
        tally.add(points, faces)
        return tally.counted()
    raise Refused(f"{source.where}: {token!r} after all that the header declares")


def stl(data):
    """Count an STL; one is binary if its size says so, whatever its first word."""
    size = len(data)
    declared = int.from_bytes(data[80:84], "little") if size >= 84 else None
    if declared is not None and size == 84 + 50 * declared:
        record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
        corners = np.frombuffer(data, record, declared, 84)["corners"]
        tally = Tally()
        tally.add(corners.reshape(-1, 3), np.arange(3 * declared))
        return tally.counted()
    if data.lstrip()[:5].lower() == b"solid" and b"\0" not in data:
        return _ascii_stl(text(data))
    if declared is None:
        raise Refused(f"{size} bytes are fewer than the header of a binary STL")
    raise Refused(f"{declared} triangles declared, {(size - 84) / 50:g} there")


def _ascii_stl(whole):
    """Count a text of solids, word by word; their names are the rest of their lines."""
    lines = [line.split() for line in re.split(r"\r\n|\n|\r", whole)]
    stream = ((at, place, word) for at, line in enumerate(lines, 1) for place, word in
              enumerate(line))  # fmt: skip
    corners, named = [], 0

    def take():
        for at, place, word in stream:
            # the name of a solid: its line is not read further
            if at != named:
                return at, place, word
        return None

    def expect(*expected):
        for word in expected:
            found = take()
            if found is None:
                raise Refused(f"the file ends before {word!r}")
            if found[2].lower() != word:
                raise Refused(f"line {found[0]}: {found[2]!r} in place of {word!r}")

    def numbers():
        values = []
        for _ in range(3):
            found = take()
            if found is None:
                raise Refused("the file ends within three numbers")
            values.append(number(found[2], f"line {found[0]}"))
        return values

    while (found := take()) is not None:
        at, place, word = found
        if word.lower() != "solid" or place:
            raise Refused(f"line {at}: {word!r} in place of 'solid'")
        named = at
        while True:
            found = take()
            if found is None:
                raise Refused("the file ends before 'endsolid'")
            at, place, word = found
            if word.lower() == "endsolid":
                named = at
                break
            if word.lower() != "facet":
                raise Refused(f"line {at}: {word!r} in place of 'facet'")
            expect("normal")
            numbers()
            expect("outer", "loop")
            for _ in range(3):
                expect("vertex")
                corners.append(numbers())
            expect("endloop", "endfacet")
    tally = Tally()
    tally.add(corners, np.arange(len(corners)))
    return tally.counted()
