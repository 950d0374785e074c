"""Search the size of one grid, and make it. Writes grid-{kind}-auto.zarr.zip."""

from pandis.distance import open_distance
from pandis.fields.sizing import Sizing
from pandis.sampling import open_surface
from pandis.stage import stage

with stage(snakemake) as job:
    mesh = job.read("mesh", "mesh")
    engine, frame = open_distance(mesh), mesh.attributes["frame"]
    surface, kind = open_surface(mesh, engine), job.options["kind"]
    sizing = Sizing(kind, engine, surface, frame, job.options, job.progress, job.log)
    arrays, attributes = sizing.find()
    job.write("grid", arrays, attributes | {"frame": frame})
