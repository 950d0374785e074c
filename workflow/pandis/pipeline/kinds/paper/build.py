"""Builds the support planes of a mesh."""

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.paper.maps import build_planes


def build(job):
    """Build the support planes of a mesh, and write ``method-support-planes.zarr.zip``."""
    body = Body.open(job.read("mesh", "mesh"))
    arrays = build_planes(body.corners, body.distance, job.progress)
    job.write("planes", arrays, body.frame.attributes())
