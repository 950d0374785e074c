"""Train one network. Reads mesh.zarr.zip, samples.zarr.zip, writes model-{recipe}.zarr.zip."""

from pandis.evaluation.points import Points
from pandis.geometry.distance import open_distance
from pandis.geometry.physical import Scale
from pandis.geometry.sampling import open_surface
from pandis.geometry.strata import Strata
from pandis.run.stage import stage
from pandis.training.sizing import train

with stage(snakemake) as job:
    mesh, samples = job.read("mesh", "mesh"), job.read("samples", "samples")
    engine = open_distance(mesh)
    surface, own = open_surface(mesh, engine), job.options
    strata = Strata(surface, engine, samples.attributes["law"])
    points = None
    if own.get("force_error") is not None:
        points = Points(surface, engine, Scale(own["size"], own["stiffness"]), own["seed"])
    arguments = own, samples, strata, points, job.checkpoint(), job.progress, job.log
    arrays, attributes, finish = train(*arguments)
    job.write("model", arrays, attributes | {"frame": samples.attributes["frame"]})
    finish()
