"""Writes all rows of a store as one zarr 3 group with sharded arrays, which any zarr opens."""

import shutil

import numpy as np

from pandis.base.errors import PandisError
from pandis.base.files import AtomicFile
from pandis.pipeline.dataset.reading import MESH, ROWS

#: Chunks in a file of an array.
_CHUNKS_PER_FILE = 64


class _Rows:
    """An array that grows along its first axis and is written a whole file at a time."""

    def __init__(self, array):
        self.array, self.done, self._waiting = array, 0, []

    def append(self, rows):
        """Add rows; write the files that are complete, or the last one."""
        self._waiting.append(rows)
        whole = sum(map(len, self._waiting))
        step = self.array.shards[0]
        if self.done + whole < self.array.shape[0]:
            whole = whole // step * step
        if not whole:
            return
        rows = np.concatenate(self._waiting)
        self.array[self.done : self.done + whole] = rows[:whole]
        self.done += whole
        self._waiting = [rows[whole:]]


def write_joined(store, folder, log):
    """Write the rows and solids of all meshes, one after the other; return the files.

    The attribute ``meshes`` gives each mesh's name, its frame, and where its ``rows``,
    ``vertices`` and ``faces`` begin and how many there are. Indices of faces count from the mesh's
    first vertex.

    Parameters
    ----------
    store : pandis.pipeline.dataset.reading.LabelStore
        With all its columns.
    folder : Path
        New, or empty.
    log : pandis.base.progress.Log

    Raises
    ------
    PandisError
        The folder contains something, or cannot be written.
    """
    if folder.is_dir() and any(folder.iterdir()):
        raise PandisError(f"{folder}: it contains something; name a new folder")
    part = folder.with_name(f".{folder.name}.part")
    try:
        shutil.rmtree(part, ignore_errors=True)
        _write(store, part, log)
        if folder.is_dir():
            folder.rmdir()
        part.rename(folder)
    except OSError as error:
        shutil.rmtree(part, ignore_errors=True)
        raise AtomicFile(folder).explain(error) from error
    return sorted(path for path in folder.rglob("*") if path.is_file())


def _write(store, path, log):
    import zarr

    meshes, ends = [], {"rows": 0, "vertices": 0, "faces": 0}
    for name in store.names:
        facts, entry = store.facts[name], {"name": name}
        for key, end in ends.items():
            count = getattr(facts, key)
            entry[key] = [end, count]
            ends[key] = end + count
        meshes.append(entry | {"centre": list(facts.centre), "scale": facts.scale})
    attributes = {"sign": "negative inside", "strata": list(store.strata), "meshes": meshes}
    group = zarr.create_group(path, zarr_format=3, attributes=attributes)
    columns = {}
    for name, (shape, kind) in (ROWS | MESH).items():
        chunk = (store.chunk, *shape)
        columns[name] = _Rows(
            group.create_array(
                name,
                shape=(ends[name if name in MESH else "rows"], *shape),
                dtype=np.dtype(kind).newbyteorder("<"),
                chunks=chunk,
                shards=(_CHUNKS_PER_FILE * store.chunk, *shape),
            )
        )
    for name in store.names:
        vertices, faces = store.mesh(name)
        parts = store.rows(name) | {"vertices": vertices, "faces": faces}
        for column, rows in columns.items():
            rows.append(parts[column])
        log(name)
