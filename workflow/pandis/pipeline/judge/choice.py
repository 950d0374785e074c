"""Finds the field for `fields: auto`: the cheapest one to build that meets the budget.

The exact mesh needs no building. A compact mesh has small errors and takes seconds to build; a grid
takes a second, a spline 15 seconds, a network minutes. Kinds are tried in this order, each from
small to large, and the search stops at the first suitable field. The chosen field meets the
budget on held-out points, and its file, read by ``pandis.h``, passes the stress suite.
"""

from pandis.base.errors import PandisError
from pandis.base.forces import force_of
from pandis.pipeline.geometry.measure import promise
from pandis.pipeline.geometry.shares import MISSING_LIMIT, THINNEST
from pandis.pipeline.judge.controls import controls, demand_failure
from pandis.pipeline.judge.stress.suite import PROXY_QUESTIONS, QUESTIONS, Suite, failures
from pandis.pipeline.kinds.exported import ExportedField
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.kinds.native import export_native
from pandis.pipeline.kinds.sizing import Outcome
from pandis.pipeline.run.ask.kinds import KINDS, kind_module
from pandis.pipeline.run.ask.options import NativeOptions
from pandis.pipeline.run.records.choice import ChoiceRecord, Chosen, Passed, ScaleRecord


class Chooser:
    """Finds the cheapest field that meets a budget.

    Parameters
    ----------
    points : pandis.pipeline.geometry.points.Points
        Points on which the body's fields are measured.
    options : pandis.pipeline.run.ask.tasks.ChooseTask
    times : pandis.pipeline.run.plan.query_times.QueryTimes
    context : pandis.base.progress.Context
        Training saves its state there.
    """

    def __init__(self, points, options, times, *, context):
        self.body, self.points, self.options, self.times = points.body, points, options, times
        self.context, self.progress, self.log = context, context.progress, context.log
        self.budget = options.budget
        self.limits = points.limits(self.budget)
        self.considered, self._nearest, self._suite = [], None, None

    def choose(self):
        """Choose a field, and return the content of ``choice.zarr.zip``.

        Returns
        -------
        arrays, attributes : dict
            Those of the chosen field. ``choice`` contains its name, error, bytes and query time;
            ``considered`` lists the rejected fields, with the reasons.
        finish : callable
            Function to call once the artifact is written.

        Raises
        ------
        PandisError
            No field meets the budget, or a control field does.
        """
        self.log(f"asked for: {self.points.describe_limits(self.limits)}")
        self._refuse_the_too_thin()
        self._try_controls()
        for name, kind in KINDS.items():
            try:
                field = kind_module(name, "choice").choose(self) if kind.chosen else None
            except ModuleNotFoundError as error:
                raise PandisError(
                    f"{self._refusal()}. A network might meet it, which needs the package "
                    f"{error.name}: pip install 'pandis-fields[workflow]'"
                ) from error
            if field:
                return field.arrays, field.attributes | self._record(field.choice), field.finish
        raise PandisError(self._refusal())

    def _refuse_the_too_thin(self):
        left_out = self.points.promising.left_out
        if left_out > MISSING_LIMIT:
            size = self.points.scale.size
            raise PandisError(
                f"{left_out:.2%} of the surface is thinner than {1e3 * THINNEST:g} mm under the "
                f"device ({MISSING_LIMIT:.1%} allowed), too thin for any field to be judged: make "
                f"device.size larger (it is {size:g} m), or name fields instead of `fields: auto`"
            )

    def _record(self, choice):
        scale = self.points.scale
        says = self.points.describe(choice.held_out)
        self.log(f"chosen: {choice.field}, {choice.bytes:,} bytes; it {says}")
        return ChoiceRecord(
            choice=choice,
            asked=self.budget.model_dump(),
            limits=self.limits._asdict(),
            considered=self.considered,
            scale=ScaleRecord(newtons=scale.newtons, mean_force=self.points.mean_force),
        ).attributes()

    def _refusal(self):
        reasons = "; ".join(f"{one.field}: {one.why}" for one in self.considered)
        nearest = ""
        if self._nearest:
            name, measured = self._nearest
            nearest = f" The nearest is {name}, which {measured.why}."
        return (
            f"no field meets the budget of {self.points.describe_limits(self.limits)}.{nearest} "
            f"Relax the budget: raise budget.force_error, budget.tail, budget.bytes or "
            f"budget.query_time. Fields considered: {reasons}"
        )

    def first(self, makers, name):
        """Return the `Outcome` of the smallest field that meets the budget, or None.

        Parameters
        ----------
        makers : list of pandis.pipeline.kinds.sizing.Maker
        name : str
            Template of a field's name, with ``form`` and ``size`` in braces.
        """
        sizes = [
            (maker.bytes_of(size), maker.form, maker, size)
            for maker in makers
            for size in self.fitting(maker.form, {n: maker.bytes_of(n) for n in maker.sizes})
        ]
        tried, best = {}, {}
        for bytes_, form, maker, size in sorted(sizes, key=lambda one: (one[0], one[1], one[3])):
            before = tried.setdefault(form, [])
            if maker.never_meets(before, self.limits, size):
                continue
            measured, candidate = self.measured(maker, size)
            if measured is None:
                continue
            before.append((size, measured))
            if not measured.why:
                called = name.format(form=form, size=size)
                choice = self.choice(called, bytes_, measured, seconds=self.time(form, size))
                return Outcome(candidate.arrays, candidate.attributes, choice)
            if form not in best or measured.excess < best[form][1].excess:
                best[form] = size, measured
        for form, (size, measured) in best.items():
            self.skip(form, f"at best, with size {size:,}, {measured.why}")
            self.note(f"{form} of size {size:,}", measured)
        return None

    def measured(self, maker, size):
        """Make a field and measure it; if it meets the budget, export it and test the file.

        Returns
        -------
        measured : pandis.pipeline.geometry.points.Measured, or None
            None if the field does not cover the band.
        candidate : pandis.pipeline.kinds.sizing.Candidate, or None
        """
        candidate = maker.make(size)
        if candidate is None:
            return None, None
        measured = self.points.measure(candidate.force, self.limits)
        self.log(f"{maker.form} of size {size:,}: {self.points.describe(measured.figures)}")
        if not measured.why:
            measured = self.proved(candidate.field, measured)
        return measured, candidate

    # --- shared by all kinds of fields -------------------------------------------------------

    def proved(self, field, measured):
        """Export a field that meets the budget; measure and stress-test the exported file."""
        try:
            native = NativeOptions(weight_bits=self.options.weight_bits)
            data = export_native(field, self.body, native, provenance={}, log=_silent)
        except PandisError as error:
            return measured._replace(why=f"meets the limits, but cannot be exported: {error}",
                                     excess=max(measured.excess, 1.0))  # fmt: skip
        file = ExportedField(field.name, data)
        measured = self.points.measure(force_of(file), self.limits)
        if measured.why:
            return measured
        answers = self.suite.ask(file, self.progress, first=True)
        if not failures(answers):
            answers |= self.suite.touch(file)
        failed = failures(answers)
        if failed:
            question = (QUESTIONS | PROXY_QUESTIONS)[failed[0]]
            why = question.says(answers[failed[0]])
            return measured._replace(why=f"meets the limits, but fails the stress suite: {why}",
                                     excess=max(measured.excess, 1.0))  # fmt: skip
        return measured

    @property
    def suite(self):
        """The stress suite of the body, made when it is first needed."""
        if self._suite is None:
            options, seed = self.options.stress, self.options.seed
            self._suite = Suite(self.body, self.points.scale, options, seed=seed)
        return self._suite

    def _try_controls(self):
        exact = ExactField("exact", self.body)
        tried = controls(exact, self.points.scale)
        met = []
        for control in tried:
            _, upper = promise(force_of(control), self.points.promising)
            met += [control.name] if self.limits.excess(upper) <= 1 else []
        demand_failure("the choice by budget", met)

    def say_least(self):
        """Log why the cheaper kinds were rejected, before networks are tried."""
        reasons = "; ".join(f"{one.field}: {one.why}" for one in self.considered)
        self.log(f"networks are tried next, because no cheaper kind meets the budget: {reasons}")

    def choice(self, name, bytes_, measured, *, seconds):
        """Return the record of a field that meets the budget."""
        return Chosen(
            field=name,
            bytes=bytes_,
            held_out_error=measured.figures["mean"],
            held_out=measured.figures,
            fits=measured.excess,
            query_time=seconds,
        )

    def time(self, form, size, **shape):
        """Return the time of a query (s), or None if the budget sets no query time."""
        if self.budget.query_time is None:
            return None
        return self.times.seconds(form, size, **shape)

    def too_dear(self, form, size, bytes_, **shape):
        """Return as text which of bytes and query time exceed the budget; empty if neither does."""
        limits = []
        if self.budget.bytes is not None and bytes_ > self.budget.bytes:
            limits.append(f"{bytes_:,} bytes")
        slow = self.time(form, size, **shape) or 0.0
        if slow > (self.budget.query_time or float("inf")):
            limits.append(f"{slow * 1e6:.3g} µs a query")
        return " and ".join(limits)

    def fitting(self, form, sizes, name=None, **shape):
        """Return the sizes in ``sizes`` (bytes by size) that meet the budget; log if none do."""
        dear = {size: self.too_dear(form, size, bytes_, **shape) for size, bytes_ in sizes.items()}
        if all(dear.values()):
            self.skip(name or form, f"{next(iter(dear.values()))} at the least")
        return [size for size, why in dear.items() if not why]

    def skip(self, name, why):
        """Log and record why a field is rejected."""
        self.log(f"{name}: {why}")
        self.considered.append(Passed(field=name, why=why))

    def note(self, name, measured):
        """Record a field if it is the nearest to the limits so far."""
        if self._nearest is None or measured.excess < self._nearest[1].excess:
            self._nearest = name, measured


def _silent(text):
    """Discard a log line."""
