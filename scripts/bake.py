"""Fill one grid. Reads mesh.zarr.zip, writes grid-{content}-{size}.zarr.zip."""

from pandis.geometry.body import Body
from pandis.grids.dense import DenseGrid
from pandis.run.stage import stage
from pandis.run.tasks import BakeTask

with stage(snakemake, BakeTask) as job:
    mesh = job.read("mesh", "mesh")
    body, task = Body.open(mesh), job.options
    grid = DenseGrid(body.distance, task.content, task.size, task.band, job.progress)
    attributes = grid.attributes() | body.frame.attributes()
    slabs = ({"values": slab} for slab in grid.slabs(task.chunk))
    job.write_pieces("grid", {"values": grid.column(task.chunk)}, slabs, attributes)
