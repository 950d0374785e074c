"""Build the cheapest field that meets the budget. Writes choice.zarr.zip."""

from pandis.choice import Chooser, QueryTimes
from pandis.distance import open_distance
from pandis.sampling import open_surface
from pandis.stage import stage

with stage(snakemake) as job:
    mesh, times = job.read("mesh", "mesh"), QueryTimes(job.note_file(job.input.times))
    engine = open_distance(mesh)
    where = job.checkpoint(), job.progress, job.log
    chooser = Chooser(mesh, engine, open_surface(mesh, engine), job.options, times, *where)
    arrays, attributes, finish = chooser.choose()
    job.write("choice", arrays, attributes | {"frame": mesh.attributes["frame"]})
    finish()
