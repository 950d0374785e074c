"""A mesh that is bent and squeezed under a probe; write docs/figures/refit.csv.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/refit.py [FRAMES]

Two scans, and one of them simplified to ten thousand faces, go through a thousand shapes: bent by
up to 90° along their longest side, and squeezed by up to a third. At every tenth distances are
compared with those of a tree that is built anew, at a thousand points (and a share of it that is
within 0.02 of the surface). Milliseconds of a refit, median and worst; microseconds of a query next
to the surface of the last shape, of the moved tree and of the new one in turns.
"""

import sys

import numpy as np
from common import SCANS, load, write

from pandis.base.frame import UNIT
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.kinds.native import native_bytes
from pandis.pipeline.mesh.tools import call
from pandis.runtime.field import NativeField

COLUMNS = (
    *("mesh", "faces", "frames", "refit_ms", "refit_worst_ms", "compared", "unequal"),
    *("query_us", "query_p999_us", "fresh_us", "fresh_p999_us"),
)
EVERY, POINTS, TURNS, QUERIES = 10, 1000, 5, 10_000


def meshes():
    """Yield the name, the vertices and the faces of each mesh, unit frame."""
    for name in ("bunny", "armadillo"):
        vertices, faces = load(SCANS[name])
        if name == "bunny":
            limits = {"seconds": 300.0, "memory_gb": 4.0}
            yield "bunny, 10,000 faces", *call("simplify", vertices, faces, count=10_000, **limits)
        yield name, vertices, faces


def shape_at(vertices, share):
    """Return vertices bent by up to 90° along their longest side, and squeezed across it."""
    axis = int(np.argmax(np.ptp(vertices, axis=0)))
    order = [(axis + k) % 3 for k in range(3)]
    angle = max(np.pi / 2 * share, 1e-9)
    along, across, beside = (vertices[:, k] for k in order)
    length = np.ptp(along)
    turn, radius = angle * along / length, length / angle - across
    moved = np.empty_like(vertices)
    moved[:, order[0]] = radius * np.sin(turn)
    moved[:, order[1]] = length / angle - radius * np.cos(turn)
    moved[:, order[2]] = beside * (1 - share / 3)
    return moved


def fresh(vertices, faces):
    """Return the field of a tree that is built anew."""
    return NativeField(native_bytes(ExactField("exact", Body(vertices, faces, UNIT)), {}))


def beside(vertices, count, rng):
    """Return points within 0.02 of vertices that follow each other."""
    start = int(rng.integers(len(vertices)))
    at = vertices[(start + np.arange(count)) % len(vertices)]
    return at + rng.uniform(-0.01, 0.01, (count, 3))


def main(frames):
    """Measure all meshes."""
    rows, rng = [], np.random.default_rng(0)
    for name, vertices, faces in meshes():
        moving, taken, unequal, compared = fresh(vertices, faces).moving(), [], 0, 0
        for frame in range(frames):
            share = np.sin(np.pi * (frame + 1) / frames * 2.5) ** 2
            shape = shape_at(vertices, share)
            taken.append(1e3 * moving.refit(shape))
            if frame % EVERY == 0 or frame == frames - 1:
                built = fresh(shape, faces)
                points = rng.uniform(-1, 1, (POINTS, 3))
                points[::2] = beside(shape, POINTS // 2, rng)
                one, other = moving.query(points).distance, built.query(points).distance
                unequal += int((one != other).sum())
                compared += POINTS
        points, times = beside(shape, 2000, rng), {"query": [], "fresh": []}
        for _ in range(TURNS):
            for key, field in (("query", moving), ("fresh", built)):
                times[key].append(field.time(points, QUERIES) * 1e6)
        row = {"mesh": name, "faces": len(faces), "frames": frames, "compared": compared}
        row |= {"refit_ms": float(np.median(taken)), "refit_worst_ms": float(max(taken))}
        row |= {"unequal": unequal}
        for key, all_times in times.items():
            row[f"{key}_us"] = float(np.median(all_times))
            row[f"{key}_p999_us"] = float(np.quantile(all_times, 0.999))
        rows.append(row)
        print(row, file=sys.stderr, flush=True)
    write("refit", COLUMNS, rows)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
