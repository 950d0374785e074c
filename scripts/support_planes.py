"""Lay support planes around a mesh. Writes method-support-planes.zarr.zip."""

from pandis.geometry.body import Body
from pandis.grids.planes import build_planes
from pandis.run.stage import stage
from pandis.run.tasks import SupportPlanesTask

with stage(snakemake, SupportPlanesTask) as job:
    mesh = job.read("mesh", "mesh")
    body = Body.open(mesh)
    arrays = build_planes(body.corners, body.distance, job.progress)
    job.write("planes", arrays, body.frame.attributes())
