"""A collection of many meshes: planning, an interrupted run, what becomes of each; prints figures.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/many.py FOLDER [COUNT [FACES]]

In FOLDER it writes COUNT variants (500 by default) of the meshes of PANDIS_MESHES, simplified to at
most FACES faces (2,000), turned and scaled, or, where no program here can do that, as they are; and
runs `until: exports` with compact fields on them. The run is killed at three places (after a tenth,
a quarter and two fifths of all files that there might be) and started again. Printed are: the time
of a plan and of a run that has nothing to do, their memory, the time of the whole, the page's size,
and whether every mesh stands in the table, with a file or a reason.
"""

import csv
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pymeshlab
import trimesh
import yaml
from common import ROOT

ENDINGS = {".ply", ".obj", ".stl", ".off", ".3mf", ".glb", ".gltf", ".dae"}
#: Of three files for each mesh, though many meshes are so broken that none comes of them.
KILLED = 0.1, 0.25, 0.4


def simplify(path, faces, target):
    """Write a mesh of at most so many faces; in a process of its own, for some files crash it."""
    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(path)
    if meshes.current_mesh().face_number() > int(faces):
        meshes.meshing_decimation_quadric_edge_collapse(targetfacenum=int(faces))
    meshes.save_current_mesh(target)


def simplified(path, faces, target):
    """Return a mesh of at most so many faces, or None if the file cannot be read here."""
    command = [sys.executable, __file__, "simplify", str(path), str(faces), str(target)]
    if subprocess.run(command, capture_output=True, check=False).returncode:
        return None
    return trimesh.load(target, force="mesh", process=False)


def write_variants(folder, count, faces):
    """Write meshes and configuration."""
    sources = sorted(p for p in Path(os.environ["PANDIS_MESHES"]).rglob("*")
                     if p.suffix.lower() in ENDINGS)  # fmt: skip
    read, meshes, rng = {}, {}, np.random.default_rng(0)
    (folder / "meshes").mkdir(parents=True)
    for number in range(count):
        source = sources[number % len(sources)]
        if source not in read:
            read[source] = simplified(source, faces, folder / f"meshes/source{len(read)}.ply")
        mesh, name = read[source], f"m{number:04}"
        if mesh is None or not len(mesh.faces):
            path = folder / "meshes" / f"{name}{source.suffix}"
            shutil.copy(source, path)
        else:
            path = folder / "meshes" / f"{name}.ply"
            turn = trimesh.transformations.random_rotation_matrix(rng.random(3))
            turned = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
            turned.apply_transform(turn).apply_scale(np.exp(rng.normal()))
            turned.export(path)
        meshes[name] = {"source": str(path.relative_to(folder))}
    asked = {"until": "exports", "fields": ["compact-16"], "meshes": meshes}
    (folder / "config/many.yaml").write_text(yaml.safe_dump(asked, sort_keys=False))


def snakemake(folder, *arguments):
    """Return a running Snakemake whose output goes to a log."""
    command = [sys.executable, "-m", "snakemake", "--configfile", "config/many.yaml", *arguments]
    log = (folder / "log").open("a")
    return subprocess.Popen(command, cwd=folder, stdout=log, stderr=log, start_new_session=True)


def timed(folder, *arguments):
    """Return how long a command takes."""
    start = time.monotonic()
    snakemake(folder, *arguments).wait()
    return time.monotonic() - start


def main(folder, count=500, faces=2000):
    folder, count = Path(folder), int(count)
    for part in ("workflow", "rules", "scripts", "config"):
        shutil.copytree(ROOT / part, folder / part)
    write_variants(folder, count, int(faces))
    print(f"plan: {timed(folder, '-n', '-q', 'all', '--', 'all'):.1f} s", flush=True)
    start, jobs = time.monotonic(), 3 * count
    for share in KILLED:
        run = snakemake(folder, "-j2", "--", "all")
        while run.poll() is None and done(folder) < share * jobs:
            time.sleep(0.2)
        os.killpg(run.pid, signal.SIGKILL)
        run.wait()
        print(f"killed after {done(folder)} of about {jobs} files", flush=True)
        snakemake(folder, "--unlock").wait()
    run = snakemake(folder, "-j2", "--", "all")
    status = run.wait()
    print(f"the whole: {time.monotonic() - start:.0f} s, status {status}", flush=True)
    rows = [*csv.DictReader((folder / "results/collection.csv").open(encoding="utf-8"))]
    refused = {row["mesh"]: row["refused"] for row in rows if row.get("refused")}
    built = {row["mesh"] for row in rows if row["file"]}
    if built & {*refused} or len(built | {*refused}) != count:
        raise SystemExit(f"of {count} meshes {len(built)} are built and {len(refused)} refused")
    page = (folder / "results/collection.html").stat().st_size / 1e6
    print(f"{len(built)} built, {len(refused)} refused; page of {page:.1f} MB")
    for why in sorted({why.split(": ", 1)[-1][:100] for why in refused.values()}):
        print(f"  {why}")
    asked = yaml.safe_load((folder / "config/many.yaml").read_text())
    asked["meshes"] = {name: of for name, of in asked["meshes"].items() if name in built}
    (folder / "config/many.yaml").write_text(yaml.safe_dump(asked, sort_keys=False))
    print(f"with {len(built)} meshes: the table {timed(folder, '-j2', '--', 'all'):.1f} s, then")
    print(f"nothing to do: {timed(folder, '-j2', '--', 'all'):.1f} s")
    most = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3
    print(f"most memory of a process: {most:.0f} MB")


def done(folder):
    """Return how many results there are."""
    return sum(1 for p in (folder / "results").glob("m*/**/*") if p.suffix in (".zip", ".pandis"))


if __name__ == "__main__":
    (simplify if sys.argv[1] == "simplify" else main)(*sys.argv[1 + (sys.argv[1] == "simplify") :])
