"""Readers of mesh files: one for each format, strict, and exact to the last bit.

What is written is read as it is written, or refused with its place: no lenient reader takes over
where a strict one says no. What the standards leave open is read as most programs do, and noted.
"""

import re
import zipfile

import numpy as np

from pandis.pipeline.mesh.formats import gltf, obj, off, ply, stl, threemf
from pandis.pipeline.mesh.formats.base import FormatError, Reading

__all__ = ["READERS", "FormatError", "Reading", "content_of", "read"]

READERS = {
    "obj": obj.read,
    "off": off.read,
    "stl": stl.read,
    "ply": ply.read,
    "glb": gltf.read,
    "gltf": gltf.read,
    "3mf": threemf.read,
}
#: What content is called in a message, where it is none of these formats.
_OTHERS = {
    "html": "a web page", "xml": "an XML file",
    "pointer": "a pointer of Git LFS (fetch the file itself: git lfs pull)",
    "zip": "a ZIP archive (unpack it)", "gzip": "a gzip file (call it .gz)",
}  # fmt: skip


def read(path, form, folder=None):
    """Read a mesh file.

    Parameters
    ----------
    path : Path
        Not compressed.
    form : str
        A key of `READERS`: what its name says.
    folder : Path, optional
        Where files lie that it names; beside it by default.

    Returns
    -------
    Reading

    Raises
    ------
    FormatError
        In a sentence without the file's name.
    """
    content = content_of(path)
    if content in _OTHERS:
        raise FormatError(f"it is no mesh but {_OTHERS[content]}")
    same = {form, content} <= {"glb", "gltf"}  # the same format in two forms: text (gltf) and
    # binary (glb)
    if content is not None and content != form and not same:
        raise FormatError(
            f"its name says {form.upper()}, and its content is {content.upper()}: call it "
            f".{content}"
        )
    with np.errstate(all="ignore"):  # numbers of any size may stand in a file
        return READERS[form](path, folder)


def content_of(path):
    """Return which format a file's content is of, None where that cannot be told.

    Returns
    -------
    str or None
        A key of `READERS`, or ``html``, ``pointer``, ``zip``, ``gzip``.
    """
    with path.open("rb") as stream:
        head = stream.read(4096)
    if head[:2] == b"\x1f\x8b":
        return "gzip"
    if head[:4] == b"glTF":
        return "glb"
    if head[:4] == b"PK\x03\x04":
        return _zipped(path)
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    if re.match(rb"ply[\r\n]", text):
        return "ply"
    if re.match(rb"(ST)?C?N?4?n?OFF\b", text):
        return "off"
    if re.match(rb"<(!doctype html|html)", text, re.I):
        return "html"
    if text.startswith(b"<?xml"):
        return "xml"
    if text.startswith(b"version https://git-lfs"):
        return "pointer"
    if text[:1] == b"{" and b'"asset"' in path.read_bytes():
        return "gltf"
    if re.match(rb"solid\b[^\n]*\n\s*(facet|endsolid)\b", text, re.I):
        return "stl"
    size = path.stat().st_size
    if size >= 84 and size == 84 + 50 * int.from_bytes(head[80:84], "little"):
        return "stl"
    if b"\0" not in head and re.search(rb"^[ \t]*v[ \t]+\S+[ \t]+\S+[ \t]+\S+", head, re.M):
        return "obj"
    return None


def _zipped(path):
    try:
        with zipfile.ZipFile(path) as package:
            models = any(name.lower().endswith(".model") for name in package.namelist())
    except threemf.DAMAGED:
        return None  # its reader says how it is damaged
    return "3mf" if models else "zip"
