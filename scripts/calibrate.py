"""Time every kind of field on this machine. Writes query-times.csv and config/query-times.csv."""

from pathlib import Path

from pandis.base.files import write_atomically
from pandis.pipeline.judge.timing.calibration import calibrate
from pandis.pipeline.run.ask.tasks import CalibrateTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, CalibrateTask) as job:
    table = calibrate(job.progress).encode()
    job.write_file(table)
    write_atomically(Path(job.options.table), table)  # the table that `choose` reads
