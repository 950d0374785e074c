"""All questions to all fields of a mesh, and what the answers mean."""

from functools import partial
from typing import NamedTuple

import numpy as np

from pandis.stress.contact import contacts, hold, holding
from pandis.stress.coupled import closed_loop, stable_stiffness
from pandis.stress.jumps import jumps
from pandis.stress.physical import Device, Scale
from pandis.stress.probes import directions, shell_points
from pandis.stress.robust import (
    PlacedExact,
    endurance,
    invariance,
    placed,
    precision,
    special,
    special_points,
)
from pandis.stress.stiffness import stiffness
from pandis.stress.work import loops, work


class Question(NamedTuple):
    """What is asked of a field, the figure that tells most, and what a failure is said to be."""

    asked: str
    figure: str
    failing: str


QUESTIONS = {
    "work": Question(
        "Does a circling hand gain energy?",
        "work",
        "a circling hand gains up to {push_n:.2g} N ({limit:.2g} allowed)",
    ),
    "stiffness": Question(
        "Is the wall steeper than it should be?",
        "steep",
        "{steep:.2%} of the points below the surface are steeper than twice k "
        "({limit:.2%} allowed)",
    ),
    "jumps": Question(
        "Does the force jump?",
        "jumps",
        "the force jumps on {jumps:.2%} of the ways of 0.1 mm ({limit:.2%} allowed), on a "
        "thousandth by {mm01_p999:.2g} N or more",
    ),
    "contacts": Question(
        "Are there contacts in free space, or none inside?",
        "ghost_n",
        "up to {ghost_n:.2g} N further than 0.5 mm outside, at {ghosts:.2%} of the points there; "
        "none at {missed:.2%} of those as deep inside",
    ),
    "hold": Question(
        "Does a wall hold as much as the exact one?",
        "of_exact",
        "walls hold {of_exact:.0%} of what the exact ones do",
    ),
    "closed_loop": Question(
        "Do device and hand shake on it?",
        "stable_n_m",
        "a device is quiet up to {stable_n_m:.0f} N/m only (wanted: {limit:.0f})",
    ),
    "endurance": Question(
        "Does a long run end as it began?",
        "bad",
        "{bad:,} answers of {ticks:,} are no numbers, {drift:,} changed",
    ),
    "invariance": Question(
        "Do units and place matter?",
        "distance",
        "distances change by {distance:.1e} with units or place",
    ),
    "precision": Question(
        "Do float32 positions matter?",
        "newtons",
        "float32 positions change the force by {newtons:.2g} N",
    ),
    "special": Question(
        "Are vertices, edges, the medial axis and NaN answered?",
        "bad",
        "{bad:,} special points and {unflagged:,} that are none are not answered",
    ),
}
#: Points below the surface, ways that begin there, points anywhere; surface points that are
#: pushed into, and pressed on.
SHELL, WAYS, ANYWHERE, PUSHED, PRESSED = 4000, 40_000, 40_000, 400, 16


class Suite:
    """The places that all fields of a mesh are asked at.

    Parameters
    ----------
    mesh : pandis.artifact.Artifact
        Of kind ``mesh``.
    surface : pandis.sampling.Surface
    engine : object
        From `pandis.distance.open_distance`.
    options : dict
        See `pandis.config.StressOptions`; and ``size``, ``stiffness``, ``seed``.
    """

    def __init__(self, mesh, surface, engine, options):
        self.mesh, self.surface, self.engine, self.options = mesh, surface, engine, options
        self.scale = Scale(options["size"], options["stiffness"])
        self.device = Device(*(options[key] for key in Device._fields))
        rng = np.random.default_rng([options["seed"], 1])
        self.loops = loops(surface, engine, options["loops"], rng)
        self.shell = shell_points(surface, SHELL, rng)[0]
        self.ways = shell_points(surface, WAYS, rng)[0], directions(WAYS, rng)
        self.pushed = surface.draw(PUSHED, rng)[:2]
        self.wanted = holding(self.exact, *self.pushed, self.scale)
        self.pressed = surface.draw(PRESSED, rng)[:2]
        self.rests = stable_stiffness(self.exact, *self.pressed, self.scale, self.device)
        corners = (engine.frame.to_unit(mesh.arrays["vertices"])
                   if mesh.attributes.get("shape") else engine.vertices)  # fmt: skip
        self.odd = special_points(engine, corners, mesh.arrays["faces"], *self.pushed)

    def exact(self, points):
        """Answer exactly, as in a loop: signs are not compared with the winding number."""
        return self.engine.distance_and_normal(points, check=False)

    def ask(self, field, progress):
        """Ask one field everything.

        Parameters
        ----------
        field : pandis.fields.base.Field
        progress : callable
            Makes a `pandis.stage.Progress`.

        Returns
        -------
        dict of str to dict
            By question: figures, and whether the field passed.
        """
        rng = np.random.default_rng([self.options["seed"], 2])
        answer, scale, device = field.answer, self.scale, self.device
        report = progress(f"{field.name}: ticks", self.options["ticks"], "ticks")
        place = partial(placed, field)
        if field.name == "exact" and not self.mesh.attributes.get("shape"):
            place = partial(PlacedExact, self.mesh)
        return {
            "work": work(answer, self.exact, self.loops, scale, device),
            "stiffness": stiffness(answer, self.exact, self.shell, scale, device),
            "jumps": jumps(answer, self.exact, *self.ways, scale, device),
            "contacts": contacts(answer, self.engine, self.surface, ANYWHERE, scale, rng),
            "hold": hold(answer, *self.pushed, self.wanted, scale),
            "closed_loop": closed_loop(answer, *self.pressed, self.rests, scale, device),
            "endurance": endurance(answer, self.options["ticks"], rng, report),
            "invariance": invariance(place, field, self.shell),
            "precision": precision(answer, self.shell, scale),
            "special": special(field, self.odd),
        }


def stress(fields, suite, progress):
    """Ask all fields of a mesh.

    Returns
    -------
    arrays, attributes : dict
        As stored in ``stress.zarr.zip``: by field the figures of every question and the list of
        those it failed; fields that need a path are named under ``skipped``; the points pushed
        into, and what the exact walls hold there.
    """
    found, failed, skipped = {}, {}, {}
    for field in fields:
        if field.ordered:
            skipped[field.name] = "its answers depend on the way"
            continue
        found[field.name] = suite.ask(field, progress)
        failed[field.name] = [q for q, row in found[field.name].items() if not row["passed"]]
    arrays = {"pushed": suite.pushed[0], "holding_newtons": suite.wanted}
    return arrays, {
        "fields": found,
        "failed": failed,
        "skipped": skipped,
        "device": suite.device._asdict(),
        "size": suite.scale.size,
        "stiffness": suite.scale.stiffness,
    }
