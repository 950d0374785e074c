"""Collect one row per mesh and field. Writes results/summary.csv."""

from pandis.report.tables import summarise, to_csv
from pandis.stage import stage

with stage(snakemake) as job:
    columns = (job.input.evaluations, job.input.timings, job.input.hardware)
    read = ([job.read_path(path) for path in column] for column in columns)
    job.write_file(to_csv(summarise(*read)).encode())
