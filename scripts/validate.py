"""Run every exported field of a mesh at the servo rate. Writes hardware.zarr.zip and .json."""

from pandis.base.physical import Scale
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.judge.servo.passes import Oracle
from pandis.pipeline.judge.servo.validation import validate_exports
from pandis.pipeline.judge.servo.walls import open_walls
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.run.ask.tasks import ValidateTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, ValidateTask) as job:
    mesh = job.read("mesh", "mesh")
    trajectory = job.read("trajectory", "trajectory")
    evaluation = job.read("evaluation", "evaluation")
    exports = [job.note_file(path) for path in job.input.exports]
    body = Body.open(mesh)
    scale = Scale.of(job.options)
    walls = open_walls(ExactField("exact", body), scale, job.options.seed)
    oracle = Oracle(body.corners / scale.metre, body.faces)
    arrays, attributes, text = validate_exports(
        exports, walls, oracle, trajectory, evaluation, job.mesh, job.options, job.progress, job.log
    )
    job.write("hardware", arrays, attributes)
    job.write_file(text.encode(), index=1)
