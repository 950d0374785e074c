"""Storage of results: one deterministic ``*.zarr.zip`` file, written atomically, checked on read.

The file is a zarr 3 group packed as an uncompressed zip (the chunks are
compressed by zarr's Blosc codec), so any zarr reader opens it
with ``zarr.open_group(zarr.storage.ZipStore(path, mode="r"))``. On top of zarr:

- entries have a fixed order, timestamps and modes, so the same content gives the same bytes;
- the zip comment is the SHA-256 of everything before it, so that no flipped
  bit, not even in an unused header field, goes unnoticed;
- the group's attributes contain the kind of artifact, the digest of every array
  and the provenance (see `pandis.pipeline.run.job.provenance`).
"""

import hashlib
import json
import os
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pandis.base.errors import ArtifactError
from pandis.base.files import AtomicFile

SCHEMA = 1
_STAMP = (1980, 1, 1, 0, 0, 0)
_MARK = b"sha256:"
_COMMENT = len(_MARK) + 64
_CHUNK_BYTES = 1 << 22


@dataclass(frozen=True)
class Artifact:
    """A result: in memory, or read from a file that passed all checks.

    Attributes
    ----------
    kind : str
        ``mesh``, ``samples``, ``model``, ``grid``, …
    arrays : dict of str to ndarray
    attributes : dict
        Everything that the stage stores besides the arrays.
    path : Path or None
        The file; None in memory.
    provenance : dict
        Options, code, inputs and versions that made the artifact; empty in memory.
    digest : str
        SHA-256 of kind, arrays and attributes; provenance excluded. Empty in memory.
    """

    kind: str
    arrays: dict
    attributes: dict
    path: Path | None = None
    provenance: dict = field(default_factory=dict)
    digest: str = ""


def array_digest(name, array):
    """Return the SHA-256 of an array: name, dtype, shape and little-endian C-order bytes."""
    shape = np.shape(array)
    array = np.ascontiguousarray(array)
    array = array.astype(array.dtype.newbyteorder("<"), copy=False)
    head = f"{name}\0{array.dtype.str}\0{shape}\0".encode()
    digest = hashlib.sha256(head)
    digest.update(array.reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


def content_digest(kind, digests, attributes):
    """Return the SHA-256 that identifies an artifact's content, independent of provenance."""
    text = json.dumps([SCHEMA, kind, digests, attributes], sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def write_artifact(path, kind, arrays, *, attributes, provenance, chunks=None):
    """Write an artifact; it appears under ``path`` only once it is complete and on disk.

    Parameters
    ----------
    path : path-like
        Ends in ``.zarr.zip``.
    kind : str
    arrays : mapping of str to ndarray
    attributes : dict
        JSON values without NaN; numpy scalars and arrays are converted.
    provenance : dict
        From `pandis.pipeline.run.job.provenance.provenance`.
    chunks : mapping of str to tuple of int, optional
        Chunk shapes of arrays that differ from the default (4 MB along the first axis).

    Returns
    -------
    str
        The content digest.

    Raises
    ------
    PandisError
        The disk is full or the folder is not writable. No partial file is left.
    """
    with ArtifactWriter(path, kind) as writer:
        for name in sorted(arrays):
            array = np.asarray(arrays[name])
            writer.declare(name, array.shape, array.dtype, chunks=(chunks or {}).get(name))
            writer.append(name, array)
        return writer.finish(attributes, provenance)


class ArtifactWriter:
    """Writes an artifact piece by piece, so that no array has to fit in memory.

    Use it as ``with ArtifactWriter(path, kind) as writer:``. Call `declare` and `append` for every
    array, then `finish`; without `finish` no file is left. Raises the errors of `write_artifact`.
    """

    def __init__(self, path, kind):
        self.path, self.kind = Path(path), kind
        self._arrays = {}

    def __enter__(self):
        import zarr
        from zarr.storage import MemoryStore

        self._store = MemoryStore()
        self._group = zarr.create_group(self._store, zarr_format=3)
        self._file = AtomicFile(self.path)
        self._zip = zipfile.ZipFile(self._file.open(), "w", zipfile.ZIP_STORED)
        return self

    def __exit__(self, kind, error, traceback):
        self._zip.close = lambda: None  # an unfinished zip needs no directory
        self._file.discard()
        if isinstance(error, OSError):
            raise self._file.explain(error) from error

    def declare(self, name, shape, dtype, *, chunks=None, fill=0, level=5):
        """Declare an array. Chunks that contain only ``fill`` are not stored.

        ``level`` is zstd's, from 1 (fast) to 9 (small).
        """
        from zarr.codecs import BloscCodec

        shape, dtype = tuple(shape), np.dtype(dtype).newbyteorder("<")
        row = dtype.itemsize * int(np.prod(shape[1:]))
        rows = max(1, _CHUNK_BYTES // max(1, row))
        chunks = chunks or (min(rows, shape[0]) if shape else 1, *shape[1:])
        stored = self._group.create_array(
            name,
            shape=shape,
            dtype=dtype,
            chunks=tuple(max(1, n) for n in chunks[: len(shape)]),
            # shuffling bytes makes smooth fields a fifth smaller
            compressors=[BloscCodec(cname="zstd", clevel=level, shuffle="shuffle")],
            fill_value=fill,
        )
        digest = hashlib.sha256(f"{name}\0{dtype.str}\0{shape}\0".encode())
        self._arrays[name] = _Growing(stored, digest)

    def append(self, name, rows):
        """Add the next rows (along the first axis) of an array."""
        growing = self._arrays[name]
        rows = np.ascontiguousarray(rows, growing.stored.dtype)
        growing.digest.update(rows.reshape(-1).view(np.uint8).data)
        if not growing.stored.shape:
            growing.stored[...] = rows.reshape(())
            growing.done = growing.total
            return self._drain()
        growing.waiting.append(rows)
        step = growing.stored.chunks[0]
        waiting = sum(map(len, growing.waiting))
        last = growing.done + waiting == growing.total
        if waiting < step and not last:
            return None
        rows = growing.waiting[0] if len(growing.waiting) == 1 else np.concatenate(growing.waiting)
        whole = len(rows) if last else len(rows) // step * step
        # a call of zarr takes milliseconds, so small chunks are written several at a time
        batch = max(step, _CHUNK_BYTES // max(1, rows.nbytes // max(1, len(rows))) // step * step)
        for start in range(0, whole, batch):
            stop = min(start + batch, whole)
            growing.stored[growing.done + start : growing.done + stop] = rows[start:stop]
            self._drain()
        growing.waiting = [rows[whole:].copy()] if whole < len(rows) else []
        growing.done += whole
        return None

    def finish(self, attributes, provenance):
        """Complete the artifact and move it into place; return its content digest."""
        for name, growing in self._arrays.items():
            if growing.done != growing.total:
                raise ValueError(f"{name}: {growing.done} of {growing.total} rows were written")
        attributes = _jsonable(attributes)
        digests = {name: self._arrays[name].digest.hexdigest() for name in sorted(self._arrays)}
        digest = content_digest(self.kind, digests, attributes)
        self._group.update_attributes(
            {
                "kind": self.kind,
                "schema": SCHEMA,
                "content": {"digest": digest, "arrays": digests},
                "attributes": attributes,
                "provenance": _jsonable(provenance),
            }
        )
        self._drain(metadata=True)
        self._zip.comment = b" " * _COMMENT
        self._zip.close()
        _seal(self._file.stream)
        self._file.keep()
        return digest

    def _drain(self, metadata=False):
        """Move the entries that zarr has encoded from the memory store into the zip file."""
        entries = self._store._store_dict
        keys = (k for k in entries if metadata or not k.endswith("zarr.json"))
        for key in sorted(keys, key=_in_order):
            info = zipfile.ZipInfo(key, _STAMP)
            info.create_system = 3
            info.external_attr = 0o644 << 16
            self._zip.writestr(info, entries.pop(key).to_bytes())


def _in_order(key):
    """Return a sort key: chunks by their first index, and all else by name."""
    first = key.partition("/c/")[2].partition("/")[0]
    return int(first) if first.isdecimal() else 0, key


class _Growing:
    """An array that is being written row by row."""

    def __init__(self, stored, digest):
        self.stored, self.digest = stored, digest
        self.waiting, self.done = [], 0
        self.total = stored.shape[0] if stored.shape else 1


def _seal(stream):
    """Replace the comment at the end of a zip file with the checksum of everything before it."""
    stream.flush()
    left = stream.seek(0, os.SEEK_END) - _COMMENT
    stream.seek(0)
    digest = hashlib.sha256()
    while left:
        block = stream.read(min(left, 1 << 20))
        digest.update(block)
        left -= len(block)
    stream.seek(-_COMMENT, os.SEEK_END)
    stream.write(_MARK + digest.hexdigest().encode())


def read_artifact(path, kind=None):
    """Read an artifact and check it completely.

    Parameters
    ----------
    path : path-like
    kind : str, optional
        Required kind.

    Raises
    ------
    ArtifactError
        The file is missing, truncated or damaged, or has another kind or schema.
    """
    path = Path(path)
    check_seal(path)
    try:
        root, read = _decode(path)
        stored_kind, schema = root["kind"], root["schema"]
        digests, recorded = root["content"]["arrays"], root["content"]["digest"]
        attributes, provenance = root["attributes"], root["provenance"]
    except Exception as error:
        raise _damaged(path, f"not readable as zarr ({type(error).__name__}: {error})") from error
    if schema != SCHEMA:
        raise _damaged(path, f"has schema {schema}, but this version of pandis reads {SCHEMA}")
    if kind is not None and stored_kind != kind:
        raise ArtifactError(f"{path}: its kind is {stored_kind}, expected {kind}")
    wrong = [n for n in digests if n not in read or array_digest(n, read[n]) != digests[n]]
    if wrong:
        raise _damaged(path, f"array {', '.join(wrong)} differs from its digest")
    if content_digest(stored_kind, digests, attributes) != recorded:
        raise _damaged(path, "its attributes differ from their digest")
    return Artifact(
        stored_kind, read, attributes, path=path, provenance=provenance, digest=recorded
    )


def _damaged(path, what):
    return ArtifactError(f"{path}: {what}; rebuild it with: snakemake -j2 -R {path}")


def seal_zip(data):
    """Return the bytes of a zip file without a comment, sealed in the same way as an artifact."""
    sealed = data[:-2] + _COMMENT.to_bytes(2, "little")
    return sealed + _MARK + hashlib.sha256(sealed).hexdigest().encode()


def check_seal(path):
    """Refuse a zip file whose comment is not the checksum of everything before it.

    Raises
    ------
    ArtifactError
        The file is missing or damaged.
    """
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
