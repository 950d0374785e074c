"""Compares a field with a mesh: errors of the force where a probe can press."""

import json
from dataclasses import asdict, dataclass
from os import PathLike

import numpy as np

from pandis.base.errors import PandisError
from pandis.base.forces import penalty_force
from pandis.base.physical import Scale
from pandis.base.progress import Log
from pandis.base.streams import CONTACTS, generator
from pandis.pipeline.api.options import sections
from pandis.pipeline.api.running import stages
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.measure import contact_errors, draw_contacts
from pandis.pipeline.geometry.shares import MISSING_LIMIT
from pandis.pipeline.judge.controls import controls
from pandis.pipeline.judge.errors.errors import measured_controls
from pandis.pipeline.judge.stress.contact import absence, otherness
from pandis.pipeline.judge.stress.ghosts import ghosts
from pandis.pipeline.judge.stress.suite import BESIDE, QUESTIONS
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.run.ask.faults import faults_of, raise_faults
from pandis.pipeline.run.ask.options import EvaluationOptions
from pandis.pipeline.run.plan.stages import stage_seed
from pandis.runtime.field import NativeField

#: Boxes of a field and a mesh that differ by more than this share of the longest side belong to
#: different objects, units or places.
_SAME_BOX = 0.02


@dataclass(frozen=True)
class Comparison:
    """How far a field is from a mesh.

    Attributes
    ----------
    field : str
    bytes : int
    sets : dict of str to dict
        For each contact set: ``mean``, ``p99`` and ``max`` of the force error (unit frame, k = 1),
        ``relative``, ``newtons``, and shares of the surface: ``missing`` (the force is missing),
        ``felt`` and ``strongly_felt`` (the force differs); see
        `pandis.pipeline.geometry.measure.contact_errors`.
    left_out : float
        Share of the surface that is too thin to be judged.
    failed : dict of str to str
        How the field fails questions of the stress suite: ``missing`` (force is missing, or too
        much of the surface cannot be judged), ``other`` (the force is strongly different),
        ``contacts`` (there are forces in free space).
    size, stiffness : float
        The scale of newtons: longest side, m, and N/m.
    note : str
        What suggests that field and mesh do not belong together; else empty.
    """

    field: str
    bytes: int
    sets: dict
    left_out: float
    failed: dict
    size: float
    stiffness: float
    note: str = ""

    @property
    def ok(self) -> bool:
        """Whether no question failed. Stability and query times are not part of it."""
        return not self.failed

    def to_json(self) -> str:
        """Return the comparison as JSON."""
        return json.dumps(asdict(self) | {"ok": self.ok}, indent=2)

    def __str__(self) -> str:
        deep, newtons = self.sets["contact-deep"], Scale(self.size, self.stiffness).newtons
        verdict = "fit for use" if self.ok else "NOT fit for use"
        lines = [
            f"{self.field}: {verdict}; {self.bytes:,} bytes",
            *(f"  {why}" for why in self.failed.values()),
            f"  force error: {1e3 * deep['newtons']:.3g} mN on average "
            f"({100 * deep['relative']:.3g} % of the mean force), largest "
            f"{1e3 * newtons * deep['max']:.3g} mN, for an "
            f"object of {self.size:g} m at {self.stiffness:g} N/m",
            f"  force missing on {100 * deep['missing']:.3g} % of the surface, strongly different "
            f"on {100 * deep['strongly_felt']:.3g} %; {100 * self.left_out:.3g} % is too thin to "
            f"be judged ({100 * MISSING_LIMIT:g} % allowed to be missing or too thin)",
        ]
        return "\n".join(lines + ([f"  {self.note}"] if self.note else []))


def compare(
    field: str | PathLike[str] | NativeField,
    mesh: object,
    /,
    *,
    log: Log | None = None,
    **options: object,
) -> Comparison:
    """Measure a field's errors against a mesh, where a probe can press.

    The points, and so the figures, are those of the workflow's evaluation. The measure is also
    applied to fields with known gaps; if one of them passed, this raises an error. The verdict is
    that of the stress suite's questions about forces on the surface and in free space.

    Parameters
    ----------
    field : path-like or Field
        A ``.pandis`` file of any kind, or the opened field.
    mesh : path-like, pair of arrays, or object
        See `pandis.pipeline.api.sources.source_of`. A mesh that is not valid is repaired first.
    log : callable, optional
        Receives lines about the progress.
    **options
        ``size`` and ``stiffness`` of the object under a device, ``probes`` (points), options of
        `mesh` in a configuration, ``seed``, and ``name`` as for `pandis.field`.

    Raises
    ------
    PandisError
        The file or the mesh cannot be read, the mesh cannot be repaired, or a control passed.
    """
    if not isinstance(field, NativeField | str | PathLike):
        raise PandisError(f"expected a field or the path of a .pandis file, not {field!r}")
    opened = field if isinstance(field, NativeField) else NativeField(field)
    count = options.pop("probes", EvaluationOptions().probes)
    raise_faults(faults_of(EvaluationOptions, {"probes": count}))
    config = sections(options, ("mesh", "device"))
    with stages(mesh, config, log) as run:
        body, scale = Body.open(run.artifact("mesh")), Scale.of(run.entry.device)
        seed = stage_seed(run.entry.seed, run.mesh, "evaluate")
    rng = generator(seed, CONTACTS)
    contacts = draw_contacts(body, scale, count, rng=rng, even=True)

    def answer(points):
        distance, normal, _ = opened.query(body.frame.to_mesh(points))
        return distance * body.frame.scale, normal

    measured_controls(controls(ExactField("exact", body), scale), contacts)
    answers = {
        "missing": absence(answer, contacts),
        "other": otherness(answer, contacts),
        "contacts": ghosts(answer, body, BESIDE, scale=scale, rng=rng),
    }
    return Comparison(
        field=opened.path.name if isinstance(field, str | PathLike) else "field",
        bytes=opened.bytes,
        sets=contact_errors(lambda points: penalty_force(*answer(points)), contacts),
        left_out=contacts.left_out,
        failed={
            name: QUESTIONS[name].says(figures)
            for name, figures in answers.items()
            if not figures["passed"]
        },
        size=scale.size,
        stiffness=scale.stiffness,
        note=_note(opened, body),
    )


def _note(opened, body):
    """Return a remark if a field's box is not the mesh's."""
    ours = np.stack([body.vertices.min(axis=0), body.vertices.max(axis=0)])
    other, side = np.stack(opened.bounds), np.ptp(ours, axis=0).max()
    if (np.abs(ours - other) <= _SAME_BOX * side).all():
        return ""
    boxes = [np.round(box, 4).tolist() for box in (other, ours)]
    return (
        f"the field's box is {boxes[0]}, the mesh's {boxes[1]}: they are different objects, or in "
        "different units or places"
    )
