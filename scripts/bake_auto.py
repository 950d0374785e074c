"""Search the size of one grid, and make it. Writes grid-{kind}-auto.zarr.zip."""

from pandis.evaluation.points import Points
from pandis.fields.sizing import Sizing
from pandis.geometry.body import Body
from pandis.geometry.physical import Scale
from pandis.run.stage import stage

with stage(snakemake) as job:
    mesh = job.read("mesh", "mesh")
    body, frame = Body.open(mesh), mesh.attributes["frame"]
    scale = Scale(job.options["size"], job.options["stiffness"])
    points = Points(body.surface, body.distance, scale, job.options["seed"])
    sizing = Sizing(job.options["kind"], points, frame, job.options, job.progress, job.log)
    arrays, attributes = sizing.find()
    job.write("grid", arrays, attributes | {"frame": frame})
