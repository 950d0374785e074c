"""Search bits and faces of a compact mesh, and pack it. Writes compact-auto.zarr.zip."""

from pandis.evaluation.points import Points
from pandis.fields.compact_sizing import CompactSizing
from pandis.geometry.body import Body
from pandis.geometry.physical import Scale
from pandis.run.stage import stage
from pandis.run.tasks import BakeCompactAutoTask

with stage(snakemake, BakeCompactAutoTask) as job:
    mesh = job.read("mesh", "mesh")
    body = Body.open(mesh)
    scale = Scale.of(job.options)
    points = Points(body.surface, body.distance, scale, job.options.seed)
    sizing = CompactSizing(body, points, job.options, job.log)
    arrays, attributes = sizing.find()
    job.write("compact", arrays, attributes | body.frame.attributes())
