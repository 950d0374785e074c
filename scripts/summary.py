"""Collect one row per mesh and field. Writes results/summary.csv."""

from pandis.pipeline.report.tables import summarise, to_csv
from pandis.pipeline.run.ask.tasks import SummaryTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, SummaryTask) as job:
    inputs = job.input
    columns = (inputs.evaluations, inputs.timings, inputs.stresses, inputs.hardware)
    read = ([job.read_path(path) for path in column] for column in columns)
    job.write_file(to_csv(summarise(read)).encode())
