"""The index of a data set: every mesh, its shard and rows, and what the whole amounts to."""

import re
from collections import Counter
from pathlib import Path

import numpy as np

from pandis.pipeline.dataset.reading import Shard
from pandis.pipeline.geometry.strata import STRATA

#: Percentiles of the deviation that the card states.
_PERCENTILES = (50, 95, 99, 100)
#: How a mesh became a solid, and the class of its components if the rung `solid` made it.
_UNCHANGED, _EXACT, _SOLID = "valid as read", "repaired exactly", "solid"


def collect(paths, options, *, note=lambda path, digest: None):
    """Return the arrays and attributes of a data set's index.

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
        ``shard`` and ``place`` (M,): the shard of each mesh and its number there; ``rows`` (M,).
    attributes : dict
        ``meshes``: facts about each, by name; ``summary``; ``strata``; ``chunk``; ``sign``.

    Raises
    ------
    ArtifactError
        A shard is missing or damaged.
    """
    meshes, chunk = [], 0
    for number, path in enumerate(paths):
        shard = Shard(path)
        chunk = shard.chunk
        note(path, shard.digest)
        meshes += [mesh | {"shard": [number, k]} for k, mesh in enumerate(shard.meshes)]
    meshes.sort(key=lambda mesh: mesh["name"])
    attributes = {
        "dataset": options.dataset,
        "source": options.source,
        "meshes": meshes,
        "summary": _summary(meshes),
        "strata": list(STRATA),
        "chunk": chunk,
        "sign": "negative inside",
        "frame": "points are (x - centre) * scale of each mesh; distances are multiplied by scale",
    }
    places = np.array([mesh["shard"] for mesh in meshes], np.int32).reshape(-1, 2)
    rows = np.array([mesh.get("rows", 0) for mesh in meshes], np.int64)
    return {"shard": places[:, 0], "place": places[:, 1], "rows": rows}, attributes


def _summary(meshes):
    ready = [mesh for mesh in meshes if "failed" not in mesh]
    failed = [mesh for mesh in meshes if "failed" in mesh]
    faults, kinds = Counter(), Counter()
    for mesh in ready:
        faults.update(mesh["faults"].keys())
        kinds.update(mesh["kinds"])
    moved = [mesh["moved_percent"] for mesh in ready] or [0.0]
    return {
        "meshes": len(meshes),
        "ready": len(ready),
        "failed": len(failed),
        "rows": sum(mesh["rows"] for mesh in ready),
        "ways": dict(Counter(way_of(mesh) for mesh in ready)),
        "faults": dict(faults.most_common()),
        "components": dict(kinds),
        "moved_percent": {str(p): float(np.percentile(moved, p)) for p in _PERCENTILES},
        "causes": _causes(failed),
        "licences": dict(Counter(mesh["licence"] or "not stated" for mesh in meshes)),
    }


def way_of(mesh):
    """Return how a mesh became a solid."""
    if mesh["kinds"]:
        return _SOLID
    return _EXACT if mesh["repair"] else _UNCHANGED


def _causes(failed):
    """Return failures by stage and reason, numbers and names apart, with what would help."""
    causes = {}
    for mesh in failed:
        why = mesh["failed"]
        reason = why["reason"].replace(mesh["source"], "").replace(mesh["inside"] or "\0", "")
        reason = re.sub(r"\d[\d,.e+-]*", "…", reason).strip(": ")[:160]
        cause = causes.setdefault((why["stage"], reason), {"count": 0, "example": mesh["name"]})
        cause["count"] += 1
        cause["option"] = why["option"]
    rows = [{"stage": stage, "reason": reason} | cause
            for (stage, reason), cause in causes.items()]  # fmt: skip
    return sorted(rows, key=lambda row: (-row["count"], row["reason"]))


def forget(paths):
    """Remove the last versions of shards from beside them, if their number has changed."""
    for path in (Path(paths[0]).parent / ".resume").glob("*.zarr.zip"):
        if not path.name.endswith(f"-of-{len(paths):05}.zarr.zip"):
            path.unlink()
