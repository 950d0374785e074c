"""Describes ``.pandis`` files in words: ``pandis info FILE``."""

import numpy as np

from pandis.base.errors import PandisError
from pandis.base.frame import UNIT_SIDE
from pandis.runtime.contact import NativeContact
from pandis.runtime.field.constants import (
    COMPACT,
    GRID,
    MESH,
    NETWORK,
    RULES,
    SHAPE,
    SHAPES,
    SPLINE,
)
from pandis.runtime.field.files import read_contents
from pandis.runtime.scene import Placed

#: Number of timed queries, at random points of the box.
_QUERIES = 2000


def facts(path):
    """Return facts about a ``.pandis`` file.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    dict
        Plain values: ``file``, ``bytes``, ``format`` (its version), ``kind`` and ``made_of`` (in
        words), ``size`` and ``centre`` (of the object's box, mesh units; ``size`` is None if the
        file does not store it), ``longest`` (longest side), ``regions``, ``proxy`` (empty, or why
        there is none), ``faces`` (whether answers name the nearest face), ``microseconds`` (median
        time of a query in the box, on this machine), ``provenance``.

    Raises
    ------
    pandis.base.errors.ArtifactError
        The file cannot be read, is damaged or has another version.
    """
    contents = read_contents(path)
    field = contents.field
    kind, made_of = _made_of(contents)
    rng = np.random.default_rng(0)
    points = field.frame.to_mesh(rng.uniform(-1, 1, (_QUERIES, 3)))
    low, high = _box(contents)
    return {
        "file": str(path),
        "bytes": field.path.stat().st_size,
        "format": contents.version,
        "kind": kind,
        "made_of": made_of,
        "longest": UNIT_SIDE / field.frame.scale,
        "size": None if low is None else (high - low).tolist(),
        "centre": list(field.frame.centre) if low is None else ((low + high) / 2).tolist(),
        "regions": list(field.region_names),
        "proxy": no_proxy(field),
        "faces": bool((field.faces(points[:16]) >= 0).any()),
        "microseconds": float(np.median(field.time(points, _QUERIES)) * 1e6),
        "provenance": contents.provenance,
    }


def _made_of(contents):
    """Return a field's kind and a description of its data."""
    field, whole = contents.field, contents.wholes
    if field.kind == NETWORK:
        width, depth, outputs, cells, bits = whole[:5]
        answers = "distance and direction" if outputs == 4 else "distance, with its own gradient"
        base = f", on a coarse spline of {cells}³ cells" if cells else ""
        return "network", f"{depth} sine layers of {width}, {bits} bits: {answers}{base}"
    if field.kind == GRID:
        return RULES[whole[0]], f"{whole[1]}³ nodes"
    if field.kind == SPLINE:
        return "spline", f"two banded lattices of {whole[0]} and {whole[1]} nodes per axis"
    if field.kind == MESH:
        return "exact", f"a mesh of {whole[0]:,} vertices and {whole[1]:,} faces"
    if field.kind == COMPACT:
        first = np.frombuffer(contents.sections["BLCK"], "<u4").reshape(-1, 4)[:, 1]
        faces = int(((first & 63) + 1).sum())
        return "compact", f"a mesh of {faces:,} faces, its vertices on a lattice of {whole[0]} bits"
    if field.kind == SHAPE:
        return "closed form", f"a {SHAPES[whole[0]]}"
    raise PandisError(f"{field.path}: unknown kind of field {field.kind}")


def _box(contents):
    """Return the corners of the surface's box, mesh units; None, None if not in the file."""
    part = contents.sections.get("SAFE")
    if part is None:
        return None, None
    corners = np.frombuffer(part, "<f8", 6)  # unit frame; the section continues with bounds
    return tuple(contents.field.frame.to_mesh(corners.reshape(2, 3)))


def no_proxy(field):
    """Return why a field has no proxy; empty if it has one."""
    try:
        NativeContact(Placed.at(field, 1.0, 1.0))
    except PandisError as error:
        return str(error)
    return ""


def describe(contents):
    """Return the result of `facts` as lines of text."""
    if contents["size"]:
        size = " × ".join(f"{side:.6g}" for side in contents["size"])
    else:
        size = f"{contents['longest']:.6g} along its longest side"
    centre = ", ".join(f"{place:.6g}" for place in contents["centre"])
    answers = "distance and normal, inside and outside"
    if contents["proxy"]:
        answers = "force and normal, only inside"
    lines = {
        "field": f"{contents['kind']}: {contents['made_of']}",
        "file": f"{contents['bytes']:,} bytes, format {contents['format']}; whole and undamaged",
        "object": f"{size} mesh units, around ({centre})",
        "answers": answers + ("; the nearest face of the mesh" if contents["faces"] else ""),
        "proxy": f"none: {contents['proxy']}" if contents["proxy"] else "yes (pandis_contact)",
        "regions": ", ".join(contents["regions"]) or "none",
        "a query": f"{contents['microseconds']:.2g} µs on this machine, median of {_QUERIES:,} "
        "single queries in its box",
        "made by": _maker(contents["provenance"]),
    }
    width = max(map(len, lines)) + 2
    return "\n".join([contents["file"], *(f"  {k:<{width}}{v}" for k, v in lines.items())])


def _maker(provenance):
    """Return a field's origin in words."""
    if not provenance:
        return "unknown: the file does not state it"
    field = _text_in(provenance, "options", "field") or _text_in(provenance, "wildcards", "name")
    mesh, code = _text_in(provenance, "wildcards", "mesh"), _text_in(provenance, "code", "digest")
    parts = [f"field {field}" if field else "", f"of mesh {mesh}" if mesh else "",
             f"by code {code[:12]}" if code else ""]  # fmt: skip
    return " ".join(filter(None, parts)) or "unknown: the provenance names no stage"


def _text_in(provenance, part, name):
    """Return a string from part of a provenance; empty if missing, as in hand-written files."""
    there = provenance.get(part)
    text = there.get(name) if isinstance(there, dict) else None
    return text if isinstance(text, str) else ""
