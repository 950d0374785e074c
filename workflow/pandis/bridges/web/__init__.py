"""Web pages for touching fields: ``pandis.h`` in WebAssembly, in one self-contained file.

The module ``pandis.wasm`` is compiled from ``web.c`` by ``make wasm`` and is part of the package.
"""

import base64
import json
from os import PathLike
from pathlib import Path

import numpy as np

from pandis.base.errors import ArtifactError, PandisError
from pandis.base.files import write_atomically
from pandis.base.frame import UNIT_SIDE
from pandis.bridges.web.surface import surface_of
from pandis.runtime.field import NativeField
from pandis.runtime.info import no_proxy

HERE = Path(__file__).parent
SOURCE, MODULE = HERE / "web.c", HERE / "pandis.wasm"
#: Maximum total size of a page's fields, bytes: browsers open larger pages slowly.
LARGEST = 64_000_000
#: Largest size (m) and stiffness (N/m) on a page; usual maximum of the stiffness slider (N/m).
LONGEST, STIFFEST, USUAL = 10.0, 5000.0, 1500.0
#: Size (m) and stiffness (N/m) of an object of which nothing else is known.
USUAL_SIZE, USUAL_STIFFNESS = 0.10, 400.0
#: Integer steps per unit of unit-frame length.
_STEPS = 32767


def write_page(
    path: str | PathLike[str], files, size=None, *, stiffness=None, up: str = "y"
) -> None:
    """Write a page on which an object's fields can be touched.

    Parameters
    ----------
    path : path-like
        ``….html``.
    files : list of path-like
        ``.pandis`` files of one object; the first is selected, and its surface is drawn.
    size : float, optional
        Length of the object's longest side under the hand, m. By default that of the workflow's
        run, if its ``hardware.json`` is beside the folder of the files, else 0.10.
    stiffness : float, optional
        Initial stiffness, N/m; by default as for the size, else 400.
    up : {"x", "y", "z"}
        The axis of the object that points up at first.

    Raises
    ------
    PandisError
        A file cannot be read, has no proxy, or belongs to another object; the files are too large
        for a page; or size or stiffness is out of range.
    """
    fields = [NativeField(file) for file in files]
    for field in fields:
        _check(field, fields[0])
    first = fields[0].path
    name = first.parent.parent.name if first.parent.name == "export" else first.stem
    run_size, run_stiffness = _scale_beside(first)
    size = run_size if size is None else size
    stiffness = run_stiffness if stiffness is None else stiffness
    text = page(name, fields, size, stiffness=stiffness, up=up)
    write_atomically(path, text.encode())


def _scale_beside(path):
    """Return size and stiffness of the run that exported a file, if it was validated."""
    try:
        validated = json.loads((path.parent.parent / "hardware.json").read_text(encoding="utf-8"))
        return float(validated["size"]), float(validated["stiffness"])
    except (OSError, ValueError, KeyError, TypeError):
        return USUAL_SIZE, USUAL_STIFFNESS


def page(name, fields, size, *, stiffness, up="y"):
    """Return a page on which the fields of an object called ``name`` can be touched.

    Parameters and errors are as for `write_page`, except that ``fields`` are open fields.
    """
    if up not in ("x", "y", "z"):
        raise PandisError(f"up: {up!r}: name the axis that points up: x, y or z")
    if not (0 < size <= LONGEST and 0 <= stiffness <= STIFFEST):
        raise PandisError(
            f"size: {size:g}, stiffness: {stiffness:g}: an object on a page may be at most "
            f"{LONGEST:g} m long, and its stiffness at most {STIFFEST:g} N/m"
        )
    total = sum(field.path.stat().st_size for field in fields)
    if total > LARGEST:
        raise PandisError(f"{total:,} bytes of fields are too many for a page: {LARGEST:,} at most")
    return (HERE / "page.html").read_text(encoding="utf-8").format(
        title=f"{_escaped(name)}: touch it",
        style=(HERE / "style.css").read_text(encoding="utf-8"),
        section=section(fields, size, stiffness, up=up),
        scripts="".join(script(part) for part in ("solid", "touch")),
    )  # fmt: skip


def with_proxies(fields, log):
    """Return the fields that have a proxy, and log the others.

    Raises
    ------
    PandisError
        No field has a proxy.
    """
    touchable = []
    for field in fields:
        if why := no_proxy(field):
            log(f"{field.path.stem}: not on the page: {why}")
        else:
            touchable.append(field)
    if not touchable:
        raise PandisError("none of these fields has a proxy: list another one in `fields`")
    return touchable


def script(name):
    """Return the text of one of the page's scripts: ``solid``, ``touch`` or ``loop``."""
    return (HERE / f"{name}.js").read_text(encoding="utf-8")


def section(fields, size, stiffness, *, up="y"):
    """Return the HTML section of a page for touching an object's fields."""
    corners, faces = surface_of(fields[0])
    small = len(corners) < 1 << 16
    drawn = {
        "vertices": _text(np.rint(np.clip(corners, -1, 1) * _STEPS), "<i2"),
        "faces": _text(faces, "<u2" if small else "<u4"),
        "small": small,
        "up": up,
    }
    return touched(fields, size, stiffness, more=drawn | loop())


def loop():
    """Return data shared by all objects of a page: the module ``pandis.wasm`` and the loop."""
    return {"wasm": _text(np.fromfile(MODULE, np.uint8), "u1"), "loop": script("loop")}


def touched(fields, size, stiffness, *, more):
    """Return the same HTML as `section`, for an object that is drawn from other data.

    Parameters
    ----------
    fields : list of pandis.runtime.field.NativeField
    size, stiffness : float
        Length of the longest side, m, and initial stiffness, N/m.
    more : dict
        Further data for ``touch.js``: either the solid and the loop or, if the page already
        contains the loop, ``view``, the name of the figure that contains the solid.
    """
    data = more | {
        "size": size,
        "longest": UNIT_SIDE,
        "fields": [
            {"name": field.path.stem, "bytes": _text(np.fromfile(field.path, np.uint8), "u1")}
            for field in fields
        ],
    }
    return (HERE / "section.html").read_text(encoding="utf-8").format(
        data=json.dumps(data).replace("<", "\\u003c"),
        size=f"{1e3 * size:g} mm",
        stiffness=f"{stiffness:g}",
        most=f"{max(stiffness, USUAL):g}",
    )  # fmt: skip


def _check(field, first):
    """Raise PandisError for a field that cannot be touched, or belongs to another object."""
    if why := no_proxy(field):
        raise ArtifactError(f"{field.path}: it cannot be touched: {why}")
    apart = np.abs(first.frame.to_unit(field.frame.centre)).max()
    if apart > 0.1 or not 0.9 < field.frame.scale / first.frame.scale < 1.1:
        raise PandisError(
            f"{field.path}: this field is of another object, not of that of {first.path}: its size "
            "or position differs; write a separate page for each object"
        )


def _text(values, kind):
    return base64.b64encode(np.ascontiguousarray(values).astype(kind).tobytes()).decode()


def _escaped(text):
    return text.replace("&", "&amp;").replace("<", "&lt;")
