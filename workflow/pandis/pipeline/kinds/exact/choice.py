"""The exact field for `fields: auto`, and the times of its queries."""

from pandis.base.frame import UNIT, Frame
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.kinds.exact.spec import KIND
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.kinds.sizing import Outcome
from pandis.pipeline.run.records.choice import Chosen


def choose(chooser):
    """See `pandis.pipeline.kinds`. The exact field has no error, but may be too large or slow."""
    body, budget = chooser.body, chooser.budget
    size, count = body.bytes, body.size
    if not chooser.fitting(KIND.name, {count: size}):
        return None
    if budget.bytes is None and budget.query_time is None:
        chooser.log(
            "a budget without bytes and query_time takes the exact field: it has no error; "
            "add budget.bytes or budget.query_time if it is too large or too slow"
        )
    no_error = {"mean": 0.0, "p99": 0.0, "missing": 0.0}
    no_error["left_out"] = chooser.points.promising.left_out
    choice = Chosen(
        field=KIND.name, held_out_error=0.0, held_out=no_error, bytes=size,
        query_time=chooser.time(KIND.name, count),
    )  # fmt: skip
    arrays = {"vertices": body.vertices, "faces": body.faces}
    return Outcome(arrays, {"shape": body.shape}, choice)


def timed(torus):
    """Yield the closed form and tessellations of the torus: see `pandis.pipeline.kinds`."""
    for cuts in (None, *torus.cuts):
        vertices, faces = SHAPES["torus"].tessellation(*(cuts or ()))
        frame = Frame.of_bounds(vertices.min(axis=0), vertices.max(axis=0))
        body = Body(frame.to_unit(vertices), faces, UNIT, shape=None if cuts else "torus")
        yield KIND.name, body.size, lambda body=body: ExactField(KIND.name, body)
