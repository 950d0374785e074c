"""The stress suite: asks all questions about all fields of a mesh, and describes the failures."""

import time
from functools import cached_property
from typing import NamedTuple

from pandis.base import streams
from pandis.pipeline.geometry.measure import draw_contacts
from pandis.pipeline.geometry.places import stratify
from pandis.pipeline.geometry.thickness import inscribed_radius
from pandis.pipeline.judge.controls import demand_failure
from pandis.pipeline.judge.stress.contact import absence, hold, otherness, wanted_force
from pandis.pipeline.judge.stress.coupled import Loop, closed_loop, presses, stable_stiffness
from pandis.pipeline.judge.stress.ghosts import ghosts
from pandis.pipeline.judge.stress.jumps import jumps
from pandis.pipeline.judge.stress.physical import Device
from pandis.pipeline.judge.stress.probes import directions, shell_points
from pandis.pipeline.judge.stress.proxy import (
    Felt,
    holds,
    keeps,
    nothing,
    press_all,
    stays,
    surface_error,
    wander,
)
from pandis.pipeline.judge.stress.robust import (
    endurance,
    invariance,
    precision,
    special,
    special_points,
)
from pandis.pipeline.judge.stress.stiffness import stiffness
from pandis.pipeline.judge.stress.work import loops, work
from pandis.pipeline.kinds.exact.file import File as ExactFile
from pandis.pipeline.kinds.exported import ExportedField
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.run.host.processes import each
from pandis.pipeline.run.records.stress import StressRecord


class Question(NamedTuple):
    """A question about a field, its main figure, and the template of a failure's message."""

    text: str
    figure: str
    failing: str

    def says(self, answer):
        """Return a clause that says how a field failed, given an answer of `Suite.ask`."""
        if answer.get("left_out", 0) >= 1:
            return "all of the surface is too thin to be judged"
        return self.failing.format(**answer)


QUESTIONS = {
    "missing": Question(
        "Is a part of the surface missing?",
        "missing",
        "on {missing:.2%} of the surface the force is missing, and {left_out:.2%} of it is too "
        "thin to be judged ({limit:.2%} allowed of each)",
    ),
    "other": Question(
        "Does the surface push with a different force?",
        "strongly_felt",
        "on {strongly_felt:.2%} of the surface the force feels strongly different "
        "({limit:.2%} allowed), on {patch:.2%} in one patch ({patch_limit:.2%} allowed)",
    ),
    "hold": Question(
        "Does every wall hold as much as the exact one?",
        "gives_way",
        "on {gives_way:.2%} of the surface the wall gives way before it holds 0.9 of what the "
        "exact one does ({limit:.0%} allowed), and on {breaks:.2%} before it holds half of that "
        "({broken_limit:.1%} allowed)",
    ),
    "contacts": Question(
        "Are there contacts in free space?",
        "ghosts",
        "forces of up to {largest_n:.2g} N in free space, of 0.05 N or more in {ghosts:.2%} of it "
        "next to the surface ({limit:.2%} allowed), and of up to {far_n:.2g} N far from it",
    ),
    "work": Question(
        "Does a circling hand gain energy?",
        "work",
        "a circling hand gains up to {push_n:.2g} N ({limit:.2g} allowed)",
    ),
    "stiffness": Question(
        "Is the wall steeper than it should be?",
        "steep",
        "on {steep:.2%} of the surface the wall is steeper than twice k, and than the exact one "
        "({limit:.2%} allowed)",
    ),
    "jumps": Question(
        "Does the force jump?",
        "jumps",
        "on {jumps:.2%} of the moves of 0.1 mm the force jumps where the exact one does not "
        "({limit:.2%} allowed); on one move in ten thousand it changes by at least "
        "{worst_n:.2g} N more than the exact one",
    ),
    "closed_loop": Question(
        "Does a device in a hand shake on the wall, or go through it?",
        "restless",
        "on {restless:.0%} of the surface a press that is calm on the exact field shakes or goes "
        "through ({limit:.0%} allowed); a device is calm up to {stable_n_m:.0f} N/m "
        "(at least {least_n_m:.0f} N/m required)",
    ),
    "invariance": Question(
        "Do units and position matter?",
        "distance",
        "when units or position change, distances change by {distance:.1e}, and the force "
        "changes on {changed:.2%} of the surface",
    ),
    "precision": Question(
        "Do float32 positions matter?",
        "changed",
        "float32 positions change the force on {changed:.2%} of the surface, by up to "
        "{newtons:.2g} N",
    ),
    "special": Question(
        "Are vertices, edges, the medial axis and NaN handled?",
        "bad",
        "{bad:,} special points have no valid answer, and {unflagged:,} invalid points are not "
        "flagged or get a force",
    ),
    "endurance": Question(
        "Does a long run end as it began?",
        "bad",
        "{bad:,} of {ticks:,} answers are invalid, and {drift:,} repeated ones changed",
    ),
}
#: Questions that take about as long as all others together.
LONG = ("endurance",)
#: Questions about a field through a proxy, if it has one.
PROXY_QUESTIONS = {
    "holds": Question(
        "Does every wall hold the proxy, and does friction keep it at rest?",
        "worst",
        "through a proxy {soft:.2%} of the surface holds less than half of what the exact one "
        "does, and on {creeps:.2%} the proxy creeps ({limit:.1%} allowed)",
    ),
    "keeps": Question(
        "Does a circling hand gain energy?",
        "push_n",
        "through a proxy a circling hand gains {push_n:.2g} N ({limit:.2g} allowed)",
    ),
    "stays": Question(
        "Does the proxy stay outside on a long path, and the force within its bounds?",
        "deepest_mm",
        "on a long path the proxy is {deepest_mm:.2g} mm deep ({limit:.2g} allowed), touches "
        "in {touching:.0%} of the ticks, and {bad:,} of {ticks:,} forces are not numbers, or "
        "change by more than allowed",
    ),
}
#: Numbers of points: CONTACTS in the contact set, PLACES stratified on the surface, SHELL below
#: those, WAYS also below those, where moves start, BESIDE next to the surface, PUSHED on the
#: surface to push into (including thin walls), and PRESSED on the surface to press on.
CONTACTS, PLACES, SHELL, WAYS = 20_000, 2000, 4000, 40_000
BESIDE, PUSHED, PRESSED = 20_000, 400, 80
#: Limit on the nodes, leaves and faces that a query of the exact field may visit here. It is never
#: reached.
_UNCUT = 1 << 30


class Suite:
    """The points at which all fields of a mesh are tested.

    They are stratified by the inscribed radius, so that thin parts count. No point is deeper than
    the device's largest force can press, or than nine tenths of that radius. Beyond that radius a
    penalty force pushes towards another face.

    Parameters
    ----------
    body : pandis.pipeline.geometry.body.Body
    scale : pandis.base.physical.Scale
    options : pandis.pipeline.run.ask.options.StressOptions
    seed : int
    """

    def __init__(self, body, scale, options, *, seed):
        self.body, self.scale, self.options, self.seed = body, scale, options, seed
        self.engine = engine = body.distance
        self.device = Device(*(getattr(options, key) for key in Device._fields))
        rng = streams.generator(seed, streams.PLACES)
        self.contacts = draw_contacts(body, self.scale, CONTACTS, rng=rng)
        places = self._places(PLACES, rng)
        self.loops = loops(self._places(options.loops, rng), engine, rng)
        deepest = self.device.force_limit / self.scale.newtons
        self.shell = shell_points(places, SHELL, deepest, rng=rng)
        self.ways = shell_points(places, WAYS, deepest, rng=rng)
        self.along = directions(len(self.ways.points), rng)
        self.pushed = self._places(PUSHED, rng, "judged")
        self.pressed = self._places(PRESSED, rng)
        self.exact_force = {
            name: wanted_force(self.exact, places, self.scale, device=self.device)
            for name, places in (("pushed", self.pushed), ("pressed", self.pressed))
        }
        force, device = self.exact_force["pressed"], self.device
        loop = Loop(self.exact, self.scale, device)
        self.calm = presses(loop, self.pressed, force)
        self.rests = stable_stiffness(loop, self.pressed, force)
        #: Inscribed radius at the points pushed into, without an upper bound.
        self.thickness = inscribed_radius(engine, self.pushed.feet, self.pushed.outward)
        self.odd = special_points(body.corners, body.faces, self.pushed, thickness=self.thickness)

    def _places(self, count, rng, among="pushing"):
        return stratify(self.body, self.scale, count, rng=rng, among=among)

    @cached_property
    def exact_hold(self):
        """`Presses` of the exact field through a proxy, at the points pushed into."""
        exact = ExactField("exact", self.body)
        follow = Felt.of(ExportedField("exact", ExactFile(exact, 32, _UNCUT).data({})), self.scale)
        return press_all(follow, self.pushed, self.scale)

    def exact(self, points):
        """Return exact distance and normal as in a device loop: signs are not checked."""
        return self.engine.distance_and_normal(points, check=False)

    def ask(self, field, progress, first=False, *, only=tuple(QUESTIONS)):
        """Ask all questions about one field.

        Parameters
        ----------
        field : pandis.pipeline.kinds.field.Field
        progress : pandis.base.progress.Progress
        first : bool
            Stop after the first question that the field fails.
        only : collection of str
            Questions to ask.

        Returns
        -------
        dict of str to dict
            By question: figures, and whether the field passed.
        """
        answers = {}
        for question, answer in self._questions(field, progress).items():
            if question not in only:
                continue
            answers[question] = answer()
            if first and not answers[question]["passed"]:
                break
        return answers

    def pace(self, field):
        """Return roughly the time (s) that a field takes to answer at 256 points."""
        start = time.perf_counter()
        field.answer(self.shell.points[:256])
        return time.perf_counter() - start

    def touch(self, field):
        """Ask all questions about a field's proxy; return {} if it has none, else as `ask` does."""
        follow = Felt.of(field, self.scale)
        return self.feel(follow, surface_error(field, self.contacts)) if follow else {}

    def feel(self, follow, error):
        """Judge a field felt through a proxy; ``error`` is its `surface_error`."""
        rng, engine = streams.generator(self.seed, streams.WANDER), self.engine
        way = wander(self.pushed, rng)
        return {
            "holds": holds(follow, self.pushed, self.exact_hold, scale=self.scale),
            "keeps": keeps(follow, engine, self.loops, device=self.device),
            "stays": stays(follow, engine, error, path=way, scale=self.scale),
        }

    def _questions(self, field, progress):
        """Return a function per question, in the order of `QUESTIONS`: quick questions first."""
        rng = streams.generator(self.seed, streams.QUESTIONS)
        walk = streams.generator(self.seed, streams.TICKS)
        answer, exact, scale, device = field.answer, self.exact, self.scale, self.device
        ticks = self.options.ticks
        return {
            "missing": lambda: absence(answer, self.contacts),
            "other": lambda: otherness(answer, self.contacts),
            "hold": lambda: hold(
                answer, self.pushed, self.exact_force["pushed"], scale=scale, device=device
            ),
            "contacts": lambda: ghosts(answer, self.body, BESIDE, scale=scale, rng=rng),
            "work": lambda: work(answer, exact, self.loops, scale=scale, device=device),
            "stiffness": lambda: stiffness(answer, exact, self.shell, scale=scale, device=device),
            "jumps": lambda: jumps(
                answer, exact, self.ways, along=self.along, scale=scale, device=device
            ),
            "closed_loop": lambda: closed_loop(
                Loop(answer, scale, device),
                self.pressed,
                self.exact_force["pressed"],
                calm=self.calm,
                rests=self.rests,
            ),
            "invariance": lambda: invariance(field, self.shell),
            "precision": lambda: precision(answer, exact, self.shell, scale=scale),
            "special": lambda: special(field, self.odd),
            "endurance": lambda: endurance(
                answer, ticks, walk, report=progress(f"{field.name}: ticks", ticks, "ticks")
            ),
        }


def stress(fields, controls, suite, *, count, progress, proxies=True):
    """Ask all questions about all fields of a mesh.

    Parameters
    ----------
    fields : list of pandis.pipeline.kinds.field.Field
    controls : list of pandis.pipeline.kinds.field.Field
        From `pandis.pipeline.judge.controls.controls`. Each is asked questions until it fails one,
        which it must.
    suite : Suite
    count : int
        Number of processes that share the questions; the longest tasks start first.
    progress : pandis.base.progress.Progress
    proxies : bool
        Whether fields with a proxy are also tested through it.

    Returns
    -------
    arrays, attributes : dict
        As stored in ``stress.zarr.zip``. Attributes: for each field the figures of every question
        and the list of failed ones, and the same through a proxy; ``skipped`` names the fields that
        require a path. Arrays: the points pushed into, and the force (N) that exact walls hold
        there.

    Raises
    ------
    PandisError
        A control passes every question.
    """
    tried = {control.name: failures(suite.ask(control, progress, first=True))
             for control in controls}  # fmt: skip
    demand_failure("the stress suite", (name for name, failed in tried.items() if not failed))
    plain = [field for field in fields if not field.ordered]
    if proxies and not failures(suite.feel(nothing, 0.0)):
        demand_failure("the stress suite of proxies", ["a proxy that nothing holds"])

    answered, felt = _shared_out(plain, suite, count, progress=progress, proxies=proxies)
    holds = suite.thickness * suite.scale.newtons
    arrays = {"pushed": suite.pushed.feet, "holding_newtons": holds}
    record = StressRecord(
        fields=answered,
        failed={name: failures(answer) for name, answer in answered.items()},
        proxies=felt,
        proxies_failed={name: failures(answer) for name, answer in felt.items()},
        controls=tried,
        skipped={field.name: "its answers depend on the path" for field in fields if field.ordered},
        device=suite.device._asdict(),
        size=suite.scale.size,
        stiffness=suite.scale.stiffness,
    )
    return arrays, record.attributes()


def _shared_out(fields, suite, count, *, progress, proxies):
    """Ask in several processes; return answers by field, without a proxy and through one."""
    slowest = sorted(fields, key=suite.pace, reverse=True)
    parts = [LONG, [question for question in QUESTIONS if question not in LONG]]
    tasks = [(field, part) for part in (*parts, *([PROXY_QUESTIONS] if proxies else []))
             for field in slowest]  # fmt: skip

    def ask(task):
        field, part = task
        if part is PROXY_QUESTIONS:
            return suite.touch(field)
        return suite.ask(field, progress, only=part)

    answers, felt = {field.name: {} for field in fields}, {}
    for (field, part), answer in zip(tasks, each(ask, tasks, count), strict=True):
        if part is not PROXY_QUESTIONS:
            answers[field.name] |= answer
        elif answer:
            felt[field.name] = answer
    ordered = {name: {question: answer[question] for question in QUESTIONS}
               for name, answer in answers.items()}  # fmt: skip
    return ordered, {field.name: felt[field.name] for field in fields if field.name in felt}


def failures(answers):
    """Return the failed questions among the answers of `Suite.ask`."""
    return [question for question, row in answers.items() if not row["passed"]]
