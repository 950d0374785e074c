"""OFF, Geomview's format."""

import re

from pandis.pipeline.mesh.formats.base import (
    AGAIN,
    FormatError,
    Reading,
    lines_of,
    numbers,
    text_of,
    whole,
    words,
)
from pandis.pipeline.mesh.formats.base import triangles as cut

#: The first word of a file. In ModelNet's files the first count follows it without a space.
_HEAD = re.compile(r"(ST)?(C)?(N)?(4)?(n)?OFF")


def read(path, folder=None):
    """Read an OFF file.

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
    lines = lines_of(text_of(path.read_bytes(), "OFF"))
    lines = [(i, row) for i, line in enumerate(lines, 1) if (row := words(line))]
    _take_head(lines)
    counts = []
    while len(counts) < 3 and lines:
        line, row = lines[0]
        taken = 3 - len(counts)
        counts += [whole(word, f"line {line}") for word in row[:taken]]
        rest = row[taken:]
        lines[:1] = [(line, rest)] if rest else []
    if len(counts) < 2 or min(counts) < 0:
        raise FormatError(f"it does not declare how many vertices and faces it has; {AGAIN}")
    count, declared = counts[:2]
    _check_amount(lines, count, declared)
    if len(lines) != count + declared:
        lines = _regrouped(lines, count, declared)
    at = [line for line, _ in lines]
    for line, row in lines[:count]:
        if len(row) < 3 or len(row) != len(lines[0][1]):
            raise FormatError(
                f"line {line}: a vertex has {len(row)} numbers, but the first has "
                f"{len(lines[0][1])}; {AGAIN}"
            )
    rows = [row[:3] for _, row in lines[:count]]
    vertices = numbers(rows, lambda i: f"line {at[i]}").reshape(-1, 3)
    polygons = [_polygon(row, line) for line, row in lines[count:]]
    faces, _ = cut(vertices, polygons, lambda i: f"line {at[count + i]}")
    return Reading(vertices, faces)


def _take_head(lines):
    """Remove the format keyword; reject binary files and dimensions other than three."""
    if not lines:
        raise FormatError(f"it is empty; {AGAIN}")
    line, row = lines[0]
    match = _HEAD.match(row[0])
    if not match:
        if not re.fullmatch(r"[0-9]+", row[0]):
            raise FormatError(f"line {line}: it begins with '{row[0][:40]}', not OFF; {AGAIN}")
        return
    if match[4] or match[5]:
        raise FormatError(f"line {line}: {match[0]} is not three-dimensional; export it as OFF")
    rest = [row[0][match.end() :], *row[1:]]
    if "BINARY" in rest:
        raise FormatError("binary OFF is not supported; export it as text")
    rest = [word for word in rest if word]
    lines[:1] = [(line, rest)] if rest else []


def _check_amount(lines, count, declared):
    words_there = sum(len(row) for _, row in lines)
    if count > words_there // 3 or declared > words_there:
        raise FormatError(
            f"it declares {count:,} vertices and {declared:,} faces, but {len(lines):,} lines "
            f"follow; it is truncated or damaged: {AGAIN}"
        )


def _regrouped(lines, count, declared):
    """Return one row per vertex and face of a file whose rows may span several lines.

    No line may contain parts of two rows. Rows may contain only positions and corners,
    because further numbers would make the end of a row ambiguous.
    """
    waiting, rows = iter(lines), []
    try:
        for place in range(count + declared):
            line, words_there = next(waiting)
            row = list(words_there)
            size = 3 if place < count else 1 + max(whole(row[0], f"line {line}"), 0)
            while len(row) < size:
                row += next(waiting)[1]
            if len(row) > size:
                break
            rows.append((line, row))
    except StopIteration:
        pass
    if len(rows) < count + declared or next(waiting, None):
        raise FormatError(
            f"it declares {count:,} vertices and {declared:,} faces, but {len(lines):,} lines "
            f"follow, which leaves {max(len(lines) - count, 0):,} for faces; it is truncated or "
            f"damaged: {AGAIN}"
        )
    return rows


def _polygon(row, line):
    size = whole(row[0], f"line {line}")
    if size < 1 or len(row) < 1 + size:
        raise FormatError(
            f"line {line}: a face has {size} corners, but {len(row) - 1} numbers follow; {AGAIN}"
        )
    return [whole(word, f"line {line}") for word in row[1 : 1 + size]]
