"""Fill one grid. Reads mesh.zarr.zip, writes grid-{content}-{size}.zarr.zip."""

from pandis.geometry.body import Body
from pandis.grids.dense import DenseGrid
from pandis.run.stage import stage

with stage(snakemake) as job:
    mesh = job.read("mesh", "mesh")
    content, size, band, chunk = (job.options[k] for k in ("content", "size", "band", "chunk"))
    grid = DenseGrid(Body.open(mesh).distance, content, size, band, job.progress)
    attributes = grid.attributes() | {"frame": mesh.attributes["frame"]}
    slabs = ({"values": slab} for slab in grid.slabs(chunk))
    job.write_pieces("grid", {"values": grid.column(chunk)}, slabs, attributes)
