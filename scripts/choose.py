"""Build the cheapest field that meets the budget. Writes choice.zarr.zip."""

from pandis.evaluation.choice import Chooser
from pandis.evaluation.points import Points
from pandis.geometry.distance import open_distance
from pandis.geometry.physical import Scale
from pandis.geometry.sampling import open_surface
from pandis.run.query_times import QueryTimes
from pandis.run.stage import stage

with stage(snakemake) as job:
    mesh, times = job.read("mesh", "mesh"), QueryTimes(job.note_file(job.input.times))
    engine, own = open_distance(mesh), job.options
    scale = Scale(own["stress"]["size"], own["stress"]["stiffness"])
    points = Points(open_surface(mesh, engine), engine, scale, own["seed"])
    where = job.checkpoint(), job.progress, job.log
    arrays, attributes, finish = Chooser(mesh, points, own, times, *where).choose()
    job.write("choice", arrays, attributes | {"frame": mesh.attributes["frame"]})
    finish()
