"""Time all fields of a mesh. Writes timing.zarr.zip."""

from pandis.pipeline.judge.timing.timing import time_fields, time_program
from pandis.pipeline.kinds.opening import open_fields
from pandis.pipeline.run.ask.tasks import TimingTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, TimingTask) as job:
    mesh = job.read("mesh", "mesh")
    points = job.read("trajectory", "trajectory").arrays["points"]
    exports = [job.note_file(path) for path in job.input.exports]
    natives = [job.note_file(path) for path in job.input.natives]
    fields = open_fields(job.options.in_python, mesh, map(job.read_input, job.input.fields))
    arrays, attributes = time_fields(
        fields, exports, natives, fields.body, points, job.options, job.progress
    )
    for path in map(job.note_file, job.input.programs):
        arrays |= time_program(path, mesh, points, job.options, attributes["fields"], job.log)
    job.write("timing", arrays, attributes)
