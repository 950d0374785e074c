"""Search the size of one grid, and make it. Writes grid-{kind}-auto.zarr.zip."""

from pandis.base.physical import Scale
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.judge.errors.points import Points
from pandis.pipeline.kinds.sizing import Sizing
from pandis.pipeline.run.ask.tasks import BakeAutoTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, BakeAutoTask) as job:
    mesh = job.read("mesh", "mesh")
    body = Body.open(mesh)
    scale = Scale.of(job.options)
    points = Points(body.surface, body.distance, scale, job.options.seed)
    sizing = Sizing(points, body.frame, job.options, job.progress, job.log)
    arrays, attributes = sizing.find()
    job.write("grid", arrays, attributes | body.frame.attributes())
