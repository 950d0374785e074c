"""Packs a mesh on a lattice with a given number of bits."""

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.compact.packing import build_compact


def build(job):
    """Pack one mesh, and write ``compact-{bits}.zarr.zip``.

    Raises
    ------
    PandisError
        This number of bits leaves no face, or puts some points on the wrong side of the surface.
    """
    body, task = Body.open(job.read("mesh", "mesh")), job.options
    arrays, record = build_compact(body, task.bits, task.seed, log=job.log)
    job.write("compact", arrays, record.attributes() | body.frame.attributes())
