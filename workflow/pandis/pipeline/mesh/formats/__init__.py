"""Readers of mesh files: one for each format, strict, and exact to the last bit.

A file is either read exactly as written, or rejected with a message that locates the fault. There
is no lenient fallback. Where a standard is ambiguous, a file is read as most programs read it, and
a note is added.
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
#: What messages call contents that are not meshes.
_OTHERS = {
    "html": "a web page", "xml": "an XML file",
    "pointer": "a Git LFS pointer (fetch the file itself: git lfs pull)",
    "zip": "a ZIP archive (unpack it)", "gzip": "a gzip file (rename it to .gz)",
}  # fmt: skip


def read(path, form, folder=None):
    """Read a mesh file.

    Parameters
    ----------
    path : Path
        Not compressed.
    form : str
        A key of `READERS`, derived from the file name.
    folder : Path, optional
        Folder of the files that the mesh file references; by default its own folder.

    Returns
    -------
    Reading

    Raises
    ------
    FormatError
        The file cannot be read. The message does not contain the file name.
    """
    content = content_of(path)
    if content in _OTHERS:
        raise FormatError(f"it is not a mesh but {_OTHERS[content]}")
    same = {form, content} <= {"glb", "gltf"}  # the same format, as binary or as text
    if content is not None and content != form and not same:
        raise FormatError(
            f"its name suggests {form.upper()}, but its content is {content.upper()}: rename it to "
            f".{content}"
        )
    with np.errstate(all="ignore"):  # a file may contain numbers of any size
        return READERS[form](path, folder)


def content_of(path):
    """Detect a file's format from its content; return None if that is not possible.

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
        return None  # the 3MF reader reports the damage
    return "3mf" if models else "zip"
