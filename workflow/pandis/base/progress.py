"""What long work reports to: a line of text, or how much is done."""

from pathlib import Path
from typing import NamedTuple, Protocol, runtime_checkable


@runtime_checkable
class Log(Protocol):
    """Takes lines of text."""

    def __call__(self, text: str) -> None:
        """Write a line."""


@runtime_checkable
class Report(Protocol):
    """Takes the progress of one computation."""

    def resume(self, done: float) -> None:
        """Set the amount that an earlier run finished, which rates do not count."""

    def update(self, done: float, note: str = "") -> None:
        """Report the amount that is finished."""


@runtime_checkable
class Progress(Protocol):
    """Begins reports."""

    def __call__(self, what: str, total: float, unit: str = "points") -> Report:
        """Return a report of a computation, given its name and its amount of work in a unit."""


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
