"""`fields: auto`: the field that meets a budget and is the cheapest to build.

The exact mesh needs no building, a compact one seconds and hardly errs, a grid takes a second, a
spline a quarter of a minute, a network minutes: they are tried in this order, each kind from small
to large, and what comes after the first that will do is skipped. What is chosen meets the budget on
points that it was not chosen by, and passes the stress suite, as ``pandis.h`` answers it from its
file.
"""

from typing import NamedTuple

from pandis.base.errors import PandisError
from pandis.base.forces import force_of
from pandis.pipeline.geometry.measure import promise
from pandis.pipeline.geometry.shares import MISSING_LIMIT, THINNEST
from pandis.pipeline.geometry.strata import Strata
from pandis.pipeline.judge.controls import controls, demand_failure
from pandis.pipeline.judge.errors.points import Measured
from pandis.pipeline.judge.stress.suite import PROXY_QUESTIONS, QUESTIONS, Suite, failures
from pandis.pipeline.kinds.compact.build import size_of
from pandis.pipeline.kinds.compact.sizes import Packer
from pandis.pipeline.kinds.exact.reference import ExactField
from pandis.pipeline.kinds.exported import ExportedField
from pandis.pipeline.kinds.native import export_native, network_bytes
from pandis.pipeline.kinds.network.build import narrowest, widths_up_to
from pandis.pipeline.kinds.opening import open_field
from pandis.pipeline.kinds.sizing import SIZES, SPLINE_BYTES, Grids, grid_bytes, hopeless
from pandis.pipeline.run.ask.catalogue import COMPACT, DENSE_KINDS, parse_field
from pandis.pipeline.run.ask.tasks import TrainTask
from pandis.pipeline.run.job.artifact import Artifact
from pandis.pipeline.run.records.choice import ChoiceRecord, Chosen, Passed, ScaleRecord


class Outcome(NamedTuple):
    """What a kind of field has come to.

    Attributes
    ----------
    arrays, attributes : dict
        As in the field's own artifact.
    choice : pandis.pipeline.run.records.choice.Chosen
    finish : callable
        To be called once the artifact is written.
    """

    arrays: dict
    attributes: dict
    choice: Chosen
    finish: object


class Chooser:
    """Looks for the cheapest field that meets a budget.

    Parameters
    ----------
    body : pandis.pipeline.geometry.body.Body
    points : pandis.pipeline.judge.errors.points.Points
        Of that body.
    options : pandis.pipeline.run.ask.tasks.ChooseTask
    times : pandis.pipeline.run.plan.query_times.QueryTimes
    checkpoint : path-like
        Where training keeps its state.
    progress : callable
        Makes a `pandis.pipeline.run.job.stage.Progress`.
    log : callable
    """

    def __init__(self, body, points, options, times, checkpoint, progress, log):
        self.body, self.points, self.options, self.times = body, points, options, times
        self.checkpoint, self.progress, self.log = checkpoint, progress, log
        self.budget = options.budget
        self.limits = points.limits(self.budget)
        self.grids = Grids(points, body.frame, options.band, progress)
        self.considered, self._nearest, self._suite = [], None, None

    def choose(self):
        """Return what is stored in ``choice.zarr.zip``.

        Returns
        -------
        arrays, attributes : dict
            Those of the field that was chosen; ``choice`` names it, with its error, bytes and
            query time, and ``considered`` tells the same of what was not taken, and why.
        finish : callable
            To be called once the artifact is written.

        Raises
        ------
        PandisError
            Nothing meets the budget, or a control does.
        """
        self.log(f"asked for: {self.points.told_limits(self.limits)}")
        self._refuse_the_too_thin()
        self._try_controls()
        for attempt in (self._exact, self._compact, self._dense, self._spline, self._network):
            if attempt == self._network:
                self._say_least()
            field = attempt()
            if field:
                return field.arrays, field.attributes | self._told(field.choice), field.finish
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

    def _told(self, choice):
        scale = self.points.scale
        says = self.points.told(choice.held_out)
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
            f"no field meets the budget of {self.points.told_limits(self.limits)}.{nearest} "
            f"Ask for less: a larger budget.force_error, budget.tail, budget.bytes or "
            f"budget.query_time. What was considered: {reasons}"
        )

    # --- the kinds ------------------------------------------------------------------------

    def _exact(self):
        size, count = self.body.bytes, self.body.size
        if not self._fitting("exact", {count: size}):
            return None
        if self.budget.bytes is None and self.budget.query_time is None:
            self.log(
                "a budget without bytes and query_time takes the exact field: it has no error; "
                "add budget.bytes or budget.query_time if it is too large or too slow"
            )
        no_error = {"mean": 0.0, "p99": 0.0, "missing": 0.0}
        no_error["left_out"] = self.points.promising.left_out
        choice = Chosen(
            field="exact", held_out_error=0.0, held_out=no_error, bytes=size,
            query_time=self._time("exact", count),
        )  # fmt: skip
        arrays = {"vertices": self.body.vertices, "faces": self.body.faces}
        attributes = {"shape": self.body.shape}
        return Outcome(arrays, attributes, choice, _nothing)

    def _compact(self):
        name, count = f"{COMPACT}-auto", len(self.body.faces)
        if self.budget.query_time is not None and COMPACT not in self.times:
            self._skip(
                name,
                f"{self.times.path} has no query times of compact meshes; "
                "measure them with `snakemake -f calibrate`",
            )
            return None
        slow = self._too_dear(COMPACT, count, 0)
        if slow:
            self._skip(name, f"{slow} with all {count:,} faces")
            return None
        packer = Packer(self.body, self.points, self.options.seed, self.log)
        candidate = packer.within(self.budget.bytes)
        if candidate is None:
            fits = f" that fits into {self.budget.bytes:,} bytes" if self.budget.bytes else ""
            self._skip(name, f"no mesh on a lattice{fits} has every point on its right side")
            return None
        measured = self.points.measure(candidate.force, self.limits)
        if not measured.why:
            measured = self._proved(candidate.field, COMPACT, measured)
        if measured.why:
            self._skip(name, measured.why)
            self._note(name, measured)
            return None
        seconds = self._time(COMPACT, candidate.field.record.faces)
        choice = self._choice(name, size_of(candidate.arrays), measured, seconds)
        return Outcome(candidate.arrays, candidate.attributes, choice, _nothing)

    def _dense(self):
        sizes = [
            (grid_bytes(kind, size), kind, size)
            for kind in DENSE_KINDS
            for size in self._fitting(kind, {n: grid_bytes(kind, n) for n in SIZES})
        ]
        return self._first(sorted(sizes))

    def _spline(self):
        sizes = self._fitting("spline", {n: n for n in SPLINE_BYTES})
        return self._first([(size, "spline", size) for size in sizes])

    def _network(self):
        name, recipe = self.options.name, self.options.recipe
        widths = widths_up_to(recipe.width)
        fit = self._fitting("network", {w: self._weights(w) for w in widths})
        if not fit:
            return None
        # a seed of its own: a spline that was tried drew from this job's, too
        law, seed = self.options.samples, self.options.seed
        strata = Strata(self.points.surface, self.points.engine, law, seed + 1)
        drawn = strata.arrays(self.progress)
        samples = Artifact(None, "samples", drawn, strata.attributes(), {}, "")
        task = TrainTask(name=name, recipe=recipe, seed=seed)
        spec = parse_field(name, [name])

        def judge(trainer, arrays, attributes):
            measured = self.points.measure(trainer.force_at, self.limits)
            if measured.why:
                return measured
            artifact = Artifact(
                None, "model", arrays, attributes | self.body.frame.attributes(), {}, ""
            )
            return self._proved(open_field(spec, artifact), "network", measured)

        try:
            network, tried, finish = narrowest(
                task, fit, samples, strata, self.checkpoint, self.progress, self.log, judge
            )
        except PandisError as error:
            self._skip(name, str(error))
            return None
        if network is None:
            best = min(tried, key=lambda one: one.excess)
            self._skip(name, f"of {best.size} units, {best.why}")
            self._note(f"{name} of {best.size} units",
                       Measured({}, best.why, best.excess))  # fmt: skip
            finish()
            return None
        arrays, attributes, measured = network
        width = attributes["architecture"]["width"]
        taken = self._time("network", width)
        choice = self._choice(name, self._weights(width), measured, taken)
        return Outcome(arrays, attributes, choice, finish)

    def _first(self, sizes):
        """Return the first grid that will do, of (bytes, kind, size) from cheap to dear."""
        tried, best = {}, {}
        for bytes_, kind, size in sizes:
            before = tried.setdefault(kind, [])
            if any(hopeless(s, m.figures, self.limits, size, kind) for s, m in before):
                continue
            measured, candidate = self.measured(kind, size)
            if measured is None:
                continue
            before.append((size, measured))
            name = "spline-auto" if kind == "spline" else f"{kind}-{size}"
            if not measured.why:
                choice = self._choice(name, bytes_, measured, self._time(kind, size))
                candidate = candidate or self.grids.make(kind, size)
                return Outcome(candidate.arrays, candidate.attributes, choice, _nothing)
            if kind not in best or measured.excess < best[kind][1].excess:
                best[kind] = size, measured
        for kind, (size, measured) in best.items():
            self._skip(kind, f"at best, with size {size:,}, {measured.why}")
            self._note(f"{kind} of size {size:,}", measured)
        return None

    def measured(self, kind, size):
        """Make a grid, and hold it against the budget, the stress suite and its own export.

        Returns
        -------
        measured : pandis.pipeline.judge.errors.points.Measured, or None
            None if it does not cover the band.
        candidate : pandis.pipeline.kinds.sizing.Candidate, or None
        """
        candidate = self.grids.make(kind, size)
        if candidate is None:
            return None, None
        measured = self.points.measure(candidate.force, self.limits)
        self.log(f"{kind} of size {size:,}: {self.points.told(measured.figures)}")
        if not measured.why:
            measured = self._proved(candidate.field, kind, measured)
        return measured, candidate

    # --- what they share ---------------------------------------------------------------------

    def _proved(self, field, kind, measured):
        """Export a field that meets the budget, and ask its file all that it must pass."""
        try:
            bits = self.options.weight_bits
            data = export_native(field, kind, {}, bits, self.body, _silent)
        except PandisError as error:
            return measured._replace(why=f"meets the errors, but cannot be exported: {error}",
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
            return measured._replace(why=f"meets the errors, but fails the stress suite: {why}",
                                     excess=max(measured.excess, 1.0))  # fmt: skip
        return measured

    @property
    def suite(self):
        """The stress suite of the body, made when it is first needed."""
        if self._suite is None:
            options, seed = self.options.stress, self.options.seed
            self._suite = Suite(self.body, self.points.scale, options, seed)
        return self._suite

    def _try_controls(self):
        exact = ExactField("exact", self.body)
        tried = controls(exact, self.points.surface, self.points.scale)
        met = []
        for control in tried:
            _, upper = promise(force_of(control), self.points.promising)
            met += [control.name] if self.limits.excess(upper) <= 1 else []
        demand_failure("the choice by budget", met)

    def _say_least(self):
        """Say what grids and splines can reach, before anything is trained."""
        said = "; ".join(f"{one.field}: {one.why}" for one in self.considered)
        self.log(f"before a network is trained, what the other kinds can reach: {said}")

    def _choice(self, name, bytes_, measured, seconds):
        return Chosen(
            field=name,
            bytes=bytes_,
            held_out_error=measured.figures["mean"],
            held_out=measured.figures,
            fits=measured.excess,
            query_time=seconds,
        )

    def _weights(self, width):
        """Return the bytes of a network and its base."""
        recipe = self.options.recipe
        outputs = 1 if recipe.direction == "gradient" else 4
        bits = self.options.weight_bits
        return network_bytes(width, recipe.depth, outputs, recipe.base, bits)

    def _time(self, kind, size):
        """Return the seconds of a query, where the budget names any."""
        if self.budget.query_time is None:
            return None
        layers = {"layers": self.options.recipe.depth} if kind == "network" else {}
        return self.times.seconds(kind, size, **layers)

    def _too_dear(self, kind, size, bytes_):
        """Say by what a field is beyond the budget; an empty text if it is not."""
        limits = []
        if self.budget.bytes is not None and bytes_ > self.budget.bytes:
            limits.append(f"{bytes_:,} bytes")
        slow = self._time(kind, size) or 0.0
        if slow > (self.budget.query_time or float("inf")):
            limits.append(f"{slow * 1e6:.3g} µs a query")
        return " and ".join(limits)

    def _fitting(self, kind, sizes):
        """Return those of the sizes, with their bytes, that keep to the budget; note if none."""
        dear = {size: self._too_dear(kind, size, bytes_) for size, bytes_ in sizes.items()}
        if all(dear.values()):
            name = self.options.name if kind == "network" else kind
            self._skip(name, f"{next(iter(dear.values()))} at the least")
        return [size for size, why in dear.items() if not why]

    def _skip(self, name, why):
        self.log(f"{name}: {why}")
        self.considered.append(Passed(field=name, why=why))

    def _note(self, name, measured):
        if self._nearest is None or measured.excess < self._nearest[1].excess:
            self._nearest = name, measured


def _nothing():
    """Finish what has left nothing behind."""


def _silent(text):
    """Take a line of a log, and say nothing."""
