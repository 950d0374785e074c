"""How a result is stored: one deterministic ``*.zarr.zip`` file, atomic, checked on read.

The file is a zarr 3 group packed as an uncompressed zip (each chunk is
compressed and checksummed by zarr's zstd codec), so any zarr reader opens it
with ``zarr.open_group(zarr.storage.ZipStore(path, mode="r"))``. On top of zarr:

- entries are sorted, with fixed stamps and modes: same content, same bytes;
- the zip comment is the SHA-256 of everything before it, so that no flipped
  bit, not even in an unused header field, goes unnoticed;
- the group's attributes name the kind of artifact, the digest of every array
  and the provenance (see `pandis.provenance`).
"""

import errno
import hashlib
import io
import json
import os
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pandis.errors import ArtifactError, PandisError

SCHEMA = 1
_STAMP = (1980, 1, 1, 0, 0, 0)
_MARK = b"sha256:"
_COMMENT = len(_MARK) + 64
_CHUNK_BYTES = 1 << 22


@dataclass(frozen=True)
class Artifact:
    """A result that was read and found whole.

    Attributes
    ----------
    path : Path
    kind : str
        ``mesh``, ``samples``, ``model``, ``grid``, …
    arrays : dict of str to ndarray
    attributes : dict
        Everything the stage had to say beside the arrays.
    provenance : dict
        Why the artifact is current: options, code, inputs, versions.
    digest : str
        SHA-256 of kind, arrays and attributes; provenance excluded.
    """

    path: Path
    kind: str
    arrays: dict
    attributes: dict
    provenance: dict
    digest: str


def array_digest(name, array):
    """Return the SHA-256 of an array: name, dtype, shape and little-endian C-order bytes."""
    array = np.ascontiguousarray(array)
    array = array.astype(array.dtype.newbyteorder("<"), copy=False)
    head = f"{name}\0{array.dtype.str}\0{array.shape}\0".encode()
    digest = hashlib.sha256(head)
    digest.update(array.reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


def content_digest(kind, digests, attributes):
    """Return the SHA-256 that identifies an artifact's content, whatever made it."""
    text = json.dumps([SCHEMA, kind, digests, attributes], sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def write_artifact(path, kind, arrays, attributes, provenance, chunks=None):
    """Write an artifact; it exists under ``path`` only once it is whole and on disk.

    Parameters
    ----------
    path : path-like
        Ends in ``.zarr.zip``.
    kind : str
    arrays : mapping of str to ndarray
    attributes : dict
        JSON values without NaN; numpy scalars and arrays are converted.
    provenance : dict
        From `pandis.provenance.provenance`.
    chunks : mapping of str to tuple of int, optional
        Chunk shape of the arrays that do not want the default (4 MB along the first axis).

    Returns
    -------
    str
        The content digest.

    Raises
    ------
    PandisError
        The disk is full or the folder cannot be written. No partial file is left.
    """
    arrays = {name: np.asarray(array) for name, array in arrays.items()}
    attributes = _jsonable(attributes)
    digests = {name: array_digest(name, arrays[name]) for name in sorted(arrays)}
    digest = content_digest(kind, digests, attributes)
    root = {
        "kind": kind,
        "schema": SCHEMA,
        "content": {"digest": digest, "arrays": digests},
        "attributes": attributes,
        "provenance": _jsonable(provenance),
    }
    data = _pack(_encode(arrays, root, chunks or {}))
    write_atomically(path, data)
    return digest


def write_atomically(path, data):
    """Put ``data`` (bytes) under ``path`` in one step: all of it, or nothing.

    Raises
    ------
    PandisError
        The disk is full or the folder cannot be written.
    """
    path = Path(path)
    part = path.with_name(f".{path.name}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with part.open("wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        if part.stat().st_size != len(data):
            raise OSError(errno.EIO, "short write")
        part.replace(path)
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except OSError as error:
        part.unlink(missing_ok=True)
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        raise PandisError(
            f"{path}: cannot write: {error.strerror or error}; "
            + ("free some space" if full else "check the folder's permissions")
            + " and run the same command again"
        ) from error


def read_artifact(path, kind=None):
    """Read an artifact and check all of it.

    Parameters
    ----------
    path : path-like
    kind : str, optional
        What it must be.

    Raises
    ------
    ArtifactError
        Missing, truncated, damaged, or of another kind or schema.
    """
    path = Path(path)
    _check_file(path)
    try:
        root, read = _decode(path)
        found, schema = root["kind"], root["schema"]
        digests, recorded = root["content"]["arrays"], root["content"]["digest"]
        attributes, provenance = root["attributes"], root["provenance"]
    except Exception as error:
        raise _damaged(path, f"not readable as zarr ({type(error).__name__}: {error})") from error
    if schema != SCHEMA:
        raise _damaged(path, f"has schema {schema}, this version of pandis reads {SCHEMA}")
    if kind is not None and found != kind:
        raise ArtifactError(f"{path}: holds a {found}, expected a {kind}")
    wrong = [n for n in digests if n not in read or array_digest(n, read[n]) != digests[n]]
    if wrong:
        raise _damaged(path, f"array {', '.join(wrong)} differs from its digest")
    if content_digest(found, digests, attributes) != recorded:
        raise _damaged(path, "its attributes differ from their digest")
    return Artifact(path, found, read, attributes, provenance, recorded)


def file_digest(path):
    """Return the SHA-256 of a file."""
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _damaged(path, what):
    return ArtifactError(f"{path}: {what}; rebuild it with: snakemake -j2 -R {path}")


def _check_file(path):
    if not path.is_file():
        raise ArtifactError(f"{path}: missing; build it with: snakemake -j2 {path}")
    with path.open("rb") as stream:
        size = path.stat().st_size
        digest, left = hashlib.sha256(), max(size - _COMMENT, 0)
        while left:
            block = stream.read(min(left, 1 << 20))
            digest.update(block)
            left -= len(block)
        if stream.read() != _MARK + digest.hexdigest().encode():
            raise _damaged(path, "truncated or damaged (its checksum does not match)")


def _encode(arrays, root, chunks):
    """Return the zarr group as a dict of key to bytes."""
    import zarr
    from zarr.codecs import ZstdCodec
    from zarr.storage import MemoryStore

    store = MemoryStore()
    group = zarr.create_group(store, attributes=root, zarr_format=3)
    for name, array in arrays.items():
        rows = max(1, _CHUNK_BYTES // max(1, array[:1].nbytes)) if array.ndim else 1
        default = (min(rows, max(1, len(array))), *array.shape[1:]) if array.ndim else ()
        stored = group.create_array(
            name,
            shape=array.shape,
            dtype=array.dtype,
            chunks=chunks.get(name, tuple(max(1, n) for n in default)),
            compressors=[ZstdCodec(level=3, checksum=True)],
        )
        stored[...] = array
    return {key: value.to_bytes() for key, value in store._store_dict.items()}


def _pack(entries):
    """Zip the entries: root metadata first, then sorted; stored, with fixed stamps."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for key in sorted(entries, key=lambda key: (key != "zarr.json", key)):
            info = zipfile.ZipInfo(key, _STAMP)
            info.create_system = 3
            info.external_attr = 0o644 << 16
            archive.writestr(info, entries[key])
        archive.comment = b" " * _COMMENT
    data = buffer.getvalue()[:-_COMMENT]
    return data + _MARK + hashlib.sha256(data).hexdigest().encode()


def _decode(path):
    import zarr
    from zarr.storage import ZipStore

    store = ZipStore(path, mode="r")
    try:
        group = zarr.open_group(store, mode="r")
        root = dict(group.attrs)
        return root, {name: group[name][...] for name in root["content"]["arrays"]}
    finally:
        store.close()


def _jsonable(value):
    if isinstance(value, Mapping):
        return {str(key): _jsonable(value[key]) for key in sorted(value, key=str)}
    if isinstance(value, list | tuple | set | np.ndarray):
        return [_jsonable(v) for v in (sorted(value) if isinstance(value, set) else value)]
    if isinstance(value, np.generic):
        return value.item()
    return value
