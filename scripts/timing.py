"""Time all fields of a mesh. Reads mesh, trajectory and exports, writes timing.zarr.zip."""

from pandis.evaluation.timing import time_fields
from pandis.fields.exact import ExactField
from pandis.stage import stage

with stage(snakemake) as job:
    mesh = job.read("mesh", "mesh")
    points = job.read("trajectory", "trajectory").arrays["points"]
    exports = [job.note_file(path) for path in job.input.exports]
    field = ExactField("exact", mesh) if "exact" in job.options["fields"] else None
    job.write("timing", *time_fields(field, exports, mesh, points, job.options, job.progress))
