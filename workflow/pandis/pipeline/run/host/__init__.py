"""What surrounds the jobs: processes, schedulers, the end of a run."""
