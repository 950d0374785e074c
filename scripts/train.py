"""Train one network. Reads mesh.zarr.zip, samples.zarr.zip, writes model-{recipe}.zarr.zip."""

from pandis.base.physical import Scale
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.strata import Strata
from pandis.pipeline.judge.errors.points import Points
from pandis.pipeline.kinds.network.build import train
from pandis.pipeline.run.ask.tasks import TrainTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, TrainTask) as job:
    mesh, samples = job.read("mesh", "mesh"), job.read("samples", "samples")
    body, task = Body.open(mesh), job.options
    points = Points(body.surface, body.distance, Scale.of(task), task.seed)
    strata = Strata.of(body, samples)
    arguments = task, samples, strata, points, job.checkpoint(), job.progress, job.log
    arrays, attributes, finish = train(*arguments)
    job.write("model", arrays, attributes | body.frame.attributes())
    finish()
