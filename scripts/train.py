"""Train one network. Reads mesh.zarr.zip, samples.zarr.zip, writes model-{recipe}.zarr.zip."""

from pandis.evaluation.points import Points
from pandis.geometry.body import Body
from pandis.geometry.physical import Scale
from pandis.geometry.strata import Strata
from pandis.run.stage import stage
from pandis.training.sizing import train

with stage(snakemake) as job:
    mesh, samples = job.read("mesh", "mesh"), job.read("samples", "samples")
    body, own = Body.open(mesh), job.options
    strata = Strata(body.surface, body.distance, samples.attributes["law"])
    points = None
    if own.get("force_error") is not None:
        scale = Scale(own["size"], own["stiffness"])
        points = Points(body.surface, body.distance, scale, own["seed"])
    arguments = own, samples, strata, points, job.checkpoint(), job.progress, job.log
    arrays, attributes, finish = train(*arguments)
    job.write("model", arrays, attributes | {"frame": samples.attributes["frame"]})
    finish()
