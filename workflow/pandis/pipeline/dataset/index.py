"""The index of a data set: every mesh, its shard and rows, and what the whole amounts to."""

import re
from collections import Counter
from pathlib import Path

import numpy as np

from pandis.pipeline.dataset.reading import Shard
from pandis.pipeline.geometry.strata import STRATA
from pandis.pipeline.run.records.dataset import Cause, DatasetRecord, Failure, Summary

#: Percentiles of the deviation that the card states.
_PERCENTILES = (50, 95, 99, 100)


def collect(paths, options, *, note=lambda path, digest: None):
    """Return the arrays and the record of a data set's index.

    Parameters
    ----------
    paths : sequence of path-like
        The shards, in order.
    options : pandis.pipeline.run.ask.tasks.DatasetTask
    note : callable
        Receives the path and the content digest of every shard.

    Returns
    -------
    arrays : dict
        ``shard`` and ``place`` (M,): the shard of each mesh and its place there; ``rows`` (M,).
    record : DatasetRecord

    Raises
    ------
    ArtifactError
        A shard is missing or damaged.
    """
    meshes, chunk, digests = [], 0, []
    for number, path in enumerate(paths):
        shard = Shard(path)
        chunk = shard.chunk
        note(path, shard.digest)
        digests.append(shard.digest)
        meshes += [mesh.model_copy(update={"shard": [number, place]})
                   for place, mesh in enumerate(shard.meshes)]  # fmt: skip
    meshes.sort(key=lambda mesh: mesh.name)
    record = DatasetRecord(
        dataset=options.dataset,
        source=options.source,
        shards=digests,
        meshes=meshes,
        summary=_summary(meshes),
        strata=STRATA,
        chunk=chunk,
    )
    places = np.array([mesh.shard for mesh in meshes], np.int32).reshape(-1, 2)
    rows = np.array([mesh.rows for mesh in meshes], np.int64)
    return {"shard": places[:, 0], "place": places[:, 1], "rows": rows}, record


def _summary(meshes):
    ready = [mesh for mesh in meshes if not mesh.failed]
    failed = [mesh for mesh in meshes if mesh.failed]
    faults, kinds = Counter(), Counter()
    for mesh in ready:
        faults.update(mesh.faults.keys())
        kinds.update(mesh.kinds)
    moved = [mesh.moved_percent for mesh in ready] or [0.0]
    return Summary(
        meshes=len(meshes),
        ready=len(ready),
        failed=len(failed),
        rows=sum(mesh.rows for mesh in ready),
        ways=Counter(mesh.way for mesh in ready),
        faults=dict(faults.most_common()),
        components=kinds,
        licences=Counter(mesh.licence or "not stated" for mesh in meshes),
        moved_percent={str(p): float(np.percentile(moved, p)) for p in _PERCENTILES},
        causes=_causes([*failed, *_without_fields(ready)]),
    )


def _without_fields(ready):
    """Return meshes as failed ones, once for each of their fields that could not be built."""
    return [
        mesh.model_copy(update={"failed": Failure(stage="field", reason=f"{name}: {reason}")})
        for mesh in ready
        for name, reason in mesh.unbuilt.items()
    ]


def _causes(failed):
    """Return failures by stage and reason, numbers and names apart, with what would help."""
    causes = {}
    for mesh in failed:
        reason = mesh.failed.reason
        for name in filter(None, (mesh.source, mesh.inside, mesh.name)):
            reason = reason.replace(name, "…")
        reason = re.sub(r"\d[\d,.e+-]*", "…", reason)[:160]
        causes.setdefault((mesh.failed.stage, reason), []).append(mesh)
    rows = [
        Cause(stage=stage, reason=_briefly(same[0]), count=len(same), example=same[0].name,
              option=same[0].failed.option)
        for (stage, _), same in causes.items()
    ]  # fmt: skip
    return sorted(rows, key=lambda row: (-row.count, row.reason))


def _briefly(mesh):
    """Return why a mesh failed, without the path of its file at the beginning."""
    return mesh.failed.reason.removeprefix(f"{mesh.source}: ")[:300]


def forget(paths):
    """Remove shards of an earlier number of shards, and their last versions."""
    folder, current = Path(paths[0]).parent, {Path(path).name for path in paths}
    for path in folder.glob("*.zarr.zip"):
        if path.name not in current:
            path.unlink()
    for path in (folder / ".resume").glob("*.zarr.zip"):
        if not path.name.endswith(f"-of-{len(paths):05}.zarr.zip"):
            path.unlink()
