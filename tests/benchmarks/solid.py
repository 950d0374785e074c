"""Solids of many meshes: answered, valid, distance of the visible source, components lost, cost.

Other methods, with --method: point-cloud-utils' make_mesh_watertight (`pcu`, default resolution),
mesh2sdf (at 128, its default), CGAL's alpha wrap through PyMeshLab (`wrap`, defaults: 2 % of the
diagonal), and marching cubes of half a cell less the unsigned distance at 128 cells (`udf`). Those
at 128 are coarser than 256 cells, in which all distances are given.

Usage: .venv/bin/python tests/benchmarks/solid.py [--cells N] [--method M] [--json FILE] MESH...

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
from common import write

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "workflow"))

from pandis.base.errors import PandisError
from pandis.pipeline.mesh.deviation import Surface
from pandis.pipeline.mesh.diagnosis import diagnose
from pandis.pipeline.mesh.intake import read_mesh
from pandis.pipeline.mesh.solid import SolidRules, make_solid
from pandis.pipeline.mesh.topology import compact, components, same_place
from pandis.pipeline.mesh.tree import MeshTree

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
    tree, none = MeshTree(vertices, faces), np.full(len(points), -1)
    size = np.linalg.norm(np.ptp(vertices[np.unique(faces)], axis=0))
    seen = np.zeros(len(points), bool)
    for way in directions(DIRECTIONS):
        slant = normals @ way
        ask = np.flatnonzero(~seen & (np.abs(slant) > np.cos(np.radians(87))))
        if not len(ask):
            continue
        start = points[ask] + 1e-6 * size * np.sign(slant[ask])[:, None] * normals[ask]
        ways = np.tile(way, (len(ask), 1))
        seen[ask[np.isinf(tree.first_hits(start, ways, none[: len(ask)]))]] = True
    return seen


def pandis_solid(vertices, faces, cells):
    """Return our solid, and what it says of itself."""
    solid = make_solid(vertices, faces, SolidRules(cells=cells), log=lambda text: None)
    facts = {"invented": solid.facts.invented, "sheets": solid.facts.sheets}
    return solid.vertices, solid.faces, facts


def pcu(vertices, faces, cells):
    """Return the result of point-cloud-utils."""
    import point_cloud_utils

    del cells
    return *point_cloud_utils.make_mesh_watertight(vertices, faces.astype(np.int32)), {}


def mesh2sdf(vertices, faces, cells):
    """Return the result of mesh2sdf."""
    import mesh2sdf as package

    del cells
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    centre, scale = (low + high) / 2, 1.8 / (high - low).max()
    _, mesh = package.compute(
        (vertices - centre) * scale, faces, 128, fix=True, level=2 / 128, return_mesh=True
    )
    return np.array(mesh.vertices) / scale + centre, np.array(mesh.faces), {}


def wrap(vertices, faces, cells):
    """Return CGAL's alpha wrap."""
    import pymeshlab

    del cells
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces))
    meshes.generate_alpha_wrap()
    mesh = meshes.current_mesh()
    return mesh.vertex_matrix(), mesh.face_matrix().astype(np.int64), {}


def udf(vertices, faces, cells):
    """Return marching cubes of half a cell less the unsigned distance."""
    del cells
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    cell = (high - low).max() / 120
    size = (np.ceil((high - low) / cell).astype(int) + 9).tolist()
    axes = [low[k] - 4 * cell + cell * np.arange(size[k]) for k in range(3)]
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    nodes = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    distance = Surface(vertices, faces).distance(nodes)
    out = igl.marching_cubes(distance, nodes, *size, cell / 2)
    return out[0], np.asarray(out[1], np.int64), {}


METHODS = {"pandis": pandis_solid, "pcu": pcu, "mesh2sdf": mesh2sdf, "wrap": wrap, "udf": udf}


def judged(path, cells, method):
    """Return the figures of one mesh."""
    reading, _ = read_mesh(str(path), path, seconds=120, memory_gb=4)
    vertices, faces = reading.vertices, np.asarray(reading.faces, np.int64)
    before = resource.getrusage(resource.RUSAGE_SELF)
    vertices, faces = compact(vertices, faces)
    solid_vertices, solid_faces, facts = METHODS[method](vertices, faces, cells)
    after = resource.getrusage(resource.RUSAGE_SELF)
    solid_faces = np.asarray(solid_faces, np.int64)
    diagnosis = diagnose(solid_vertices, solid_faces)
    cell = float(np.ptp(vertices, axis=0).max()) / (256 - 8)
    source, result = Surface(vertices, faces), Surface(solid_vertices, solid_faces)
    label, count = components(same_place(vertices)[faces])
    rng = np.random.default_rng(0)
    skin = result.sample(1500, rng, np.ones(len(solid_faces), bool))
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
        "result": len(solid_faces),
        "crossings": diagnosis.self_intersections,
        "hidden": float(1 - visible(result.vertices, result.faces, *skin).mean()),
        "iou": _overlap(vertices, faces, result, rng),
        "closed": diagnosis.closed and not diagnosis.orientation_conflicts,
        "faults": "" if diagnosis.valid else diagnosis.faults(),
        "p50": float(np.median(whole)) if len(whole) else 0.0,
        "p99": float(np.percentile(whole, 99)) if len(whole) else 0.0,
        "visible": float(seen[:SAMPLES].mean()),
        "lost": int(lost),
        "components": int(checked),
        "cpu": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "mb": after.ru_maxrss / 1000,
        **facts,
    }


def _overlap(vertices, faces, result, rng):
    """Return the intersection over the union with a valid source; None if it is not valid."""
    if not diagnose(vertices, faces).valid:
        return None
    points = rng.uniform(result.low, result.high, (100_000, 3))
    one = MeshTree(vertices, faces).windings(points) > 0.5
    other = result.windings(points) > 0.5
    return float((one & other).sum() / max((one | other).sum(), 1))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=256)
    parser.add_argument("--method", choices=METHODS, default="pandis")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--table", action="store_true", help="MESH… are files METHOD.json")
    parser.add_argument("--one", action="store_true", help="this process judges the only mesh")
    parser.add_argument("meshes", nargs="+", type=Path)
    words = parser.parse_args()
    if words.one:
        try:
            print(json.dumps(judged(words.meshes[0], words.cells, words.method)))
        except PandisError as error:
            print(json.dumps({"error": str(error)}))
        return
    if words.table:
        write_table(words.meshes)
        return
    rows = {}
    for path in words.meshes:
        command = [sys.executable, __file__, "--one", "--cells", str(words.cells)]
        command += ["--method", words.method, str(path)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        last = done.stdout.strip().splitlines()[-1:] or ["{}"]
        row = json.loads(last[0]) if last[0].startswith("{") else {}
        row = row or {"error": done.stderr.strip()[-200:]}
        rows[path.name] = row
        print(path.name, row["error"] if "error" in row else line(row), flush=True)
    if words.json:
        words.json.write_text(json.dumps(rows, indent=1))
    for name, value in summary(rows).items():
        print(f"{name:14} {value:.4g}" if isinstance(value, float) else f"{name:14} {value}")


def line(row):
    """Return one mesh's figures as text."""
    return (
        f"{row['faces']:,} -> {row['result']:,} faces; p50 {row['p50']:.3f} p99 {row['p99']:.2f}; "
        f"lost {row['lost']}/{row['components']}; invented {row.get('invented', 0):.3f}, sheets "
        f"{row.get('sheets', 0):.2f}; {row['cpu']:.1f} CPU s, {row['mb']:.0f} MB "
        f"{row['faults']}"
    )


def summary(rows):
    """Return the figures over all meshes that were answered."""
    good = [row for row in rows.values() if "error" not in row]
    overlap = [row["iou"] for row in good if row["iou"] is not None]
    p99, cpu = (np.array([row[key] for row in good]) for key in ("p99", "cpu"))
    return {
        "answered": len(good),
        "closed": sum(row["closed"] for row in good),
        "valid": sum(not row["faults"] for row in good),
        "crossings": sum(row["crossings"] > 0 for row in good),
        "hidden": sum(row["hidden"] > 0.3 for row in good),
        "lost": sum(row["lost"] for row in good),
        "components": sum(row["components"] for row in good),
        "p99_median": float(np.median(p99)),
        "p99_half": float(np.mean(p99 <= 0.5)),
        "p99_one": float(np.mean(p99 <= 1)),
        "iou_median": float(np.median(overlap)) if overlap else "",
        "iou_least": min(overlap, default=""),
        "valid_sources": len(overlap),
        "faces_median": int(np.median([row["result"] for row in good])),
        "cpu_median": float(np.median(cpu)),
        "cpu_p95": float(np.percentile(cpu, 95)),
        "cpu_worst": float(cpu.max()),
        "mb_worst": max(row["mb"] for row in good),
    }


def write_table(files):
    """Write docs/figures/solid.csv from files that --json wrote: one row for each METHOD.json."""
    results = {path.stem: json.loads(path.read_text()) for path in files}
    # a file that no method can read says nothing about the methods
    read = {name for rows in results.values() for name, row in rows.items() if "error" not in row}
    rows = []
    for method, every in results.items():
        of_these = {name: row for name, row in every.items() if name in read}
        rows.append({"method": method, "meshes": len(read), **summary(of_these)})
    write("solid", list(rows[0]), rows)


if __name__ == "__main__":
    main()
