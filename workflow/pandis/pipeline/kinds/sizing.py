"""Finds the sizes of fields for which the user limits bytes or error instead of giving a size."""

from abc import ABC, abstractmethod
from typing import NamedTuple

from pandis.base.errors import PandisError
from pandis.base.forces import penalty_force
from pandis.base.physical import Scale
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.points import Points
from pandis.pipeline.kinds.field import Field
from pandis.pipeline.run.records.choice import Chosen

#: Fastest fall of any error, as a power of the spacing. Sizes that need a faster one are skipped.
_FASTEST = 4


class Candidate(NamedTuple):
    """A field that was built during a search.

    Attributes
    ----------
    field : pandis.pipeline.kinds.field.Field
    arrays, attributes : dict
        As stored in its artifact, except the frame.
    """

    field: Field
    arrays: dict
    attributes: dict

    def force(self, points):
        """Return the force (n, 3) at points (n, 3), unit frame, k = 1."""
        return penalty_force(*self.field.answer(points))


class Outcome(NamedTuple):
    """The field with which a kind meets the budget.

    Attributes
    ----------
    arrays, attributes : dict
        As in the field's own artifact.
    choice : pandis.pipeline.run.records.choice.Chosen
    finish : callable
        Must be called once the artifact is written.
    """

    arrays: dict
    attributes: dict
    choice: Chosen
    finish: object = lambda: None


class Maker(ABC):
    """Makes fields of one form, of any size. Kinds subclass it.

    Attributes
    ----------
    form : str
    points : pandis.pipeline.geometry.points.Points
        Points of the body, on which sizes are compared.
    sizes : tuple of int
        Sizes tried, from small to large.
    """

    form, sizes = "", ()

    @abstractmethod
    def make(self, size):
        """Return the `Candidate` of a size; None if the size is too small for the band."""

    @abstractmethod
    def largest(self, budget):
        """Return the largest size whose field fits into a budget of bytes; None if none does."""

    @abstractmethod
    def bytes_of(self, size):
        """Return the number of bytes that ``pandis.h`` needs to query a field of a size."""

    @abstractmethod
    def finer(self, size, other):
        """Return how many times finer the spacing of size ``other`` is than that of ``size``."""

    def hopeless(self, size, figures, limits, *, other):
        """Return whether the figures of one size show that another cannot meet the limits."""
        return figures["mean"] > limits.mean * self.finer(size, other) ** _FASTEST

    def never_meets(self, tried, limits, size):
        """Return whether tried (size, `Measured`) pairs show that a size cannot meet the limits."""
        return any(self.hopeless(s, m.figures, limits, other=size) for s, m in tried)


def points_of(job):
    """Return the `Points` on which a `SearchTask` job compares sizes."""
    task = job.options
    return Points(Body.open(job.read("mesh", "mesh")), Scale.of(task.device), task.seed)


def write_sized(job, maker, kind):
    """Find the size of one field, and write its artifact: see `search`."""
    arrays, attributes = search(maker, job.options, job.log)
    job.write(kind, arrays, attributes | maker.points.body.frame.attributes())


def search(maker, task, log):
    """Find the size of one field, for `…-auto`.

    Parameters
    ----------
    maker : Maker
    task : pandis.pipeline.run.ask.kind.SearchTask
    log : pandis.base.progress.Log

    Returns
    -------
    arrays, attributes : dict
        Arrays and attributes of the field; ``sizing`` lists the sizes that were tried.

    Raises
    ------
    PandisError
        No size meets the error limits, or fits into the given number of bytes.
    """
    points, target, what = maker.points, task.target, f"{maker.form}-auto (bake.auto.{maker.form})"
    if target.bytes is None:
        candidate, tried = _smallest(maker, points, target, what=what, log=log)
    else:
        size = maker.largest(target.bytes)
        candidate = None if size is None else maker.make(size)
        if candidate is None:
            raise PandisError(f"{what}: no size that covers the band fits into {target.bytes:,} B")
        tried = [(size, points.measure(candidate.force))]
    log(f"{maker.form}-auto: {points.describe(tried[-1][1].figures)}")
    return candidate.arrays, candidate.attributes | {"sizing": sizing_of(target, tried)}


def sizing_of(target, tried):
    """Return the artifact's record of a search, given (size, `Measured`) for each size tried."""
    figures = tried[-1][1].figures
    return {
        "asked": target.model_dump(include={"force_error", "tail", "missed", "bytes"}),
        "tried": [{"size": size, "force_error": one.figures["mean"]} for size, one in tried],
        "held_out_error": figures["mean"],
        "held_out": figures,
    }


def _smallest(maker, points, target, *, what, log):
    """Return the first candidate that meets the limits, and each (size, `Measured`) tried."""
    limits, tried = points.limits(target), []
    for size in maker.sizes:
        if maker.never_meets(tried, limits, size):
            continue
        candidate = maker.make(size)
        if candidate is None:
            log(f"{maker.form} of size {size:,}: does not cover the band")
            continue
        measured = points.measure(candidate.force, limits)
        tried.append((size, measured))
        log(f"{maker.form} of size {size:,}: {points.describe(measured.figures)}")
        if not measured.why:
            return candidate, tried
    if not tried:
        raise PandisError(f"{what}: no size covers the band: choose another kind of field")
    size, best = min(tried, key=lambda one: one[1].excess)
    raise PandisError(
        f"{what}: no size meets {points.describe_limits(limits)}; the closest, {size:,}, "
        f"{best.why}: relax the limits, or choose another kind of field"
    )
