"""The store of a data set, as training code reads it: chunks of rows, solids and fields by name."""

from os import PathLike
from pathlib import Path

import numpy as np

from pandis.base.errors import PandisError
from pandis.base.streams import generator
from pandis.pipeline.dataset.reading import FILES, MESH, ROWS, Shard, read_record
from pandis.pipeline.geometry.strata import STRATA
from pandis.pipeline.run.records.dataset import DatasetRecord
from pandis.runtime.field import NativeField


class LabelStore:
    """Points with exact labels, of many meshes.

    As a sequence it has the chunks of all meshes: each item is a dict of arrays (`columns`), whose
    rows are a random sample of one mesh. It can be passed to ``torch.utils.data.DataLoader`` with
    ``batch_size=None``.

    Parameters
    ----------
    path : path-like
        The folder of a data set.
    columns : sequence of str
        ``points`` (n, 3) and ``normal`` (n, 3), float32; ``distance`` (n,), float32, negative
        inside; ``stratum`` (n,), an index into `strata`; ``doubt`` (n,), bits: 1, two points of the
        surface are closest; 2, the noise moved the point farther than the wall below it is thick.

    Attributes
    ----------
    names : list of str
        Meshes that have rows.
    facts : dict of str to pandis.pipeline.run.records.dataset.MeshFacts
        What is known of each mesh: source, repair, deviation, frame, licence, …
    failed : dict of str to pandis.pipeline.run.records.dataset.Failure
        ``stage``, ``reason`` and ``option`` of each mesh that came to nothing.
    summary : pandis.pipeline.run.records.dataset.Summary
    strata : tuple of str

    Raises
    ------
    PandisError
        This is no store, or it is damaged.
    """

    strata = STRATA

    def __init__(
        self, path: str | PathLike[str], columns: tuple[str, ...] = ("points", "distance")
    ) -> None:
        self.path, self.columns = Path(path), tuple(columns)
        unknown = ", ".join(sorted(set(self.columns) - set(ROWS)))
        if isinstance(columns, str) or not self.columns or unknown:
            raise PandisError(
                f"columns: a tuple of some of {', '.join(ROWS)} is needed, not {columns!r}"
            )
        index = self.path / "index.zarr.zip"
        if not index.is_file():
            raise PandisError(f"{path}: there is no index.zarr.zip: this is no finished data set")
        record, _ = read_record(index, DatasetRecord)
        self.chunk, self.summary, self._digests = record.chunk, record.summary, record.shards
        self.facts = {mesh.name: mesh for mesh in record.meshes if not mesh.failed}
        self.failed = {mesh.name: mesh.failed for mesh in record.meshes if mesh.failed}
        self.names = list(self.facts)
        counts = [-(-mesh.rows // self.chunk) for mesh in self.facts.values()]
        self._ends = np.cumsum(counts)
        self._shards = {}

    def __len__(self) -> int:
        return int(self._ends[-1]) if len(self._ends) else 0

    def __getitem__(self, number: int) -> dict[str, np.ndarray]:
        if not 0 <= number < len(self):
            raise IndexError(number)
        mesh = int(np.searchsorted(self._ends, number, side="right"))
        first = int(self._ends[mesh - 1]) if mesh else 0
        return self.rows(self.names[mesh], number - first)

    def rows(self, name: str, chunk: int | None = None) -> dict[str, np.ndarray]:
        """Return one chunk of a mesh's rows, unit frame; all of them without ``chunk``."""
        shard, index = self._place(name)
        if chunk is None:
            return shard.part(index, self.columns)
        if not 0 <= chunk < -(-self.facts[name].rows // self.chunk):
            raise IndexError(f"{name} has no chunk {chunk}")
        start = chunk * self.chunk
        return shard.part(index, self.columns, start=start, stop=start + self.chunk)

    def draw(self, name: str, seed: int = 0) -> dict[str, np.ndarray]:
        """Return a chunk of a mesh's rows that the seed chooses: a random sample of them."""
        self._place(name)
        if seed < 0:
            raise PandisError(f"the seed must be at least 0, not {seed}")
        chunks = -(-self.facts[name].rows // self.chunk)
        return self.rows(name, int(generator(seed).integers(chunks)))

    def mesh(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return vertices (V, 3), mesh units, and faces (F, 3) of the solid that was labelled."""
        shard, index = self._place(name)
        return tuple(shard.part(index, [part])[part] for part in MESH)

    def field(self, name: str, kind: str) -> NativeField:
        """Return a field of a mesh, one of the kinds that the data set names as `fields`.

        Raises
        ------
        PandisError
            The store has no field of this kind, or it could not be built of this mesh:
            ``facts[name].files`` has those that were, ``facts[name].unbuilt`` why others were not.
        """
        return NativeField(self.file(name, kind))

    def file(self, name: str, kind: str) -> bytes:
        """Return the ``.pandis`` file of a field of a mesh: see `field`."""
        shard, index = self._place(name)
        files = self.facts[name].files
        if kind not in files:
            there = ", ".join(files) or "no fields"
            why = self.facts[name].unbuilt.get(kind, "add it to `fields` of the data set")
            raise PandisError(f"{self.path} has {there} of {name}, not {kind}: {why}")
        start = sum(size for other, size in files.items() if other < kind)  # sorted by name
        return shard.part(index, FILES, start=start, stop=start + files[kind])["files"].tobytes()

    def frame(self, name: str) -> tuple[np.ndarray, float]:
        """Return centre and scale: ``(x - centre) * scale`` is in the unit frame."""
        return np.array(self.facts[name].centre), self.facts[name].scale

    def export(
        self, layout: str, folder: str | PathLike[str], seed: int = 0, **points: int
    ) -> list[Path]:
        """Write all meshes in a layout that others read, and return the files.

        Parameters
        ----------
        layout : {"vecset", "hunyuan", "dora", "npz", "webdataset", "zarr", "pandis"}
            That of 3DShape2VecSet, Hunyuan3D-2.1 or Dora, whose points are drawn anew; or the
            stored rows, in a file for each mesh, a tar for each shard, or one zarr group; or the
            fields, in files for ``pandis.h``.
        folder : path-like
        seed : int
        **points
            Numbers of points drawn for each mesh: ``volume``, ``near``, ``surface``, ``sharp``.
        """
        from pandis.pipeline.dataset.layouts import Points, write_layout

        unknown = sorted(set(points) - set(Points._fields))
        if unknown:
            raise PandisError(f"{unknown[0]}: there are points of {', '.join(Points._fields)}")
        whole = LabelStore(self.path, tuple(ROWS))
        return write_layout(whole, layout, folder, points=Points(**points), seed=seed)

    def _place(self, name):
        if name not in self.facts:
            why = f": {self.failed[name].reason}" if name in self.failed else ""
            raise PandisError(f"{self.path}: there are no rows of {name}{why}")
        number, index = self.facts[name].shard
        if number not in self._shards:
            shard = Shard(self.path / f"shards/{number:05}.zarr.zip")
            if shard.digest != self._digests[number]:
                raise PandisError(
                    f"{shard.path} is newer than the index: the store is being rebuilt, or that "
                    "was stopped; run the same command again"
                )
            self._shards[number] = shard
        return self._shards[number], index
