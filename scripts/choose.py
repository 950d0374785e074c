"""Build the cheapest field that meets the budget. Writes choice.zarr.zip."""

from pandis.evaluation.choice import Chooser
from pandis.evaluation.points import Points
from pandis.geometry.body import Body
from pandis.geometry.physical import Scale
from pandis.run.query_times import QueryTimes
from pandis.run.stage import stage

with stage(snakemake) as job:
    mesh, times = job.read("mesh", "mesh"), QueryTimes(job.note_file(job.input.times))
    body, own = Body.open(mesh), job.options
    scale = Scale(own["stress"]["size"], own["stress"]["stiffness"])
    points = Points(body.surface, body.distance, scale, own["seed"])
    where = job.checkpoint(), job.progress, job.log
    arrays, attributes, finish = Chooser(body, points, own, times, *where).choose()
    job.write("choice", arrays, attributes | {"frame": mesh.attributes["frame"]})
    finish()
