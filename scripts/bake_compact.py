"""Pack one mesh on a lattice. Reads mesh.zarr.zip, writes compact-{bits}.zarr.zip."""

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.compact.build import build_compact
from pandis.pipeline.run.ask.tasks import BakeCompactTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, BakeCompactTask) as job:
    mesh = job.read("mesh", "mesh")
    body, task = Body.open(mesh), job.options
    arrays, record = build_compact(body, task.bits, task.seed, job.log)
    job.write("compact", arrays, record.attributes() | body.frame.attributes())
