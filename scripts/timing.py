"""Time all fields of a mesh. Writes timing.zarr.zip."""

from pandis.pipeline.judge.timing.timing import time_fields, time_program
from pandis.pipeline.kinds.opening import open_fields
from pandis.pipeline.run.ask.tasks import TimingTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, TimingTask) as job:
    mesh = job.read("mesh", "mesh")
    points = job.read("trajectory", "trajectory").arrays["points"]
    files = [job.note_file(path) for path in (*job.input.exports, *job.input.natives)]
    fields = open_fields(job.options.in_python, mesh, map(job.read_input, job.input.fields))
    arrays, attributes = time_fields(
        fields,
        files,
        fields.body,
        points=points,
        options=job.options,
        progress=job.progress,
    )
    for path in map(job.note_file, job.input.programs):
        arrays |= time_program(
            path, mesh, points, options=job.options, figures=attributes["fields"], log=job.log
        )
    job.write("timing", arrays, attributes)
