"""Run every exported field of a mesh at the servo rate. Writes hardware.zarr.zip and .json."""

from pandis.hardware.validation import validate_exports
from pandis.stage import stage

with stage(snakemake) as job:
    trajectory = job.read("trajectory", "trajectory")
    evaluation = job.read("evaluation", "evaluation")
    exports = [job.note_file(path) for path in job.input.exports]
    arrays, attributes, text = validate_exports(
        exports, trajectory, evaluation, job.mesh, job.options, job.progress
    )
    job.write("hardware", arrays, attributes)
    job.write_file(text.encode(), index=1)
