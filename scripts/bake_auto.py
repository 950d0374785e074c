"""Search the size of one grid, and make it. Writes grid-{kind}-auto.zarr.zip."""

from pandis.evaluation.points import Points
from pandis.fields.sizing import Sizing
from pandis.geometry.body import Body
from pandis.geometry.physical import Scale
from pandis.run.stage import stage
from pandis.run.tasks import BakeAutoTask

with stage(snakemake, BakeAutoTask) as job:
    mesh = job.read("mesh", "mesh")
    body = Body.open(mesh)
    scale = Scale.of(job.options)
    points = Points(body.surface, body.distance, scale, job.options.seed)
    sizing = Sizing(points, body.frame, job.options, job.progress, job.log)
    arrays, attributes = sizing.find()
    job.write("grid", arrays, attributes | body.frame.attributes())
