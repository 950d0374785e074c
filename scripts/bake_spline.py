"""Fit one spline. Reads mesh.zarr.zip, writes grid-spline-{size}.zarr.zip."""

from pandis.geometry.body import Body
from pandis.grids.spline import SplineFit, samples_for
from pandis.run.stage import stage

with stage(snakemake) as job:
    mesh = job.read("mesh", "mesh")
    body = Body.open(mesh)
    size, band, seed = (job.options[k] for k in ("size", "band", "seed"))
    spline = SplineFit(body.distance, body.surface, band, seed, samples_for(size))
    arrays, attributes = spline.build(size, None, job.progress)
    job.write("grid", arrays, attributes | {"frame": mesh.attributes["frame"]})
