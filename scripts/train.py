"""Train one network. Reads mesh.zarr.zip, samples.zarr.zip, writes model-{recipe}.zarr.zip."""

from pandis.distance import open_distance
from pandis.sampling import open_surface
from pandis.stage import stage
from pandis.strata import Strata
from pandis.training.sizing import train

with stage(snakemake) as job:
    mesh, samples = job.read("mesh", "mesh"), job.read("samples", "samples")
    engine = open_distance(mesh)
    strata = Strata(open_surface(mesh, engine), engine, samples.attributes["law"])
    arguments = job.options, samples, strata, job.checkpoint(), job.progress, job.log
    arrays, attributes, finish = train(*arguments)
    job.write("model", arrays, attributes | {"frame": samples.attributes["frame"]})
    finish()
