"""Newton's own bake of distances against ours, both as Newton reads them; prints a table.

Usage: [PANDIS_MESHES=FOLDER] .venv/bin/python tests/benchmarks/cooked.py FOLDER [RESOLUTION...]

FOLDER keeps what is asked: {mesh}.npz with vertices and faces (unit frame) and probes with their
exact answers, and {mesh}.pandis; what it lacks is made, which needs PANDIS_MESHES. Where there is a
CUDA device Newton bakes there, and both files are read through Newton's own textures and its own
sampler; elsewhere its functions bake on Warp's CPU backend, and what they made is read in NumPy.
Everything that Newton is asked is its default, but for the resolution. Errors are those of penalty
forces (k = 1), in thousandths of the unit frame: mean and 99th percentile.
"""

import os
import sys
import tempfile
import time
from pathlib import Path
from unittest import mock

import newton
import numpy as np
import warp as wp
from common import SCANS, load
from newton._src.geometry import _sdf_cache, sdf_texture

from pandis.base.forces import penalty_force
from pandis.bridges.newton import cook
from pandis.bridges.newton.reading import sample
from pandis.runtime.field import NativeField

COLUMNS = "mesh,resolution,nodes,device,mb,seconds,shallow,shallow_p99,deep,deep_p99"
COUNT = 20_000


def prepare(name, folder):
    """Write what is asked of a mesh."""
    from bodies import UNIT, file_of

    from pandis.pipeline.geometry.body import Body
    from pandis.pipeline.geometry.sampling import probes

    vertices, faces = load(SCANS[name])
    body = Body(vertices, faces, UNIT)
    held = {"vertices": vertices, "faces": faces}
    for kind, columns in probes(body, COUNT, seed=1).items():
        held |= dict(zip((kind, f"{kind}_d", f"{kind}_n"), columns, strict=True))
    np.savez(folder / f"{name}.npz", **held)
    (folder / f"{name}.pandis").write_bytes(file_of(body, "exact"))


def baked(mesh, resolution, folder):
    """Let Newton bake a mesh into the folder, without a GPU if there is none."""
    if wp.is_cuda_available():
        newton.SDF.create_from_mesh(mesh, max_resolution=resolution, cache_dir=folder)
        return next(Path(folder).glob("*.npz"))
    with wp.ScopedDevice("cpu"):
        made = {}
        kept = wp.array(mesh.vertices, dtype=wp.vec3), wp.array(mesh.indices, dtype=wp.int32)

        def instead(data, *_):  # textures are for GPUs alone
            made.update(data)
            return mock.MagicMock(), None, None

        with mock.patch.object(sdf_texture, "create_sparse_sdf_textures", instead):
            sdf_texture.create_texture_sdf_from_mesh(
                wp.Mesh(*kept), max_resolution=resolution, device="cpu",
                sign_mode=sdf_texture.SIGN_MODE_PARITY,
            )  # fmt: skip
    return _sdf_cache.save_sparse_data(folder, "own", made)


@wp.kernel
def _sample(
    sdf: sdf_texture.TextureSDFData,
    points: wp.array(dtype=wp.vec3),
    distances: wp.array(dtype=float),
    gradients: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    distance, gradient = sdf_texture.texture_sample_sdf_grad(sdf, points[i])
    distances[i] = distance
    gradients[i] = gradient


def reader(path, mesh, resolution):
    """Return what answers points (n, 3) with distances and gradients, from a file."""
    if not wp.is_cuda_available():
        return lambda points: sample(np.load(path), points)
    baked_anew = mock.patch.object(  # a file that is not read must not pass for one that is
        sdf_texture, "create_texture_sdf_from_mesh", side_effect=AssertionError("not read")
    )
    with baked_anew:
        sdf = newton.SDF.create_from_mesh(mesh, max_resolution=resolution, cache_dir=path.parent)

    def answers(points):
        at = wp.array(points.astype(np.float32), dtype=wp.vec3)
        out = wp.empty(len(points), dtype=float), wp.empty(len(points), dtype=wp.vec3)
        wp.launch(_sample, len(points), [sdf.texture_data, at], list(out))
        return out[0].numpy().astype(float), out[1].numpy().astype(float)

    return answers


def errors(answers, held):
    """Return mean and 99th percentile of the force's error, by kind of probe."""
    found = []
    for kind in ("shallow", "deep"):
        distance, gradient = answers(held[kind])
        length = np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-12)
        exact = penalty_force(held[f"{kind}_d"], held[f"{kind}_n"])
        off = np.linalg.norm(penalty_force(distance, gradient / length) - exact, axis=1)
        found += [1e3 * off.mean(), 1e3 * np.percentile(off, 99)]
    return found


def main():
    folder, *resolutions = sys.argv[1:]
    folder, where = Path(folder), "cuda" if wp.is_cuda_available() else "cpu"
    folder.mkdir(parents=True, exist_ok=True)
    wp.config.quiet = True
    print(COLUMNS)
    for name in SCANS:
        if "PANDIS_MESHES" in os.environ and not (folder / f"{name}.pandis").exists():
            prepare(name, folder)
        if not (folder / f"{name}.pandis").exists():
            continue
        held, field = np.load(folder / f"{name}.npz"), NativeField(folder / f"{name}.pandis")
        mesh = newton.Mesh(
            held["vertices"].astype(np.float32), held["faces"].ravel(), compute_inertia=False
        )
        for resolution in map(int, resolutions or (64, 128)):
            for nodes in ("newton", "ours, distances", "ours, fitted"):
                with tempfile.TemporaryDirectory() as there:
                    start = time.perf_counter()
                    if nodes == "newton":
                        path = baked(mesh, resolution, there)
                    else:
                        fitted = nodes.endswith("fitted")
                        path = cook(field, mesh, there, max_resolution=resolution, fitted=fitted)
                    taken = time.perf_counter() - start
                    off = errors(reader(path, mesh, resolution), held)
                    size = sum(part.nbytes for part in np.load(path).values()) / 1e6
                numbers = ",".join(f"{number:.4g}" for number in (size, taken, *off))
                print(f'{name},{resolution},"{nodes}",{where},{numbers}', flush=True)


if __name__ == "__main__":
    main()
