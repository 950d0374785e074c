"""Time every kind of field on this machine. Writes query-times.csv, and config/query-times.csv."""

from pathlib import Path

from pandis.evaluation.calibration import calibrate
from pandis.run.artifact import write_atomically
from pandis.run.stage import stage
from pandis.run.tasks import CalibrateTask

with stage(snakemake, CalibrateTask) as job:
    table = calibrate(job.progress).encode()
    job.write_file(table)
    write_atomically(Path(job.options.table), table)  # the table that choices go by
