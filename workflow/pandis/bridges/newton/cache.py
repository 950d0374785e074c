"""The workflow's file ``newton.npz``: a mesh in metres, and its distances, cooked for Newton."""

import io
import json
from os import PathLike
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pandis.base.errors import ArtifactError
from pandis.bridges.newton import cooked, put
from pandis.runtime.field import NativeField, Number

_NOTE = "__pandis__"


class CacheFile(NamedTuple):
    """Content of a ``newton.npz`` file.

    Attributes
    ----------
    name : str
        Name of the file in Newton's cache.
    content : dict of str to ndarray
        The arrays that Newton reads.
    vertices : ndarray, shape (V, 3), float32
        Metres.
    indices : ndarray, shape (3 F,), int32
    options : dict
        Options of ``build_sdf``; with any others Newton does not find the distances.
    provenance : dict
    """

    name: str
    content: dict[str, Any]
    vertices: NDArray[np.float32]
    indices: NDArray[np.int32]
    options: dict[str, Any]
    provenance: dict[str, Any]

    def packed(self) -> bytes:
        """Return the bytes of the file."""
        note = {"name": self.name, "options": self.options, "provenance": self.provenance}
        arrays = {"vertices": self.vertices, "indices": self.indices, _NOTE: json.dumps(note)}
        stream = io.BytesIO()
        np.savez(stream, **self.content, **arrays)
        return stream.getvalue()


def keep(
    field: NativeField,
    mesh: tuple[NDArray[Any], NDArray[Any]],
    length: Number,
    *,
    options: dict[str, Any],
    provenance: dict[str, Any],
    progress: Any = lambda done, total: None,
) -> CacheFile:
    """Return a mesh's cooked distances.

    Parameters
    ----------
    field : pandis.runtime.field.NativeField
    mesh : tuple of ndarray
        Vertices (V, 3), in units of the field's mesh, and faces (F, 3).
    length : float
        Metres per unit of the field's mesh.
    options : dict
        Options of ``build_sdf``, including the method of finding signs.
    provenance : dict
    progress : callable
        Called as ``progress(done, total)``, in points.

    Raises
    ------
    PandisError
        As `pandis.bridges.newton.cooked` does.
    """
    corners = np.asarray(mesh[0] * length, np.float32)
    indices = np.ascontiguousarray(mesh[1], np.int32).ravel()
    solid = SimpleNamespace(vertices=corners, indices=indices, is_solid=True)
    name, content = cooked(field, solid, length=length, progress=progress, **options)
    return CacheFile(name, content, corners, indices, options, provenance)


def read(path: str | PathLike[str]) -> CacheFile:
    """Read a ``newton.npz`` file.

    Raises
    ------
    ArtifactError
        The file cannot be read, or is of another kind.
    """
    try:
        with np.load(path) as file:
            content = dict(file)
        note = json.loads(str(content.pop(_NOTE)))
        options = {key: tuple(value) if isinstance(value, list) else value
                   for key, value in note["options"].items()}  # fmt: skip
        vertices, indices = content.pop("vertices"), content.pop("indices")
        return CacheFile(note["name"], content, vertices, indices, options, note["provenance"])
    except Exception as error:  # includes whatever zipfile and pickle raise in NumPy
        raise ArtifactError(
            f"{path}: damaged, or not a Newton file that the workflow wrote ({error})"
        ) from error


def unpack(path: str | PathLike[str], folder: str | PathLike[str]) -> CacheFile:
    """Store the distances of a ``newton.npz`` file in a folder for ``build_sdf``.

    Parameters
    ----------
    path : path-like
        ``results/{mesh}/export/newton.npz``.
    folder : path-like
        The folder to pass as ``cache_dir``; created if necessary.

    Returns
    -------
    CacheFile
        With the mesh's ``vertices`` and ``indices``, and the ``options`` for ``build_sdf``.

    Raises
    ------
    ArtifactError
        The file cannot be read, or is of another kind.
    """
    cache = read(path)
    put(Path(folder), cache.name, cache.content)
    return cache
