"""Reads the shards of a data set: the meshes, and parts of their arrays."""

import json
import os
import zipfile
import zlib
from pathlib import Path

import numpy as np

from pandis.base.errors import ArtifactError
from pandis.pipeline.run.job.artifact import Artifact, check_seal, content_digest
from pandis.pipeline.run.records.dataset import ShardRecord

#: Arrays with a row for each point, and those of each solid: shapes of a row, types.
ROWS = {
    "points": ((3,), np.float32),
    "distance": ((), np.float32),
    "normal": ((3,), np.float32),
    "stratum": ((), np.uint8),
    "doubt": ((), np.uint8),
}
MESH = {"vertices": ((3,), np.float64), "faces": ((3,), np.int32)}
#: Bytes of the files of a mesh's fields, one after the other, sorted by name.
FILES = {"files": ((), np.uint8)}
#: What reading a damaged zip raises; a flipped bit may stand for an unknown compression.
DAMAGED = (OSError, ValueError, KeyError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error)
#: What the array ``ranges`` counts of each mesh: start and count of each, in this order.
PARTS = ("rows", *MESH, *FILES)


def split_files(sizes, data):
    """Return the files of a mesh's fields, given their sizes by name and the array ``files``."""
    ends = np.cumsum(list(sizes.values()))[:-1]
    return dict(zip(sizes, np.split(data, ends), strict=True)) if sizes else {}


def read_record(path, record):
    """Return the record and the digest of an artifact, without reading its arrays.

    Raises
    ------
    ArtifactError
        The file is missing or damaged, or the attributes are not those of the digest.
    """
    stored = _root(path)
    try:
        content, attributes = stored["content"], stored["attributes"]
        expected = content_digest(stored["kind"], content["arrays"], attributes)
        same = content["digest"] == expected
    except (KeyError, TypeError):
        same = False
    if not same:
        raise ArtifactError(f"{path}: missing or damaged; build it again")
    return record.of(Artifact(stored["kind"], {}, attributes, path=path)), expected


def _root(path):
    """Return the attributes of the group in an artifact; empty if it cannot be read."""
    try:
        with zipfile.ZipFile(path) as packed:
            return json.loads(packed.read("zarr.json"))["attributes"]
    except DAMAGED:
        return {}


def read_provenance(path):
    """Return the provenance of an artifact, or None if there is none or it is damaged."""
    return _root(path).get("provenance")


class Shard:
    """A shard of a store: some meshes with their rows.

    Parameters
    ----------
    path : path-like
    check : bool
        Whether to compare the file with its checksum first, which reads all of it.

    Attributes
    ----------
    meshes : list of pandis.pipeline.run.records.dataset.MeshFacts
    chunk : int
        Rows that are stored together.

    Raises
    ------
    ArtifactError
        The file is missing or damaged.
    """

    def __init__(self, path, *, check=False):
        self.path, self._process = Path(path), None
        if check:
            check_seal(self.path)
        record, self.digest = read_record(self.path, ShardRecord)
        self.meshes, self.chunk = record.meshes, record.chunk

    def read(self, name, start, stop):
        """Return rows of an array."""
        try:
            return self._open()[name][start:stop]
        except DAMAGED as error:
            raise ArtifactError(f"{self.path}: damaged ({error}); build it again") from error

    def _open(self):
        """Return the arrays by name; opened anew in a forked process, which shares no position."""
        if self._process != os.getpid():
            import zarr
            from zarr.storage import ZipStore

            if read_record(self.path, ShardRecord)[1] != self.digest:  # replaced meanwhile
                raise ArtifactError(f"{self.path} was built anew: open the store again")
            group = zarr.open_group(ZipStore(self.path, mode="r"), mode="r")
            self._arrays = {name: group[name] for name in (*ROWS, *MESH, *FILES, "ranges")}
            self._ranges = self._arrays["ranges"][...].reshape(-1, len(PARTS), 2)
            self._process = os.getpid()
        return self._arrays

    def part(self, index, names, *, start=0, stop=None):
        """Return rows of arrays of one mesh: a dict by name."""
        first, count = self._range(index, next(iter(names)))
        stop = count if stop is None else min(stop, count)
        return {name: self.read(name, first + start, first + stop) for name in names}

    def arrays(self, index, *, rows=True):
        """Return all arrays of one mesh, or only those of its solid."""
        solid = {name: self.part(index, [name])[name] for name in MESH}
        if not rows:
            return solid
        return self.part(index, ROWS) | solid | self.part(index, FILES)

    def _range(self, index, name):
        self.read("ranges", 0, 0)
        return self._ranges[index, PARTS.index(name) if name in PARTS else 0].tolist()
