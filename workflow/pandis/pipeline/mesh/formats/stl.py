"""STL, as text or binary."""

import re

import numpy as np

from pandis.pipeline.mesh.formats.base import AGAIN, FormatError, Reading, number, numbers

#: Sizes of a binary file's header and of each triangle, in bytes.
_HEAD, _EACH = 84, 50
_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
#: The words of a facet; each "." represents a number.
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
        As in `pandis.pipeline.mesh.formats.obj.read`.

    Returns
    -------
    pandis.pipeline.mesh.formats.base.Reading
        Each face has its own three vertices.

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
        raise FormatError(f"a binary STL of {len(data)} bytes is shorter than its header; {AGAIN}")
    raise FormatError(
        f"its header declares {count:,} triangles, but there are {there:,}"
        + (f", followed by {left} bytes" if left else "")
        + f"; it is truncated or was written incorrectly: {AGAIN}"
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
            f"{len(ends) - sum(ends)} solid but {sum(ends)} endsolid lines: it may be truncated"
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
    """Add a note if some normals are not numbers; normals are checked, but not used."""
    try:
        numbers(list(zip(*columns, strict=True)), where)
    except FormatError as error:
        notes.append(f"some of its normals are not numbers; normals are not used ({error})")


def _line_of(body, index):
    """Return the line number of the word at an index."""
    for line, content in enumerate(body.split("\n"), 1):
        index -= len(content.split())
        if index < 0:
            return line
    return len(body.split("\n"))


def _first_fault(body):
    """Describe the first fault in a text that is not a sequence of facets."""
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
                return f"line {line}: '{word[:40]}' instead of '{keyword}'; {AGAIN}"
            place += 1
    whole = place // len(_FACET)
    return f"line {line}: it is truncated in facet {whole + 1:,}; {AGAIN}"
