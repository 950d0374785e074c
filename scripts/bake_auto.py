"""Search the size of one grid, and make it. Writes grid-{kind}-auto.zarr.zip."""

from pandis.evaluation.points import Points
from pandis.fields.sizing import Sizing
from pandis.geometry.distance import open_distance
from pandis.geometry.physical import Scale
from pandis.geometry.sampling import open_surface
from pandis.run.stage import stage

with stage(snakemake) as job:
    mesh = job.read("mesh", "mesh")
    engine, frame = open_distance(mesh), mesh.attributes["frame"]
    scale = Scale(job.options["size"], job.options["stiffness"])
    points = Points(open_surface(mesh, engine), engine, scale, job.options["seed"])
    sizing = Sizing(job.options["kind"], points, frame, job.options, job.progress, job.log)
    arrays, attributes = sizing.find()
    job.write("grid", arrays, attributes | {"frame": frame})
