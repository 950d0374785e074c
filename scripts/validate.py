"""Run every exported field of a mesh at the servo rate. Writes hardware.zarr.zip and .json."""

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.judge.servo.validation import to_json, validate_exports
from pandis.pipeline.run.ask.tasks import ValidateTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, ValidateTask) as job:
    mesh = job.read("mesh", "mesh")
    trajectory = job.read("trajectory", "trajectory")
    evaluation = job.read("evaluation", "evaluation")
    exports = [job.note_file(path) for path in job.input.exports]
    arrays, attributes = validate_exports(
        exports,
        Body.open(mesh),
        trajectory=trajectory,
        evaluation=evaluation,
        options=job.options,
        context=job.context(),
    )
    job.write("hardware", arrays, attributes)
    job.write_file(to_json(job.mesh, attributes).encode(), index=1)
