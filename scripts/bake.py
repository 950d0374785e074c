"""Fill one grid. Reads mesh.zarr.zip, writes grid-{content}-{size}.zarr.zip."""

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.grid.build import DenseGrid
from pandis.pipeline.run.ask.tasks import BakeTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, BakeTask) as job:
    mesh = job.read("mesh", "mesh")
    body, task = Body.open(mesh), job.options
    grid = DenseGrid(body.distance, task.content, task.size, task.band, job.progress)
    attributes = grid.attributes() | body.frame.attributes()
    slabs = ({"values": slab} for slab in grid.slabs(task.chunk))
    job.write_pieces("grid", {"values": grid.column(task.chunk)}, slabs, attributes)
