"""Bytes against error of all grids on three scans; write docs/figures/fields.csv.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/fields.py
Errors are means of ‖F - F_exact‖ at k = 1 in the unit frame, over 50,000 points 0 to 0.01
(shallow) and 0 to 0.04 (deep) below the surface. Build times include the tree.
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from common import SCANS, load, write

from pandis.base.forces import penalty_force
from pandis.base.frame import UNIT
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.distance import MeshDistance
from pandis.pipeline.geometry.sampling import probes
from pandis.pipeline.kinds.grid.dense import DenseGrid
from pandis.pipeline.kinds.grid.spec import CONTENTS
from pandis.pipeline.kinds.opening import open_field
from pandis.pipeline.kinds.spline.lattices import SplineFit, samples_for
from pandis.pipeline.run.ask.catalogue import known_field
from pandis.pipeline.run.job.artifact import Artifact, ArtifactWriter, write_artifact
from pandis.pipeline.run.job.stage import silent_progress

COLUMNS = ("mesh", "field", "bytes", "disk_bytes", "build_s", "shallow", "deep", "flagged")
BAND = (0.045, 0.02)
DENSE = (
    "nearest-64",
    "trilinear-64",
    "trilinear-normal-64",
    "trilinear-gradient-64",
    "tricubic-64",
    "tricubic-128",
)
SPLINES = (100_000, 200_000, 400_000, 800_000, 1_600_000)


def dense(vertices, faces, kind, size, path):
    """Bake a grid as the workflow does; return its arrays and attributes."""
    grid = DenseGrid(
        MeshDistance(vertices, faces), CONTENTS[kind], size, band=BAND, progress=silent_progress
    )
    with ArtifactWriter(path, "grid") as writer:
        writer.declare("values", **grid.column(32))
        slabs = list(grid.slabs(32))
        for slab in slabs:
            writer.append("values", slab)
        writer.finish(grid.attributes(), {})
    return {"values": np.concatenate(slabs)}, grid.attributes()


def spline(vertices, faces, budget, path):
    """Fit a spline as the workflow does; return its arrays and attributes."""
    fit = SplineFit(Body(vertices, faces, UNIT), BAND, 0, count=samples_for(budget=budget))
    arrays, attributes = fit.build(fit.choose_size(budget), budget, silent_progress)
    write_artifact(path, "grid", arrays, attributes=attributes, provenance={})
    return arrays, attributes


def main(names):
    """Measure all fields of the named scans, or of all."""
    rows, folder = [], Path(tempfile.mkdtemp())
    for name in names or SCANS:
        vertices, faces = load(SCANS[name])
        sets = probes(Body(vertices, faces, UNIT), 50_000, seed=1)
        jobs = [(field, field.rpartition("-")[0]) for field in DENSE]
        jobs += [(f"spline, {budget // 1000} KB", "spline") for budget in SPLINES]
        for index, (field, kind) in enumerate(jobs):
            path, start = folder / "grid.zarr.zip", time.perf_counter()
            if kind == "spline":
                budget = SPLINES[index - len(DENSE)]
                arrays, attributes = spline(vertices, faces, budget, path)
            else:
                size = int(field.rpartition("-")[2])
                arrays, attributes = dense(vertices, faces, kind, size, path)
            row = {"mesh": name, "field": field, "build_s": time.perf_counter() - start}
            row["disk_bytes"] = path.stat().st_size
            attributes = attributes | UNIT.attributes()
            held = Artifact("grid", arrays, attributes)
            made = open_field(known_field(field if kind != "spline" else "spline-auto"), held)
            row |= {"bytes": made.bytes, "flagged": 0}
            for where, (points, distance, normal) in sets.items():
                found = made.query(points)
                force = penalty_force(found.distance, found.normal)
                off = np.linalg.norm(force - penalty_force(distance, normal), axis=1)
                row[where] = float(off.mean())
                row["flagged"] += int((found.flag > 0).sum())
            rows.append(row)
            print(row, file=sys.stderr, flush=True)
    if not names:
        write("fields", COLUMNS, rows)


if __name__ == "__main__":
    main(sys.argv[1:])
