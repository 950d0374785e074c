"""How much the force of the default spline changes from step to step along inward rays.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/rays.py

Rays go from 4,000 surface points straight in, to 8.25 mm or 0.9 of the inscribed radius if that is
less, in steps of 0.028 mm (10 cm, 400 N/m: an exact wall changes by 0.011 N a step). Printed for
the bunny, the torus and, where it is at hand, the fandisk: the share of the steps above 0.017 N
and above 0.05 N, the largest, and the share within 0.8 of the inscribed radius.
"""

import os
import sys
from pathlib import Path

import numpy as np
import trimesh

from pandis.base.forces import penalty_force
from pandis.base.frame import UNIT
from pandis.base.physical import Scale
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.geometry.thickness import inscribed_radius
from pandis.pipeline.kinds.spline.lattices import SplineFit, samples_for
from pandis.pipeline.kinds.spline.reference import SplineField
from pandis.pipeline.run.ask.sourcing import source_path
from pandis.pipeline.run.job.artifact import Artifact
from pandis.pipeline.run.job.stage import silent_progress

RAYS, STEP, DEEPEST, BYTES = 4000, 0.028e-3, 8.25e-3, 800_000
SCALE = Scale(0.1, 400.0)


def steps(answer, body, rays=RAYS):
    """Return the change of force (N) over every step, and how deep it is by the radius there."""
    rng = np.random.default_rng(3)
    feet, outward, _, _ = body.surface.draw(rays, rng)
    radius = inscribed_radius(body.distance, feet, outward)
    ends, step = np.minimum(DEEPEST * SCALE.metre, 0.9 * radius), STEP * SCALE.metre
    counts = np.ceil(ends / step).astype(int) + 1
    ray = np.repeat(np.arange(rays), counts)
    index = np.concatenate([np.arange(count) for count in counts])
    depth = np.minimum(index * step, ends[ray])
    force = penalty_force(*answer(feet[ray] - depth[:, None] * outward[ray])) * SCALE.newtons
    change = np.linalg.norm(np.diff(force, axis=0), axis=1)
    same = ray[1:] == ray[:-1]
    return change[same], (depth[1:] / radius[ray[1:]])[same]


def fitted(body, budget=BYTES):
    """Return the spline of a budget of bytes."""
    fit = SplineFit(body, (0.045, 0.02), 7, count=samples_for(budget=budget))
    arrays, attributes = fit.build(fit.choose_size(budget), budget, silent_progress)
    attributes |= UNIT.attributes()
    return SplineField("spline-auto", Artifact("grid", arrays, attributes))


def main():
    """Measure and print."""
    bunny = trimesh.load(source_path("pymeshlab:bunny.obj"), process=False)
    meshes = {"bunny": (bunny.vertices, bunny.faces), "torus": SHAPES["torus"].tessellation()}
    folder = os.environ.get("PANDIS_MESHES")
    if folder:
        path = Path(folder) / "watertight/fandisk_6475v_12946f.obj"
        found = trimesh.load(path, process=False)
        meshes["fandisk"] = found.vertices, found.faces
    for name, (corners, faces) in meshes.items():
        body = Body(np.asarray(corners, float), np.asarray(faces))
        change, depth = steps(fitted(body).answer, body)
        within = change[depth < 0.8]
        print(
            f"{name}: {100 * (change > 0.017).mean():.3f} % above 0.017 N, "
            f"{100 * (change > 0.05).mean():.4f} % above 0.05 N, largest {change.max():.3f} N; "
            f"within 0.8 of the radius {100 * (within > 0.017).mean():.3f} %, "
            f"largest {within.max():.3f} N"
        )


if __name__ == "__main__":
    sys.exit(main())
