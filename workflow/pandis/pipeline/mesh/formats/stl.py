"""STL, as text and binary."""

import re

import numpy as np

from pandis.pipeline.mesh.formats.base import AGAIN, FormatError, Reading, number, numbers

#: Bytes before the triangles of a binary file, and of each.
_HEAD, _EACH = 84, 50
_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
#: The words of a facet; what is None is a number.
_FACET = (
    "facet", "normal", *"...", "outer", "loop", "vertex", *"...", "vertex", *"...",
    "vertex", *"...", "endloop", "endfacet",
)  # fmt: skip
_BOUND = re.compile(r"^[ \t]*(end[ \t]*)?solid\b[^\n]*$", re.M | re.I)


def read(path, folder=None):
    """Read an STL file.

    Parameters
    ----------
    path, folder
        As of `pandis.pipeline.mesh.formats.obj.read`.

    Returns
    -------
    pandis.pipeline.mesh.formats.base.Reading
        Three vertices for each face.

    Raises
    ------
    pandis.pipeline.mesh.formats.base.FormatError
    """
    del folder
    data = path.read_bytes().removeprefix(b"\xef\xbb\xbf")
    count = int.from_bytes(data[80:_HEAD], "little") if len(data) >= _HEAD else 0
    if len(data) >= _HEAD and len(data) == _HEAD + _EACH * count:
        return _binary(data, count)
    if data[:512].lstrip()[:5].lower() == b"solid" and b"\0" not in data:
        return _text(data.decode("latin-1"))
    there, left = divmod(max(len(data) - _HEAD, 0), _EACH)
    if len(data) < _HEAD:
        raise FormatError(f"a binary STL of {len(data)} bytes, less than its header; {AGAIN}")
    raise FormatError(
        f"its header declares {count:,} triangles, and {there:,} are there"
        + (f", with {left} bytes more" if left else "")
        + f"; it is cut, or written wrongly: {AGAIN}"
    )


def _binary(data, count):
    records = np.frombuffer(data, _RECORD, count, _HEAD)
    vertices = records["corners"].reshape(-1, 3).astype(np.float64)
    return Reading(vertices, np.arange(3 * count).reshape(-1, 3))


def _text(text):
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    notes = []
    ends = [bool(bound[1]) for bound in _BOUND.finditer(text)]
    if 2 * sum(ends) != len(ends):
        notes.append(
            f"{len(ends) - sum(ends)} times solid and {sum(ends)} times endsolid: it may be cut"
        )
    body = _BOUND.sub("", text)
    words = body.split()
    lowered = [word.lower() for word in words]
    wrong = len(words) % len(_FACET) != 0 or any(
        keyword != "." and set(lowered[place :: len(_FACET)]) - {keyword}
        for place, keyword in enumerate(_FACET)
    )
    if wrong:
        raise FormatError(_first_fault(body))
    places = [place for place, keyword in enumerate(_FACET) if keyword == "."]
    columns = [words[place :: len(_FACET)] for place in places]
    rows = list(zip(*columns[3:], strict=True))

    def where(facet):
        return f"line {_line_of(body, facet * len(_FACET))}"

    try:
        vertices = numbers(rows, where).reshape(-1, 3)
    except FormatError:
        raise FormatError(_first_fault(body)) from None
    _check_normals(columns[:3], where, notes)
    return Reading(vertices, np.arange(len(vertices)).reshape(-1, 3), None, notes)


def _check_normals(columns, where, notes):
    """Say if normals are no numbers: they are not used, but somebody has written them wrongly."""
    try:
        numbers(list(zip(*columns, strict=True)), where)
    except FormatError as error:
        notes.append(f"its normals are not used, and are not all numbers ({error})")


def _line_of(body, index):
    """Return the line of a word."""
    for line, content in enumerate(body.split("\n"), 1):
        index -= len(content.split())
        if index < 0:
            return line
    return len(body.split("\n"))


def _first_fault(body):
    """Say what is the first fault of a text that is no row of facets."""
    place, line = 0, 1
    for line, content in enumerate(body.split("\n"), 1):
        for word in content.split():
            keyword = _FACET[place % len(_FACET)]
            if keyword == ".":
                if place % len(_FACET) > 4:
                    try:
                        number(word, f"line {line}")
                    except FormatError as error:
                        return str(error)
            elif word.lower() != keyword:
                return f"line {line}: '{word[:40]}' in place of '{keyword}'; {AGAIN}"
            place += 1
    whole = place // len(_FACET)
    return f"line {line}: it is cut in the middle of facet {whole + 1:,}; {AGAIN}"
