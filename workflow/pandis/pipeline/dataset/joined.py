"""Writes all rows of a store as one zarr 3 group with sharded arrays, which any zarr opens."""

import errno
import secrets
import shutil
from contextlib import suppress

import numpy as np

from pandis.base.errors import PandisError
from pandis.base.files import AtomicFile
from pandis.pipeline.dataset.reading import MESH, ROWS

#: Rows in a file of an array, where chunks are smaller.
_ROWS_PER_FILE = 1 << 20


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
    store : pandis.pipeline.dataset.store.LabelStore
        With all its columns.
    folder : Path
        New, or empty.
    log : pandis.base.progress.Log

    Raises
    ------
    PandisError
        The folder contains something, or cannot be written. Nothing is left behind.
    """
    is_new = not folder.exists()
    if not is_new and (not folder.is_dir() or any(folder.iterdir())):
        raise _used(folder)
    part, moved = folder / f".{secrets.token_hex(8)}", []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _write(store, part, log)
        for path in sorted(part.iterdir()):  # zarr.json, without which there is no group, is last
            path.rename(folder / path.name)
            moved.append(folder / path.name)
        moved = []
    except OSError as error:
        if error.errno in (errno.ENOTEMPTY, errno.EEXIST):  # of two at once, the first one writes
            raise _used(folder) from None
        raise AtomicFile(folder).explain(error) from error
    finally:
        for path in (part, *moved):
            shutil.rmtree(path, ignore_errors=True)
        if is_new:
            with suppress(OSError):
                folder.rmdir()
    return sorted(path for path in folder.rglob("*") if path.is_file())


def _used(folder):
    return PandisError(f"{folder}: it is no empty folder; name a new one")


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
                shards=(max(1, _ROWS_PER_FILE // store.chunk) * store.chunk, *shape),
            )
        )
    for name in store.names:
        vertices, faces = store.mesh(name)
        parts = store.rows(name) | {"vertices": vertices, "faces": faces}
        for column, rows in columns.items():
            rows.append(parts[column])
        log(name)
