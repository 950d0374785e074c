"""A mesh of ten million faces through the workflow; write docs/figures/large.csv.

Usage: .venv/bin/python tests/benchmarks/large.py [FACES]

Makes a torus with bumps, writes it as a binary PLY and runs the workflow for it, one job at a time:
intake, labels, and the `exact` and `compact-16` fields up to their exported files. Seconds are
those of Snakemake's benchmark files; the peak of the memory is that of a stage with its child
processes, looked at five times a second. A stage that takes more than 8 GiB ends in an error.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil
import yaml
from common import ROOT, write

sys.path.insert(0, str(ROOT / "tests/helpers"))

from support import copy_workflow, snakemake_command

FACES = 10_000_000
#: What a stage may take (MB): all of them are given as much.
MEMORY = 8192
MESH = "large"
#: Benchmark files of stages, in the order in which they run; what each does, and what it makes.
STAGES = {
    "mesh": ("reads, examines and checks", "mesh.zarr.zip"),
    "sample": ("labels", "samples.zarr.zip"),
    "bake-compact-16": ("packs, and compares sides", "compact-16.zarr.zip"),
    "export-compact-16-native": ("writes and checks the file", "export/compact-16.pandis"),
    "export-exact-native": ("writes and checks the file", "export/exact.pandis"),
}
RULES = "mesh", "sample", "bake", "export_native"
COLUMNS = "stage", "what", "faces", "seconds", "peak_mib", "mb", "bytes_per_face"
#: Seconds between two looks at the memory.
EVERY = 0.2


def bumpy_torus(faces):
    """Return the vertices (V, 3) and faces (F, 3) of a closed torus with bumps."""
    rows = round(np.sqrt(faces / 4))
    columns = -(-faces // (2 * rows))
    u, v = np.meshgrid(
        np.arange(columns) * (2 * np.pi / columns),
        np.arange(rows) * (2 * np.pi / rows),
        indexing="ij",
    )
    radius = 0.4 + 0.01 * np.sin(9 * u) * np.sin(7 * v) + 0.001 * np.sin(150 * u + 40 * v)
    out = 1 + radius * np.cos(v)
    vertices = np.stack([out * np.cos(u), out * np.sin(u), radius * np.sin(v)], axis=2)
    i, j = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
    a, b = i * rows + j, (i + 1) % columns * rows + j
    c, d = (i + 1) % columns * rows + (j + 1) % rows, i * rows + (j + 1) % rows
    pairs = np.stack([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)], axis=2)
    return vertices.reshape(-1, 3), pairs.reshape(-1, 3)


def write_ply(path, vertices, faces):
    """Write a binary PLY."""
    rows = np.empty(len(faces), [("count", "u1"), ("corners", "<i4", 3)])
    rows["count"], rows["corners"] = 3, faces
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    with path.open("wb") as stream:
        stream.write(header.encode())
        stream.write(vertices.astype("<f4").tobytes())
        stream.write(rows.tobytes())


def run(folder, target, *arguments):
    """Make a file with Snakemake; return the peak of what its jobs have in memory, in bytes."""
    process = subprocess.Popen(
        snakemake_command("-j1", "-c2", target, "--configfile", "large.yaml", *arguments),
        cwd=folder,
    )
    peak, snakemake = 0, psutil.Process(process.pid)
    while process.poll() is None:
        used = 0
        try:
            for child in snakemake.children(recursive=True):
                used += child.memory_info().rss
        except psutil.NoSuchProcess:  # it has just ended
            pass
        peak = max(peak, used)
        time.sleep(EVERY)
    if process.returncode:
        sys.exit("the run failed")
    return peak


def main():
    """Run the workflow, and write the table."""
    wanted, rows = int(sys.argv[1]) if len(sys.argv) > 1 else FACES, []
    with tempfile.TemporaryDirectory() as temporary:
        folder = copy_workflow(ROOT, Path(temporary) / "copy")
        vertices, faces = bumpy_torus(wanted)
        write_ply(folder / "large.ply", vertices, faces)
        options = {"fields": ["exact", "compact-16"], "meshes": {MESH: {"source": "large.ply"}}}
        (folder / "large.yaml").write_text(yaml.safe_dump(options))
        limits = "--set-resources", *(f"{rule}:mem_mb={MEMORY}" for rule in RULES)
        count = len(faces)
        del vertices, faces
        for stage, (what, target) in STAGES.items():
            peak = run(folder, f"results/{MESH}/{target}", *limits)
            benchmark = folder / "results" / "benchmarks" / MESH / f"{stage}.jsonl"
            figures = json.loads(benchmark.read_text().splitlines()[-1])
            size = (folder / "results" / MESH / target).stat().st_size
            row = {"stage": stage, "what": what, "faces": count, "seconds": round(figures["s"])}
            row |= {
                "peak_mib": round(peak / 2**20),
                "mb": size / 1e6,
                "bytes_per_face": size / count,
            }
            print(row, flush=True)
            rows.append(row)
        write("large", COLUMNS, rows)


if __name__ == "__main__":
    main()
