"""Errors at small sizes: compact meshes against splines, on six meshes; docs/figures/small.csv.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/small.py [MESH ...]

Mean errors of the force (k = 1, unit frame): on the old sets, shallow and deep, and on the contact
set, with the share of the surface that lacks the force there. Networks of about these sizes are in
docs/figures/front.csv: half a minute to three of training each.
"""

import sys
import time

import numpy as np
from common import load, write
from front import MESHES

from pandis.base.forces import penalty_force
from pandis.base.frame import Frame
from pandis.base.physical import Scale
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.points import Points
from pandis.pipeline.geometry.sampling import probes
from pandis.pipeline.kinds.compact.packing import size_of
from pandis.pipeline.kinds.compact.search import Packer
from pandis.pipeline.kinds.spline.search import SplineMaker
from pandis.pipeline.run.job.stage import silent_progress

COLUMNS = (
    *("mesh", "kind", "budget", "bytes", "faces", "bits", "build_s"),
    *("shallow", "deep", "contact", "missing"),
)
BUDGETS = 50_000, 100_000, 200_000, 400_000, 800_000
BAND = 0.045, 0.02


def packed(body, points, budget):
    """Return a compact mesh of so many bytes at most, and what is told of it."""
    made = Packer(points, 1, lambda text: None).within(budget)
    if made is None:
        return None, {}
    record = made.field.record
    told = {"faces": record.faces, "bits": record.bits, "bytes": size_of(made.arrays)}
    return made.force, told


def splined(body, points, budget):
    """Return a spline of so many bytes at most, and what is told of it."""
    made = SplineMaker(points, BAND, silent_progress, most=budget).make(budget)
    return (made.force, {"bytes": made.field.bytes}) if made else (None, {})


def main():
    """Measure all meshes, or those that are named."""
    rows, asked = [], sys.argv[1:] or list(MESHES)
    for mesh in asked:
        source = MESHES[mesh]
        vertices, faces = load(source)
        frame = Frame.of_bounds(vertices.min(axis=0), vertices.max(axis=0))
        body = Body(vertices, faces, frame)
        points = Points(body, Scale(0.1, 400.0), 1)
        sets = probes(body, 50_000, seed=1)
        for budget in BUDGETS:
            for kind, make in (("compact-auto", packed), ("spline-auto", splined)):
                start = time.perf_counter()
                force, told = make(body, points, budget)
                row = {"mesh": mesh, "kind": kind, "budget": budget} | told
                row["build_s"] = time.perf_counter() - start
                if force is not None:
                    for name, (where, distance, normal) in sets.items():
                        off = force(where) - penalty_force(distance, normal)
                        row[name] = float(np.linalg.norm(off, axis=1).mean())
                    figures = points.measure(force).figures
                    row |= {"contact": figures["mean"], "missing": figures["missing"]}
                rows.append(row)
                print(row, file=sys.stderr, flush=True)
    write("small", COLUMNS, rows)


if __name__ == "__main__":
    main()
