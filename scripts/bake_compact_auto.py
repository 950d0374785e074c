"""Search bits and faces of a compact mesh, and pack it. Writes compact-auto.zarr.zip."""

from pandis.base.physical import Scale
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.judge.errors.points import Points
from pandis.pipeline.kinds.compact.sizes import CompactSizing
from pandis.pipeline.run.ask.tasks import BakeCompactAutoTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, BakeCompactAutoTask) as job:
    mesh = job.read("mesh", "mesh")
    body = Body.open(mesh)
    scale = Scale.of(job.options)
    points = Points(body.surface, body.distance, scale, job.options.seed)
    sizing = CompactSizing(body, points, job.options, job.log)
    arrays, attributes = sizing.find()
    job.write("compact", arrays, attributes | body.frame.attributes())
