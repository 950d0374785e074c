"""Finds, unpacks and reads the mesh file of a source."""

import gzip
import tempfile
import zlib
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from pandis.base.errors import PandisError
from pandis.base.files import file_digest
from pandis.pipeline.mesh import tools
from pandis.pipeline.mesh.formats import FormatError
from pandis.pipeline.mesh.processes import LimitError, MissingError, ToolError
from pandis.pipeline.mesh.topology import used_vertices
from pandis.pipeline.run.ask.sourcing import FORMATS, format_of, source_path

#: Largest size of an unpacked file, in bytes.
_LARGEST = 16 << 30


def find_file(source):
    """Return the path of a file source, given as a path or as ``pymeshlab:NAME``.

    Raises
    ------
    PandisError
        There is no such file, or it is empty.
    """
    path = source_path(source)
    if path.stat().st_size == 0:
        raise PandisError(f"{source}: the file is empty; export the mesh again")
    return path


def read_mesh(source, path, sha256=None, *, seconds=120.0, memory_gb=3.0):
    """Read a mesh file.

    Parameters
    ----------
    source : str
        The user's name for the file, used in messages.
    path : Path
    sha256 : str, optional
        Expected digest of the file.
    seconds, memory_gb : float
        Limits on the reader's time (s) and memory (GB).

    Returns
    -------
    reading : pandis.pipeline.mesh.formats.Reading
        In mesh units.
    record : dict
        ``format``, ``sha256`` and ``notes`` of the file.

    Raises
    ------
    PandisError
        The digest differs, the format is unknown, or the file is faulty (the message locates it).
    """
    digest = file_digest(path)
    if sha256 and digest != sha256.lower():
        raise PandisError(
            f"{source}: the file's sha256 is {digest}, but the configuration says "
            f"{sha256.lower()}; the file changed or the download failed: fetch it again, or "
            "correct sha256"
        )
    form = format_of(path)
    if form not in FORMATS:
        raise PandisError(
            f"{source}: unknown format '.{form}'; the known formats are "
            + ", ".join(f".{known}" for known in FORMATS)
            + ", each also as .gz; convert the mesh to one of them"
        )
    limits = {"seconds": seconds, "memory_gb": memory_gb}
    try:
        with unpacked(source, path) as plain:
            reading = tools.read(plain.resolve(), form, path.resolve().parent, **limits)
        check_arrays(reading.vertices, reading.faces)
    except FormatError as error:
        raise PandisError(f"{source}: {error}") from None
    except LimitError as error:
        key = "reader_seconds" if "longer" in str(error) else "reader_memory_gb"
        raise PandisError(f"{source}: reading it {error}; raise mesh.{key}") from None
    except MissingError as error:
        raise PandisError(
            f"{source}: its reader needs a package: {error}; pip install 'pandis-fields[make]'"
        ) from None
    except ToolError as error:
        raise PandisError(
            f"{source}: its reader failed: {error}; this is a defect of pandis: please report it "
            "and attach the file"
        ) from None
    return reading, {"format": form, "sha256": digest, "notes": list(reading.notes)}


@contextmanager
def unpacked(source, path):
    """Yield a file's path. A gzip file yields a copy, unpacked until the ``with`` block ends.

    Raises
    ------
    PandisError
        The gzip file is incomplete, or too large when unpacked.
    """
    if path.suffix.lower() != ".gz":
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder) / path.stem
        try:
            with gzip.open(path) as stream, plain.open("wb") as target:
                while block := stream.read(1 << 24):
                    if target.tell() > _LARGEST:
                        raise PandisError(
                            f"{source}: it is larger than {_LARGEST >> 30} GB when unpacked"
                        )
                    target.write(block)
        except (OSError, EOFError, zlib.error) as error:
            raise PandisError(f"{source}: it is not a complete gzip file ({error})") from error
        yield plain


def check_arrays(vertices, faces):
    """Raise FormatError unless the mesh has faces, finite vertices and a usable extent."""
    if not len(faces):
        raise FormatError("it has no faces; export it as a triangle mesh")
    used = vertices[used_vertices(faces)]
    bad = int((~np.isfinite(used)).any(axis=1).sum())
    if bad:
        raise FormatError(
            f"{bad} of {len(used)} vertices are NaN or infinite; correct them and export it again"
        )
    with np.errstate(over="ignore"):
        extent = np.ptp(used, axis=0)
    if not np.isfinite(extent).all() or not 1e-150 < extent.max() < 1e150:
        raise FormatError(f"its extent is {extent.max():g}, which is too small or too large")
