"""Builds a grid of a given size."""

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.grid.dense import DenseGrid


def build(job):
    """Compute the nodes of one grid, and write ``grid-{content}-{size}.zarr.zip``."""
    body, task = Body.open(job.read("mesh", "mesh")), job.options
    grid = DenseGrid(body.distance, task.content, task.size, band=task.band, progress=job.progress)
    attributes = grid.attributes() | body.frame.attributes()
    slabs = ({"values": slab} for slab in grid.slabs(task.chunk))
    job.write_pieces("grid", {"values": grid.column(task.chunk)}, slabs, attributes=attributes)
