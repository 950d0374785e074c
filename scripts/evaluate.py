"""Compare all fields of a mesh with the exact one. Writes evaluation.zarr.zip."""

from pandis.pipeline.judge.errors.comparison import compare
from pandis.pipeline.kinds.opening import open_fields
from pandis.pipeline.run.ask.tasks import EvaluateTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, EvaluateTask) as job:
    mesh = job.read("mesh", "mesh")
    trajectory = job.read("trajectory", "trajectory").arrays
    fields = open_fields(job.options.fields, mesh, map(job.read_input, job.input.fields))
    arrays, attributes = compare(fields, trajectory, job.options, progress=job.progress)
    job.write("evaluation", arrays, attributes | fields.body.frame.attributes())
