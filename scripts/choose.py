"""Build the cheapest field that meets the budget. Writes choice.zarr.zip."""

from pandis.evaluation.choice import Chooser
from pandis.evaluation.points import Points
from pandis.geometry.body import Body
from pandis.geometry.physical import Scale
from pandis.run.query_times import QueryTimes
from pandis.run.stage import stage
from pandis.run.tasks import ChooseTask

with stage(snakemake, ChooseTask) as job:
    mesh, times = job.read("mesh", "mesh"), QueryTimes(job.note_file(job.input.times))
    body = Body.open(mesh)
    points = Points(body.surface, body.distance, Scale.of(job.options), job.options.seed)
    where = job.checkpoint(), job.progress, job.log
    arrays, attributes, finish = Chooser(body, points, job.options, times, *where).choose()
    job.write("choice", arrays, attributes | body.frame.attributes())
    finish()
