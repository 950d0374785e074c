"""The mesh on a lattice against the exact one; write docs/figures/compact.csv.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/compact.py [POINTS]

Bytes for each face; mean errors of the force on the old sets (k = 1, unit frame), and the surface
that lacks it on the contact set; the bound of the distance beside the largest error at so many
points (a million), half of them next to the surface, how many of these are on the wrong side by
more than the bound, and how many queries are cut. Times of one query in C, where it takes turns
with the exact tree's: medians, and the 99.9th percentile.
"""

import sys
import time

import numpy as np
from common import SCANS, load, write

from pandis.base.forces import penalty_force
from pandis.base.frame import UNIT
from pandis.base.physical import Scale
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.measure import contact_errors, draw_contacts
from pandis.pipeline.geometry.sampling import probes
from pandis.pipeline.geometry.trajectories import trace
from pandis.pipeline.kinds.compact.file import file_parts
from pandis.pipeline.kinds.compact.packing import build_compact
from pandis.pipeline.kinds.field import CUT, ExactField
from pandis.pipeline.kinds.native import native_bytes
from pandis.pipeline.run.ask.options import TrajectoryOptions
from pandis.pipeline.run.job.stage import silent_progress
from pandis.runtime.field import NativeField
from pandis.runtime.field.files import pack

COLUMNS = (
    *("mesh", "bits", "faces", "bytes", "build_s", "shallow", "deep", "missing"),
    *("bound", "largest", "wrong", "cut", "path_us", "path_p999_us", "box_us"),
    *("exact_path_us", "exact_path_p999_us", "exact_box_us"),
)
BITS = 12, 14, 16
TURNS, QUERIES = 5, 20_000


def forces(field):
    """Return the function that answers the forces of a native field at k = 1."""
    return lambda points: penalty_force(*field.distance_and_normal(points))


def largest_error(field, body, count, bound, rng):
    """Return the largest error of the distance, the wrong sides beyond the bound, what is cut."""
    largest, wrong, cut = 0.0, 0, 0
    for start in range(0, count, 500_000):
        points = rng.uniform(-1, 1, (min(500_000, count - start), 3))
        exact, normal = body.distance.distance_and_normal(points, check=False)
        near = rng.random(len(points)) < 0.5
        height = np.where(near, exact - rng.uniform(-0.02, 0.02, len(points)), 0.0)
        points -= height[:, None] * normal
        exact, _ = body.distance.distance_and_normal(points)
        distance, _, flag = field.query(points)
        cut += int((flag == CUT).sum())
        largest = max(largest, float(np.abs(np.abs(distance) - np.abs(exact)).max()))
        wrong += int((((distance < 0) != (exact < 0)) & (np.abs(exact) > bound)).sum())
    return largest, wrong, cut


def main(count):
    """Measure all scans."""
    rows, scale = [], Scale(0.1, 400.0)
    for mesh, source in SCANS.items():
        body = Body(*load(source), UNIT)
        sets = probes(body, 50_000, seed=1)
        contacts = draw_contacts(body, scale, 50_000, rng=np.random.default_rng(1))
        options = TrajectoryOptions()
        path, _ = trace(body, options, 1, progress=silent_progress)
        box = np.random.default_rng(2).uniform(-1, 1, (2000, 3))
        exact = NativeField(native_bytes(ExactField("exact", body), {}))
        for bits in BITS:
            start = time.perf_counter()
            arrays, record = build_compact(body, bits, 0, log=lambda text: None)
            row = {"mesh": mesh, "bits": bits, "faces": record.faces}
            row["build_s"] = time.perf_counter() - start
            row["bytes"] = sum(part.nbytes for part in arrays.values()) / record.faces
            field = NativeField(pack(UNIT, file_parts(arrays, record), {}, version=3))
            for name, (points, distance, normal) in sets.items():
                off = forces(field)(points) - penalty_force(distance, normal)
                row[name] = float(np.linalg.norm(off, axis=1).mean())
            row["missing"] = contact_errors(forces(field), contacts)["contact-deep"]["missing"]
            row["bound"] = record.deviation + record.rounding
            rng = np.random.default_rng(3)
            measured = largest_error(field, body, count, row["bound"], rng)
            row["largest"], row["wrong"], row["cut"] = measured
            times = {}
            for _ in range(TURNS):
                for where, points in (("path", path["points"]), ("box", box)):
                    for who, asked in (("", field), ("exact_", exact)):
                        taken = asked.time(points, QUERIES) * 1e6
                        times.setdefault(f"{who}{where}", []).append(taken)
            for name, taken in times.items():
                row[f"{name}_us"] = float(np.median(taken))
                if name.endswith("path"):
                    row[f"{name}_p999_us"] = float(np.quantile(taken, 0.999))
            rows.append(row)
            print(row, file=sys.stderr, flush=True)
    write("compact", COLUMNS, rows)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000)
