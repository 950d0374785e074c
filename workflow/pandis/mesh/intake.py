"""Reading a mesh from wherever the user has it."""

import gzip
import shutil
import tempfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from pandis.errors import PandisError
from pandis.mesh import tools
from pandis.mesh.declared import compression, declared
from pandis.run.artifact import file_digest
from pandis.run.sourcing import FORMATS, format_of, source_path

READERS = ("trimesh", "pymeshlab", "libigl")


def find_file(source):
    """Return the path of a source that is a file: a path, or ``pymeshlab:NAME``.

    Raises
    ------
    PandisError
        There is no such file, or it is empty.
    """
    path = source_path(source)
    if path.stat().st_size == 0:
        raise PandisError(f"{source}: the file is empty; export the mesh again")
    return path


def read_mesh(source, path, sha256=None, seconds=120.0, memory_gb=3.0):
    """Read a mesh file with the first reader that finds what the file declares.

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
    ending = format_of(path)
    if ending not in FORMATS:
        raise PandisError(
            f"{source}: unknown format '.{ending}'; known are "
            + ", ".join(f".{known}" for known in FORMATS)
            + ", each also as .gz; convert the mesh to one of them"
        )
    complaints = {}
    with unpacked(source, path) as plain:
        if packing := compression(plain, ending):
            raise PandisError(
                f"{source}: its triangles are compressed with {packing}, which no "
                "reader here knows; export the scene again without compression"
            )
        says = declared(plain, ending)
        limits = {"seconds": seconds, "memory_gb": memory_gb}
        readings = {}
        for reader in readers_of(ending, says):
            try:
                mesh = tools.call(f"read_{reader}", path=str(plain.resolve()), **limits)
                check_arrays(*mesh)
            except BadMesh as error:
                # no second opinion: PyMeshLab would drop such vertices and their faces in silence
                raise PandisError(f"{source}: {error}; correct them and export it again") from None
            except tools.ToolError as error:
                complaints[reader] = str(error)
                continue
            readings[reader] = mesh
            count = len(mesh[1])
            if says is None or says.agrees(count):
                break
            complaints[reader] = f"finds {count:,} triangles, the file declares {says}"
    if not readings:
        raise PandisError(
            f"{source}: no reader finds a usable mesh in it ("
            + "; ".join(f"{reader}: {complaint}" for reader, complaint in complaints.items())
            + "); open it in a mesh editor and export it again as a triangle mesh with finite "
            "coordinates"
        )
    reader = choose(readings, says)
    record = {"reader": reader, "format": ending, "sha256": digest}
    record["declared_triangles"] = str(says) if says else None
    complaints.pop(reader, None)
    return *readings[reader], record | {"passed_over": complaints}


@contextmanager
def unpacked(source, path):
    """Give a file as it is, or, if it is a gzip file, what is in it, while the body runs.

    Raises
    ------
    PandisError
        It is not a whole gzip file.
    """
    if path.suffix.lower() != ".gz":
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder) / path.stem
        try:
            with gzip.open(path) as stream, plain.open("wb") as target:
                shutil.copyfileobj(stream, target)
        except (OSError, EOFError) as error:
            raise PandisError(f"{source}: not a whole gzip file ({error})") from error
        yield plain


def readers_of(ending, says):
    """Return the readers to try for a format, in order."""
    polygons = ["polygons"] if ending == "obj" and says and says.polygons else []
    return polygons + [
        r for r in READERS if r != "libigl" or ending in ("obj", "off", "ply", "stl")
    ]


def choose(readings, says):
    """Return the reader to believe: who agrees with the file, else with others, else has most.

    Parameters
    ----------
    readings : dict of str to (vertices, faces)
    says : Declared or None
    """
    counts = {reader: len(mesh[1]) for reader, mesh in readings.items()}
    if says is None:
        return next(iter(readings))
    votes = list(counts.values())
    return max(counts, key=lambda r: (says.agrees(counts[r]), votes.count(counts[r]), counts[r]))


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
