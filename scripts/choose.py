"""Build the cheapest field that meets the budget. Writes choice.zarr.zip."""

from pandis.base.physical import Scale
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.points import Points
from pandis.pipeline.judge.choice import Chooser
from pandis.pipeline.run.ask.tasks import ChooseTask
from pandis.pipeline.run.job.stage import stage
from pandis.pipeline.run.plan.query_times import QueryTimes

with stage(snakemake, ChooseTask) as job:
    mesh, times = job.read("mesh", "mesh"), QueryTimes(job.note_file(job.input.times))
    body = Body.open(mesh)
    points = Points(body, Scale.of(job.options), job.options.seed)
    chooser = Chooser(points, job.options, times, context=job.context())
    arrays, attributes, finish = chooser.choose()
    job.write("choice", arrays, attributes | body.frame.attributes())
    finish()
