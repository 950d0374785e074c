"""Compare all fields of a mesh with the exact one. Writes evaluation.zarr.zip."""

import numpy as np

from pandis.evaluation.coverage import coverage
from pandis.evaluation.errors import evaluate
from pandis.evaluation.paths import over_paths, several
from pandis.evaluation.view import surface_errors
from pandis.fields.controls import controls
from pandis.fields.registry import open_fields
from pandis.geometry.measure import draw_contacts
from pandis.geometry.physical import Scale
from pandis.geometry.sampling import probes
from pandis.run.stage import stage
from pandis.streams import CONTACTS, generator

with stage(snakemake) as job:
    mesh = job.read("mesh", "mesh")
    trajectory = job.read("trajectory", "trajectory").arrays
    fields = open_fields(job.options["fields"], mesh, map(job.read_input, job.input.fields))
    surface, engine, seed = fields.body.surface, fields.body.distance, job.options["seed"]
    sets = probes(surface, engine, job.options["probes"], seed)
    path = tuple(trajectory[key] for key in ("points", "distance", "normal"))
    scale = Scale(job.options["size"], job.options["stiffness"])
    rng = generator(seed, CONTACTS)
    contacts = draw_contacts(surface, engine, scale, job.options["probes"], rng, even=True)
    tried = controls(fields.exact, surface, scale)
    arrays, attributes = evaluate(fields, tried, path, sets, contacts, job.progress)
    corners, faces = fields.body.corners, fields.body.faces
    arrays |= surface_errors(fields, engine, corners, faces, job.progress)
    paths = several(path, surface, engine, job.options, job.progress)
    arrays["paths"] = np.array([points for points, _, _ in paths], np.float32)
    attributes["coverage"] = coverage(surface, engine, arrays["paths"], seed)
    attributes["paths"] = over_paths(fields, paths) if len(paths) > 1 else {}
    physical = {key: job.options[key] for key in ("size", "stiffness")}
    physical |= {"newtons": scale.newtons, "count": len(paths)}
    job.write("evaluation", arrays, attributes | physical | {"frame": mesh.attributes["frame"]})
