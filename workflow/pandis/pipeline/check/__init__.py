"""Checks of finished results, and the report of a run that failed."""
