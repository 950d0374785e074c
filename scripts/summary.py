"""Collect one row per mesh and field. Writes results/summary.csv."""

from pandis.report.tables import summarise, to_csv
from pandis.run.stage import stage
from pandis.run.tasks import SummaryTask

with stage(snakemake, SummaryTask) as job:
    inputs = job.input
    columns = (inputs.evaluations, inputs.timings, inputs.stresses, inputs.hardware)
    read = ([job.read_path(path) for path in column] for column in columns)
    job.write_file(to_csv(summarise(*read)).encode())
