"""Data sets of many meshes: scale, throughput, labels and reading; prints figures.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/datasets.py COMMAND FOLDER [COUNT]

    variants   write COUNT meshes (10,000 by default) of 1,000 to 20,000 faces (median 5,000) into
               FOLDER/meshes: the shared meshes and closed forms, simplified, turned, scaled; of
               eight, one is cut open and one has noise on its vertices
    scale      label them by the workflow, 20,000 rows each and solids of 128 cells, killed at five
               places; time a plan, a run that has nothing to do, and both cores' work for a mesh
    throughput label COUNT meshes (200 by default) of PANDIS_MESHES as they are, turned, with
               564,000 rows each: meshes in a core minute, those valid as read and all; beside
               point-cloud-utils (watertight, then distances of as many points), and for every
               fourth mesh the recipe of signs.py, if these packages are installed
    labels     compare 10,000 rows of each mesh of the store FOLDER with exact winding numbers and
               distances; distances that differ from libigl's, with those of 50 digits
    reading    time 16,000 random rows of a mesh of a million, and a DataLoader with two workers
"""

import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import igl
import mpmath
import numpy as np
import pymeshlab
import torch
import trimesh
import yaml
from common import ROOT
from many import ENDINGS, simplified
from scipy.spatial.transform import Rotation
from signs import of_hunyuan, of_pcu

import pandis
from pandis.pipeline.api.writing import mesh_bytes
from pandis.pipeline.dataset.reading import ROWS
from pandis.pipeline.geometry.shapes import find_shape

#: Faces of the levels to which each source is simplified: log-normal around 5,000.
LEVELS = (1200, 2000, 3200, 4200, 5000, 6000, 8000, 12_000, 20_000)
SHARES = (0.08, 0.12, 0.14, 0.16, 0.14, 0.12, 0.12, 0.08, 0.04)
KILLED = 0.05, 0.2, 0.4, 0.6, 0.8
SCALE = {"surface": 6000, "near": 8000, "volume": 6000}
LARGE = {"surface": 64_000, "near": 250_000, "volume": 250_000}


def sources():
    """Return the shared mesh files."""
    folder = Path(os.environ["PANDIS_MESHES"])
    return sorted(p for p in folder.rglob("*") if p.suffix.lower() in ENDINGS)


def simplify(source, folder):
    """Write a mesh with each number of faces; in a process of its own, for some files crash it."""
    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(source)
    for faces in sorted(LEVELS, reverse=True):
        if meshes.current_mesh().face_number() > faces:
            meshes.meshing_decimation_quadric_edge_collapse(targetfacenum=faces)
        if 1000 <= meshes.current_mesh().face_number() <= 1.5 * faces:
            meshes.save_current_mesh(f"{folder}/{faces}.ply")


def levels_of(source, folder):
    """Return vertices and faces of a source by their number of faces, where that can be had."""
    folder.mkdir()
    command = [sys.executable, __file__, "simplify", str(source), str(folder)]
    subprocess.run(command, capture_output=True, check=False, timeout=300)
    read = {int(path.stem): trimesh.load(path, force="mesh", process=False)
            for path in folder.glob("*.ply")}  # fmt: skip
    return {level: (np.array(mesh.vertices), np.array(mesh.faces)) for level, mesh in read.items()}


def write_variants(folder, count):
    """Write the meshes."""
    rng, work = np.random.default_rng(0), Path(tempfile.mkdtemp())
    folder.mkdir(parents=True)
    files = sources()
    for name in ("sphere", "torus", "box", "capsule"):
        path = work / f"{name}.ply"
        path.write_bytes(mesh_bytes("ply", *find_shape(name).tessellation()))
        files.append(path)
    read = [levels_of(path, work / str(number)) for number, path in enumerate(files)]
    shutil.rmtree(work)
    read = [levels for levels in read if levels]
    print(f"{len(read)} of {len(files)} files can be simplified", flush=True)
    for number in range(count):
        levels = read[number % len(read)]
        share = np.array([SHARES[LEVELS.index(level)] for level in levels])
        vertices, faces = levels[rng.choice(list(levels), p=share / share.sum())]
        way = rng.integers(8)
        if way == 0:  # cut open
            direction = rng.normal(size=3)
            height = vertices[faces].mean(axis=1) @ direction
            faces = faces[height < np.quantile(height, rng.uniform(0.7, 0.95))]
        if way == 1:
            diagonal = np.linalg.norm(np.ptp(vertices, axis=0))
            vertices = vertices + rng.normal(0, 2e-4 * diagonal, vertices.shape)
        turn = Rotation.random(random_state=rng).as_matrix()
        path = folder / f"{number % 100:02}" / f"m{number:05}.ply"
        path.parent.mkdir(exist_ok=True)
        data = mesh_bytes("ply", vertices @ turn.T * np.exp(rng.normal()), faces)
        path.write_bytes(data)


def snakemake(folder, *arguments):
    """Return a running Snakemake whose output goes to a log."""
    command = [sys.executable, "-m", "snakemake", "-s", str(ROOT / "workflow/Snakefile"),
               "--configfile", "data.yaml", *arguments]  # fmt: skip
    log = (folder / "log").open("a")
    return subprocess.Popen(command, cwd=folder, stdout=log, stderr=log, start_new_session=True)


def timed(folder, *arguments):
    """Return seconds and peak memory (MB) of a run of Snakemake."""
    before = time.monotonic()
    process = snakemake(folder, *arguments)
    _, status, used = os.wait4(process.pid, 0)
    assert status == 0, f"{folder}/log"
    return time.monotonic() - before, used.ru_maxrss / 1000


def finished(folder):
    """Return how many meshes are computed."""
    store = folder / "results/datasets/data/shards"
    return len(list(store.glob(".resume/*/*.npz"))) + len(list(store.glob("*.zip"))) * 80


def scale(folder):
    """Label the variants by the workflow."""
    count = len(list((folder / "meshes").rglob("*.ply")))
    data = {"source": "meshes", "samples": SCALE, "mesh": {"solid_error": "128 cells"}}
    (folder / "data.yaml").write_text(yaml.safe_dump({"datasets": {"data": data}}))
    print("plan: {:.1f} s, {:.0f} MB; again {:.1f} s".format(
        *timed(folder, "-n", "--quiet"), timed(folder, "-n", "--quiet")[0]))  # fmt: skip
    start = time.monotonic()
    for share in KILLED:
        process = snakemake(folder, "-j2")
        while process.poll() is None and finished(folder) < share * count:
            time.sleep(0.2)
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        snakemake(folder, "--unlock").wait()
        print(f"killed with {finished(folder)} of {count} meshes at hand", flush=True)
    seconds, memory = timed(folder, "-j2")
    whole = time.monotonic() - start
    cpu = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(f"all: {whole:.0f} s with five kills; the last run {seconds:.0f} s, {memory:.0f} MB")
    print(f"CPU of what ended by itself: {(cpu.ru_utime + cpu.ru_stime) / count:.3f} s a mesh")
    print("nothing to do: {:.1f} s, {:.0f} MB".format(*timed(folder, "-j2")))
    store = pandis.LabelStore(folder / "results/datasets/data")
    assert len({*store.names, *store.failed}) == count == store.summary.meshes
    print(store.summary.model_dump_json(indent=1))
    jobs = len(list((folder / "results/datasets/data/shards").glob("*.zip"))) + 1
    print(f"{jobs} jobs; every one of {count} meshes stands in the index once")


def throughput(folder, count):
    """Label shared meshes as they are, with many rows; those that are valid as read, and all."""
    rng, place = np.random.default_rng(1), folder / "whole"
    place.mkdir(parents=True, exist_ok=True)
    read = {}
    for number in range(count):
        source = sources()[number % len(sources())]
        if source not in read:
            mesh = simplified(source, 10**7, place / "source.ply")
            usable = mesh is not None and 0 < len(mesh.faces) <= 250_000
            read[source] = mesh if usable else None
        mesh = read[source]
        if mesh is None:
            continue
        turn = Rotation.random(random_state=rng).as_matrix()
        data = mesh_bytes("ply", np.array(mesh.vertices) @ turn.T, np.array(mesh.faces))
        (place / f"w{number:03}.ply").write_bytes(data)
    (place / "source.ply").unlink(missing_ok=True)
    paths = sorted(place.glob("*.ply"))
    valid = [path for path in paths if pandis.check(path).ok]
    for name, chosen in (("valid", valid), ("all", paths)):
        listing = folder / f"{name}.txt"
        listing.write_text("\n".join(str(path.resolve()) for path in chosen))
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        started, clock = time.process_time(), time.monotonic()
        store = pandis.label_meshes(listing, folder / f"{name}.zarr", workers=1, **LARGE)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        cpu += time.process_time() - started
        faces = np.array([mesh.faces_read for mesh in store.facts.values()])
        quartiles = np.percentile(faces, (0, 25, 50, 75, 100)).astype(int).tolist()
        print(
            f"{name}: {len(chosen)} meshes ({len(store.names)} ready), faces {quartiles}: "
            f"{cpu:.0f} CPU s, {time.monotonic() - clock:.0f} s; {60 * len(chosen) / cpu:.1f} a "
            "core minute",
            flush=True,
        )

    rivals("point-cloud-utils", paths, watertight_and_labels)
    rivals("the copied recipe", paths[::4], of_hunyuan)


def watertight_and_labels(vertices, faces, points):
    """Make a mesh watertight by point-cloud-utils, and label points."""
    import point_cloud_utils

    closed = point_cloud_utils.make_mesh_watertight(vertices, faces.astype(np.int32))
    return of_pcu(*closed, points)


def rivals(name, paths, ask):
    """Print the CPU time that another way takes for as many points of the same meshes."""
    total = ready = 0
    for path in paths:
        start, rng = time.process_time(), np.random.default_rng(0)
        try:
            mesh = trimesh.load(path, process=False)
            surface = mesh.sample(LARGE["surface"] + LARGE["near"], seed=0)
            surface[LARGE["surface"] :] += rng.normal(0, 0.01, (LARGE["near"], 3)) * mesh.scale
            box = rng.uniform(*mesh.bounds, (LARGE["volume"], 3))
            ask(np.array(mesh.vertices), np.array(mesh.faces), np.concatenate([surface, box]))
            ready += 1
        except Exception as error:  # a rival may do anything
            print(f"{name}: {path.name}: {type(error).__name__}: {error}", flush=True)
        total += time.process_time() - start
    print(
        f"{name}: {len(paths)} meshes ({ready} ready): {total:.0f} CPU s; "
        f"{60 * len(paths) / total:.1f} a core minute",
        flush=True,
    )


def labels(path, rows=10_000):
    """Compare stored rows with exact winding numbers and distances."""
    store = pandis.LabelStore(path, columns=tuple(ROWS))
    wrong = total = 0
    beyond = [(0.0, 0.0)]
    for name in store.names:
        vertices, faces = store.mesh(name)
        centre, scaled = store.frame(name)
        corners, faces = (vertices - centre) * scaled, faces.astype(np.int64)
        drawn = {key: value[:rows] for key, value in store.rows(name).items()}
        points = drawn["points"].astype(np.float64)
        inside = igl.winding_number(corners, faces, points) > 0.5
        near = np.sqrt(igl.point_mesh_squared_distance(points, corners, faces)[0])
        wrong += int((inside != (drawn["distance"] < 0)).sum())
        label = np.abs(drawn["distance"].astype(np.float64))
        for k in np.flatnonzero(np.abs(label - near) > np.spacing(near.astype(np.float32))):
            exact = exact_distance(points[k], corners[faces], near[k])
            off = float(abs(mpmath.mpf(label[k]) - exact))
            if off > np.spacing(np.float32(exact)):
                beyond.append((off, float(exact)))
        total += len(points)
    off, distance = np.max(beyond, axis=0)
    print(
        f"{total:,} rows of {len(store.names)} meshes: {wrong} wrong signs; {len(beyond) - 1} "
        "labels more than a unit in the last place from the exact distance, at most "
        f"{off:.2g} off, at distances of at most {distance:.2g}"
    )


def exact_distance(point, triangles, near):
    """Return the distance of a point from triangles (F, 3, 3), given roughly, to 40 digits."""
    middle = triangles.mean(axis=1)
    radius = np.linalg.norm(triangles - middle[:, None], axis=2).max(axis=1)
    candidates = triangles[np.linalg.norm(middle - point, axis=1) - radius <= near + 1e-6]
    with mpmath.workdps(50):
        place = mpmath.matrix(point.tolist())
        return min(_from_triangle(place, *map(mpmath.matrix, t.tolist())) for t in candidates)


def _from_triangle(point, a, b, c):
    def dot(x, y):
        return mpmath.fdot(x, y)

    def from_side(start, end):
        way, length = end - start, dot(end - start, end - start)
        along = dot(point - start, way) / length if length else 0
        return mpmath.norm(point - start - way * min(max(along, 0), 1))

    u, v, w = b - a, c - a, point - a
    uu, uv, vv, uw, vw = dot(u, u), dot(u, v), dot(v, v), dot(u, w), dot(v, w)
    area = uu * vv - uv * uv
    sides = min(from_side(a, b), from_side(b, c), from_side(c, a))
    if not area:
        return sides
    s, t = (vv * uw - uv * vw) / area, (uu * vw - uv * uw) / area
    inside = s >= 0 and t >= 0 and s + t <= 1
    return min(sides, mpmath.norm(w - u * s - v * t)) if inside else sides


def reading(folder):
    """Time random rows of a mesh of a million, and a DataLoader."""
    (folder / "one").mkdir(parents=True, exist_ok=True)
    ball = trimesh.creation.icosphere(subdivisions=4)
    (folder / "one/ball.ply").write_bytes(mesh_bytes("ply", ball.vertices, ball.faces))
    million = {"surface": 200_000, "near": 400_000, "volume": 400_000}
    pandis.label_meshes(folder / "one", folder / "one.zarr", **million)
    size = (folder / "one.zarr/shards/00000.zarr.zip").stat().st_size
    store = pandis.LabelStore(folder / "one.zarr")
    store.draw("ball", seed=0)
    times = []
    for seed in range(1, 200):
        start = time.perf_counter()
        store.draw("ball", seed=seed)
        times.append(time.perf_counter() - start)
    share = store.chunk / 1e6
    print(f"{store.chunk} rows of a million: median {1e3 * np.median(times):.1f} ms, 99 % "
          f"{1e3 * np.percentile(times, 99):.1f} ms; {100 * share:.1f} % of two of five arrays in "
          f"{size / 1e6:.0f} MB")  # fmt: skip
    loader = torch.utils.data.DataLoader(store, batch_size=None, shuffle=True, num_workers=2,
                                         persistent_workers=True)  # fmt: skip
    for _ in range(3):
        start, rows = time.perf_counter(), 0
        for _ in range(5):
            for chunk in loader:
                rows += len(chunk["distance"])
        print(
            f"DataLoader, two workers: {rows / (time.perf_counter() - start) / 1e6:.2f} million/s"
        )


def main(command, folder, count=None):
    if command == "simplify":
        simplify(folder, count)
    elif command == "variants":
        write_variants(Path(folder) / "meshes", int(count or 10_000))
    elif command == "throughput":
        throughput(Path(folder), int(count or 200))
    else:
        {"scale": scale, "labels": labels, "reading": reading}[command](Path(folder))


if __name__ == "__main__":
    main(*sys.argv[1:])
