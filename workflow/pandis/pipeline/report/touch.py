"""The part of the page in which a mesh is touched, with small files of its fields."""

import json
from pathlib import Path

from pandis.bridges.web import LONGEST, STIFFEST, loop, touched
from pandis.runtime.field import NativeField
from pandis.runtime.info import no_proxy

#: Size limits (bytes) that let pages open quickly: for one mesh's files, for all parts of a page.
_EACH, _ALL = 1_000_000, 6_000_000


def touchable(paths):
    """Return the files for the page: the smallest of those with a proxy, up to 1 MB in total."""
    files_shown, left = [], _EACH
    for path in sorted(map(Path, paths), key=lambda path: (path.stat().st_size, path.name)):
        size = path.stat().st_size
        if size <= left and not no_proxy(NativeField(path)):
            files_shown.append(path)
            left -= size
    return files_shown


def touch(paths, size, stiffness, *, view):
    """Return the HTML for touching one mesh, or None if it cannot be touched.

    Parameters
    ----------
    paths : list of path-like
        From `touchable`.
    size, stiffness : float
        Size and stiffness of the device, m and N/m.
    view : str
        Name of the figure that contains the solid.
    """
    if not paths or size > LONGEST:
        return None
    fields = [NativeField(path) for path in paths]
    return touched(fields, size, min(stiffness, STIFFEST), more={"view": view})


def shared(sections):
    """Return, by mesh, as many of a page's touch parts as fit, and the data that they share."""
    parts, left = {}, _ALL
    for section in sections:
        if section.touch and len(section.touch) <= left:
            parts[section.name] = section.touch
            left -= len(section.touch)
    return parts, json.dumps(loop()).replace("<", "\\u003c") if parts else ""
