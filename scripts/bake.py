"""Evaluate one grid. Reads mesh.zarr.zip, writes grid-{content}-{size}.zarr.zip."""

from pandis.baking import bake, grid_attributes
from pandis.distance import open_distance
from pandis.stage import stage

with stage(snakemake) as job:
    mesh = job.read("mesh", "mesh")
    content, size = job.options["content"], job.options["size"]
    values = bake(open_distance(mesh), content, size, job.progress)
    attributes = grid_attributes(content, size) | {"frame": mesh.attributes["frame"]}
    chunk = (*[min(job.options["chunk"], size)] * 3, values.shape[3])
    job.write("grid", {"values": values}, attributes, chunks={"values": chunk})
