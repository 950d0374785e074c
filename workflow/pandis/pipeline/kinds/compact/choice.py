"""Compact meshes for `fields: auto`, and the times of their queries."""

from pandis.base.frame import UNIT, Frame
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.kinds.compact.packing import pack_body, size_of
from pandis.pipeline.kinds.compact.reference import CompactField
from pandis.pipeline.kinds.compact.search import Packer
from pandis.pipeline.kinds.compact.spec import KIND
from pandis.pipeline.kinds.sizing import Outcome
from pandis.pipeline.run.job.artifact import Artifact

#: Bits per coordinate of the meshes in the table of query times.
_BITS = 16


def choose(chooser):
    """See `pandis.pipeline.kinds`."""
    name, count, budget = f"{KIND.name}-auto", len(chooser.body.faces), chooser.budget
    if budget.query_time is not None and KIND.name not in chooser.times:
        chooser.skip(
            name,
            f"{chooser.times.path} has no query times of compact meshes; "
            "measure them with `snakemake -j1 -f calibrate`",
        )
        return None
    slow = chooser.too_dear(KIND.name, count, 0)
    if slow:
        chooser.skip(name, f"{slow} with all {count:,} faces")
        return None
    packer = Packer(chooser.points, chooser.options.seed, chooser.log)
    candidate = packer.within(budget.bytes)
    if candidate is None:
        fits = f" that fits into {budget.bytes:,} bytes" if budget.bytes else ""
        chooser.skip(name, f"no mesh on a lattice{fits} gets the side of every point right")
        return None
    measured = chooser.points.measure(candidate.force, chooser.limits)
    if not measured.why:
        measured = chooser.proved(candidate.field, measured)
    if measured.why:
        chooser.skip(name, measured.why)
        chooser.note(name, measured)
        return None
    seconds = chooser.time(KIND.name, candidate.field.record.faces)
    choice = chooser.choice(name, size_of(candidate.arrays), measured, seconds=seconds)
    return Outcome(candidate.arrays, candidate.attributes, choice)


def timed(torus):
    """Yield tessellations of the torus: see `pandis.pipeline.kinds`."""
    for cuts in torus.cuts:
        vertices, faces = SHAPES["torus"].tessellation(*cuts)
        frame = Frame.of_bounds(vertices.min(axis=0), vertices.max(axis=0))
        body = Body(frame.to_unit(vertices), faces, UNIT)
        yield KIND.name, body.size, lambda body=body: _packed(body)


def _packed(body):
    arrays, record = pack_body(body, _BITS)
    attributes = record.attributes() | body.frame.attributes()
    return CompactField(KIND.name, Artifact(KIND.name, arrays, attributes))
