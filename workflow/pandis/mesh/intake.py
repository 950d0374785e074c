"""Reading a mesh from wherever the user has it."""

import gzip
import shutil
import tempfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from pandis.artifact import file_digest
from pandis.errors import PandisError
from pandis.mesh import tools

FORMATS = ("obj", "ply", "stl", "off", "glb", "gltf", "3mf")
READERS = ("trimesh", "pymeshlab")


def find_file(source):
    """Return the path of a source that is a file: a path, or ``pymeshlab:NAME``.

    Raises
    ------
    PandisError
        There is no such file, or it is empty.
    """
    if source.startswith("pymeshlab:"):
        name = source.removeprefix("pymeshlab:")
        spec = find_spec("pymeshlab")
        if spec is None:
            raise PandisError(f"source: '{source}' needs PyMeshLab: pip install pymeshlab")
        folder = Path(spec.submodule_search_locations[0]) / "tests" / "sample_meshes"
        path = folder / name
        if not path.is_file():
            known = ", ".join(sorted(f.name for f in folder.glob("*.*")))
            raise PandisError(f"source: PyMeshLab ships no '{name}'; it has {known}")
    else:
        path = Path(source)
        if not path.is_file():
            raise PandisError(
                f"source: there is no file '{source}' (looked in {Path.cwd()}); correct the path "
                "or put the file there"
            )
    if path.stat().st_size == 0:
        raise PandisError(f"{source}: the file is empty; export the mesh again")
    return path


def read_mesh(source, path, sha256=None, seconds=120.0, memory_gb=3.0):
    """Read a mesh file with the first reader that makes sense of it.

    Parameters
    ----------
    source : str
        What the user calls it; used in messages.
    path : Path
    sha256 : str, optional
        What the file's digest must be.
    seconds, memory_gb : float
        Limits of each reader.

    Returns
    -------
    vertices : ndarray, shape (V, 3), float64, mesh units
    faces : ndarray, shape (F, 3), int64
    record : dict
        Reader, format, digest of the file, and why other readers were passed over.

    Raises
    ------
    PandisError
        Wrong digest, unknown format, or no reader finds a usable mesh.
    """
    digest = file_digest(path)
    if sha256 and digest != sha256.lower():
        raise PandisError(
            f"{source}: the file's sha256 is {digest}, the configuration says {sha256.lower()}; "
            "the file changed or the download broke: fetch it again, or correct sha256"
        )
    suffixes = [s.lower().removeprefix(".") for s in path.suffixes]
    packed = suffixes[-1:] == ["gz"]
    ending = suffixes[-2 if packed else -1] if len(suffixes) > packed else ""
    if ending not in FORMATS:
        raise PandisError(
            f"{source}: unknown format '.{ending}'; known are "
            + ", ".join(f".{known}" for known in FORMATS)
            + ", each also as .gz; convert the mesh to one of them"
        )
    complaints = {}
    with tempfile.TemporaryDirectory() as folder:
        if packed:
            plain = Path(folder) / path.stem
            try:
                with gzip.open(path) as stream, plain.open("wb") as unpacked:
                    shutil.copyfileobj(stream, unpacked)
            except (OSError, EOFError) as error:
                raise PandisError(f"{source}: not a whole gzip file ({error})") from error
            path = plain
        for reader in READERS:
            try:
                found = tools.call(f"read_{reader}", path, seconds=seconds, memory_gb=memory_gb)
                check_arrays(*found)
            except BadMesh as error:
                # no second opinion: PyMeshLab would drop such vertices and their faces in silence
                raise PandisError(f"{source}: {error}; correct them and export it again") from None
            except tools.ToolError as error:
                complaints[reader] = str(error)
                continue
            record = {"reader": reader, "format": ending, "sha256": digest}
            return *found, record | {"passed_over": complaints}
    raise PandisError(
        f"{source}: no reader finds a usable mesh in it ("
        + "; ".join(f"{reader}: {complaint}" for reader, complaint in complaints.items())
        + "); open it in a mesh editor and export it again as a triangle mesh with finite "
        "coordinates"
    )


class BadMesh(tools.ToolError):
    """The fault lies in the file, not in its reader."""


def check_arrays(vertices, faces):
    """Raise ToolError unless the arrays are a mesh: faces, finite, of some extent."""
    if not len(faces):
        raise tools.ToolError("no faces")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise tools.ToolError("a face names a vertex that is not there")
    used = vertices[np.unique(faces)]
    bad = int((~np.isfinite(used)).any(axis=1).sum())
    if bad:
        raise BadMesh(f"{bad} of {len(used)} vertices are NaN or infinite")
    with np.errstate(over="ignore"):
        extent = np.ptp(used, axis=0)
    if not np.isfinite(extent).all() or not 1e-150 < extent.max() < 1e150:
        raise tools.ToolError(f"its extent is {extent.max():g}: too small or too large")
