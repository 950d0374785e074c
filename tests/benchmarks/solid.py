"""Solids of many meshes: answered, valid, distance of the visible source, components lost, cost.

Usage: .venv/bin/python tests/benchmarks/solid.py [--cells N] [--json FILE] MESH...

Visible are the points of the source from which one of 48 directions leads away from all triangles,
on either side. Distances are in cells. Each mesh runs in a process of its own.
"""

import argparse
import json
import resource
import subprocess
import sys
from pathlib import Path

import igl
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "workflow"))

from pandis.base.errors import PandisError
from pandis.pipeline.mesh.deviation import Surface
from pandis.pipeline.mesh.diagnosis import diagnose
from pandis.pipeline.mesh.intake import read_mesh
from pandis.pipeline.mesh.solid import SolidRules, make_solid
from pandis.pipeline.mesh.topology import components, same_place

#: Points on each mesh, and on each of its 200 largest components.
SAMPLES, EACH, DIRECTIONS = 6000, 20, 48
#: A component is lost if more than half of its visible samples are farther than this, cells.
LOST = 2.0


def directions(count):
    """Return unit vectors (count, 3), spread evenly over the sphere."""
    height = 1 - (2 * np.arange(count) + 1) / count
    turn = np.pi * (1 + 5**0.5) * np.arange(count)
    around = np.sqrt(1 - height**2)
    return np.stack([around * np.cos(turn), around * np.sin(turn), height], axis=1)


def visible(vertices, faces, points, normals):
    """Return a mask (n,) of the points (n, 3) on the surface that are seen from far away."""
    tree = igl.AABB()
    tree.init(vertices, faces)
    size = np.linalg.norm(np.ptp(vertices[np.unique(faces)], axis=0))
    seen = np.zeros(len(points), bool)
    for way in directions(DIRECTIONS):
        slant = normals @ way
        ask = np.flatnonzero(~seen & (np.abs(slant) > np.cos(np.radians(87))))
        if not len(ask):
            continue
        start = points[ask] + 1e-6 * size * np.sign(slant[ask])[:, None] * normals[ask]
        hit, _, _ = tree.intersect_ray_first(
            vertices, faces, np.ascontiguousarray(start), np.tile(way, (len(ask), 1))
        )
        seen[ask[np.asarray(hit) < 0]] = True
    return seen


def judged(path, cells):
    """Return the figures of one mesh."""
    reading, _ = read_mesh(str(path), path, seconds=120, memory_gb=4)
    vertices, faces = reading.vertices, np.asarray(reading.faces, np.int64)
    before = resource.getrusage(resource.RUSAGE_SELF)
    solid = make_solid(vertices, faces, SolidRules(cells=cells), log=lambda text: None)
    after = resource.getrusage(resource.RUSAGE_SELF)
    diagnosis, cell = diagnose(solid.vertices, solid.faces), solid.facts.cell
    source, result = Surface(vertices, faces), Surface(solid.vertices, solid.faces)
    label, count = components(same_place(vertices)[faces])
    rng = np.random.default_rng(0)
    points, normals = source.sample(SAMPLES, rng, np.ones(len(faces), bool))
    parts = np.argsort(-np.bincount(label), kind="stable")[:200] if count > 1 else np.arange(0)
    for part in parts:
        surface = Surface(vertices, faces[label == part])
        more = surface.sample(EACH, rng, np.ones(len(surface.faces), bool))
        points, normals = np.concatenate([points, more[0]]), np.concatenate([normals, more[1]])
    part_of = np.repeat(parts, EACH)
    seen = visible(vertices, faces, points, normals)
    far = result.distance(points) / cell
    whole = far[:SAMPLES][seen[:SAMPLES]]
    lost = checked = 0
    for part in parts:
        mine = far[SAMPLES:][(part_of == part) & seen[SAMPLES:]]
        checked += len(mine) > 0
        lost += len(mine) > 0 and (mine > LOST).mean() > 0.5
    return {
        "faces": len(faces),
        "result": len(solid.faces),
        "closed": diagnosis.closed and not diagnosis.orientation_conflicts,
        "faults": "" if diagnosis.valid else diagnosis.faults(),
        "p50": float(np.median(whole)) if len(whole) else 0.0,
        "p99": float(np.percentile(whole, 99)) if len(whole) else 0.0,
        "visible": float(seen[:SAMPLES].mean()),
        "lost": int(lost),
        "components": int(checked),
        "cpu": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "mb": after.ru_maxrss / 1000,
        "invented": solid.facts.invented,
        "sheets": solid.facts.sheets,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=256)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--one", action="store_true", help="this process judges the only mesh")
    parser.add_argument("meshes", nargs="+", type=Path)
    words = parser.parse_args()
    if words.one:
        try:
            print(json.dumps(judged(words.meshes[0], words.cells)))
        except PandisError as error:
            print(json.dumps({"error": str(error)}))
        return
    rows = {}
    for path in words.meshes:
        command = [sys.executable, __file__, "--one", "--cells", str(words.cells), str(path)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        last = done.stdout.strip().splitlines()[-1:] or ["{}"]
        row = json.loads(last[0]) if last[0].startswith("{") else {}
        row = row or {"error": done.stderr.strip()[-200:]}
        rows[path.name] = row
        print(path.name, row["error"] if "error" in row else line(row), flush=True)
    if words.json:
        words.json.write_text(json.dumps(rows, indent=1))
    summary([row for row in rows.values() if "error" not in row], len(rows))


def line(row):
    """Return one mesh's figures as text."""
    return (
        f"{row['faces']:,} -> {row['result']:,} faces; p50 {row['p50']:.3f} p99 {row['p99']:.2f}; "
        f"lost {row['lost']}/{row['components']}; invented {row['invented']:.3f}, sheets "
        f"{row['sheets']:.2f}; {row['cpu']:.1f} CPU s, {row['mb']:.0f} MB {row['faults']}"
    )


def summary(rows, count):
    """Print the figures over all meshes."""
    p99, cpu = (np.array([row[key] for row in rows]) for key in ("p99", "cpu"))
    print(
        f"\nanswered {len(rows)} of {count}; closed {sum(row['closed'] for row in rows)}, valid "
        f"{sum(not row['faults'] for row in rows)}; components lost "
        f"{sum(row['lost'] for row in rows)} of {sum(row['components'] for row in rows)}\n"
        f"p99: median {np.median(p99):.3f}, at most 0.5 cell {np.mean(p99 <= 0.5):.1%}, at most 1 "
        f"cell {np.mean(p99 <= 1):.1%}\nCPU s: median {np.median(cpu):.2f}, 95 % "
        f"{np.percentile(cpu, 95):.2f}, worst {cpu.max():.2f}; worst memory "
        f"{max(row['mb'] for row in rows):.0f} MB"
    )


if __name__ == "__main__":
    main()
