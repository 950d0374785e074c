"""Lay support planes around a mesh. Writes method-support-planes.zarr.zip."""

from pandis.geometry.distance import open_distance
from pandis.geometry.frame import Frame
from pandis.grids.planes import build_planes
from pandis.run.stage import stage

with stage(snakemake) as job:
    mesh = job.read("mesh", "mesh")
    frame = mesh.attributes["frame"]
    vertices = Frame.from_attributes(frame).to_unit(mesh.arrays["vertices"])
    arrays = build_planes(vertices, open_distance(mesh), job.progress)
    job.write("planes", arrays, {"frame": frame})
