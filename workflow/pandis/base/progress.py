"""Interfaces through which long computations report: lines of text, and progress."""

from pathlib import Path
from typing import NamedTuple, Protocol, runtime_checkable


@runtime_checkable
class Log(Protocol):
    """Receives lines of text."""

    def __call__(self, text: str) -> None:
        """Write a line."""


@runtime_checkable
class Report(Protocol):
    """Receives the progress of one computation."""

    def resume(self, done: float) -> None:
        """Set the amount that an earlier run finished; rates exclude it."""

    def update(self, done: float, note: str = "") -> None:
        """Report the amount finished so far."""


@runtime_checkable
class Progress(Protocol):
    """Creates reports."""

    def __call__(self, what: str, total: float, unit: str = "points") -> Report:
        """Return a progress report for a computation, given its name, total work and its unit."""


class Context(NamedTuple):
    """Where a resumable computation keeps its state, and where it reports.

    Attributes
    ----------
    checkpoint : path-like
        File for the state of an unfinished run.
    progress : Progress
    log : Log
    """

    checkpoint: Path
    progress: Progress
    log: Log
