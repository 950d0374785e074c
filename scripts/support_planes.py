"""Lay support planes around a mesh. Writes method-support-planes.zarr.zip."""

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.paper.maps import build_planes
from pandis.pipeline.run.ask.tasks import SupportPlanesTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, SupportPlanesTask) as job:
    mesh = job.read("mesh", "mesh")
    body = Body.open(mesh)
    arrays = build_planes(body.corners, body.distance, job.progress)
    job.write("planes", arrays, body.frame.attributes())
