"""Build times of fields, from Snakemake's benchmark files."""

import json
from pathlib import Path

from pandis.pipeline.run.ask.catalogue import known_field
from pandis.pipeline.run.ask.kind import AUTO


def build_seconds(mesh, fields, folder):
    """Return the time in seconds of the last job that built each field.

    For a job that resumed from a checkpoint, only the time since then counts. Times are stored
    beside the artifacts, not in them; a field without a time is left out.

    Parameters
    ----------
    mesh : str
    fields : list of str
    folder : path-like
        Folder of the benchmark files: ``results/benchmarks``.

    Returns
    -------
    dict of str to float
        Seconds by field; 0 for a field that needs only the mesh.
    """
    seconds = {}
    for field in fields:
        path = build_file(mesh, field, folder)
        if path is None:
            seconds[field] = 0.0
            continue
        try:
            seconds[field] = float(json.loads(path.read_text().splitlines()[-1])["s"])
        except (OSError, ValueError, KeyError, IndexError):
            continue
    return seconds


def build_file(mesh, field, folder):
    """Return the benchmark file of the job that built a field; None if it needs only the mesh."""
    spec = known_field(field)
    spec = spec.through or spec
    if spec.artifact == "mesh":
        return None
    name = "choose" if spec.kind == AUTO else f"bake-{spec.artifact}"
    if spec.learned:
        name = f"train-{spec.name}"
    return Path(folder) / mesh / f"{name}.jsonl"
