"""Meshes as users pass them: paths, arrays, or objects of other libraries."""

import re
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pandis.base.errors import PandisError
from pandis.pipeline.run.ask.catalogue import RESERVED_NAMES
from pandis.pipeline.run.ask.sourcing import ANALYTIC, SHIPPED, source_fault, stem_of, url_extension

#: Stands for the path of a mesh that is passed as arrays.
ARRAYS = "arrays"
_EXPECTED = (
    "expected the path of a mesh file, a pair (vertices, faces), or a mesh of trimesh, Open3D, "
    "PyVista or meshio"
)


class Source(NamedTuple):
    """A mesh to work on.

    Attributes
    ----------
    text : str
        As `source` in a configuration, or `ARRAYS`.
    arrays : tuple of ndarray, or None
        Vertices (V, 3) float64 and faces (F, 3) int64, unless the mesh is in a file.
    """

    text: str
    arrays: tuple | None = None

    @property
    def name(self):
        """The name of the mesh in a configuration: that of its file, in permitted characters."""
        text = self.text.removeprefix(SHIPPED).removeprefix(ANALYTIC)
        name = re.sub(r"[^a-z0-9_-]", "-", stem_of(text).lower())
        if not re.match("[a-z]", name) or name in RESERVED_NAMES:
            name = f"mesh-{name}"
        return name


def source_of(mesh):
    """Return the `Source` of a mesh.

    Parameters
    ----------
    mesh : path-like, pair of arrays, or object
        A path may also be ``pymeshlab:NAME`` or ``analytic:NAME``. An object has ``vertices`` and
        ``faces`` (trimesh) or ``triangles`` (Open3D), or ``points`` and ``faces`` (PyVista) or
        ``cells`` (meshio).

    Raises
    ------
    PandisError
        It is none of these, the file is missing or empty, or the arrays are no triangle mesh.
    """
    if isinstance(mesh, str | PathLike):
        return _file(str(mesh))
    vertices, faces = _arrays(mesh)
    try:
        if np.iscomplexobj(vertices):
            raise TypeError("complex coordinates")
        vertices = np.array(vertices, np.float64)
        faces = np.array(faces)
    except (TypeError, ValueError) as error:
        raise PandisError(f"this is no mesh ({error}): {_EXPECTED}") from None
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise PandisError(f"vertices must have the shape (V, 3), not {vertices.shape}")
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise PandisError(
            f"faces must have the shape (F, 3), not {faces.shape}: triangulate the mesh"
        )
    if faces.size and not (np.issubdtype(faces.dtype, np.integer) and faces.min() >= 0):
        raise PandisError("faces must be integers from 0")
    if faces.size and faces.max() >= len(vertices):
        raise PandisError(
            f"a face refers to vertex {faces.max()}, but there are {len(vertices)} vertices"
        )
    return Source(ARRAYS, (vertices, faces.astype(np.int64)))


def _file(text):
    if url_extension(text):
        raise PandisError(f"{text}: download the mesh first, or list it in a configuration")
    if Path(text).is_dir():
        raise PandisError(
            f"{text} is a folder: name its files, or label all of them with "
            f"`pandis labels {text} -o NAME.zarr`"
        )
    fault = source_fault(text)
    if fault:
        raise PandisError(fault.removeprefix("source: "))
    return Source(text)


def _arrays(mesh):
    """Return the vertices and faces of a pair or an object."""
    if isinstance(mesh, tuple | list) and len(mesh) == 2:
        return mesh
    if hasattr(mesh, "vertices"):
        faces = getattr(mesh, "faces", getattr(mesh, "triangles", None))
        if faces is not None:
            return mesh.vertices, faces
    if hasattr(mesh, "points") and hasattr(mesh, "cells_dict"):
        return mesh.points, _only_triangles(mesh.cells_dict)
    if hasattr(mesh, "points") and hasattr(mesh, "faces"):
        return mesh.points, _unpadded(np.asarray(mesh.faces))
    scene = "; a scene has several: pass scene.to_mesh()" if hasattr(mesh, "geometry") else ""
    raise PandisError(f"{type(mesh).__name__} is no mesh{scene}: {_EXPECTED}")


def _only_triangles(cells):
    """Return the triangles of meshio's cells; points and lines are ignored."""
    surface = {kind for kind in cells if kind not in ("vertex", "line")}
    if surface != {"triangle"}:
        names = ", ".join(sorted(surface)) or "no faces"
        raise PandisError(f"the mesh has {names}; only triangles have a signed distance here")
    return cells["triangle"]


def _unpadded(faces):
    """Return the faces of PyVista's flat array, in which the number of corners precedes them."""
    if faces.ndim == 2:
        return faces
    if len(faces) % 4 or (faces[::4] != 3).any():
        raise PandisError("the mesh has polygons: call its triangulate() first")
    return faces.reshape(-1, 4)[:, 1:]
