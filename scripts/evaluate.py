"""Compare all fields of a mesh with the exact one. Writes evaluation.zarr.zip."""

from pandis.evaluation.comparison import compare
from pandis.fields.registry import open_fields
from pandis.run.stage import stage
from pandis.run.tasks import EvaluateTask

with stage(snakemake, EvaluateTask) as job:
    mesh = job.read("mesh", "mesh")
    trajectory = job.read("trajectory", "trajectory").arrays
    fields = open_fields(job.options.fields, mesh, map(job.read_input, job.input.fields))
    arrays, attributes = compare(fields, trajectory, job.options, job.progress)
    job.write("evaluation", arrays, attributes | fields.body.frame.attributes())
