"""Processes, schedulers and the end of a run."""
