"""Measures query times of every kind of field on this machine, for `fields: auto`."""

import csv
import io
from typing import NamedTuple

import numpy as np

from pandis.base.frame import UNIT, Frame
from pandis.base.physical import Scale
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.points import Points
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.kinds.native import native_bytes
from pandis.pipeline.run.ask.kinds import KINDS, kind_module
from pandis.pipeline.run.ask.targets import DeviceOptions
from pandis.pipeline.run.job.machine import describe
from pandis.pipeline.run.job.stage import silent_progress
from pandis.runtime.field import NativeField

#: Number of timed queries per field.
QUERIES = 2000


class Torus(NamedTuple):
    """The body whose fields are timed.

    Attributes
    ----------
    points : pandis.pipeline.geometry.points.Points
    band : tuple of float
        See `pandis.pipeline.kinds.band.Band`.
    cuts : tuple
        Cuts around and across, per tessellation.
    progress : pandis.base.progress.Progress
    """

    points: Points
    band: tuple = (0.045, 0.02)
    cuts: tuple = ((24, 12), (192, 96), (768, 384))
    progress: object = silent_progress


def calibrate(progress):
    """Time one query of every kind of field at several sizes, on a torus.

    Parameters
    ----------
    progress : pandis.base.progress.Progress

    Returns
    -------
    str
        Text of a CSV file for `pandis.pipeline.run.plan.query_times.QueryTimes`.
    """
    vertices, faces = SHAPES["torus"].tessellation()
    frame = Frame.of_bounds(vertices.min(axis=0), vertices.max(axis=0))
    body = Body(frame.to_unit(vertices), faces, UNIT)
    points = body.surface.draw(QUERIES, np.random.default_rng(0))[0] * 0.99
    torus = Torus(Points(body, Scale.of(DeviceOptions()), 0))
    kinds = [name for name, kind in KINDS.items() if kind.chosen]
    cases = [case for name in kinds for case in kind_module(name, "choice").timed(torus)]
    report, rows = progress("fields", len(cases), "fields"), []
    for index, (form, size, make) in enumerate(cases):
        field = NativeField(native_bytes(make(), {}))
        field.time(points, 100)
        rows.append((form, size, f"{np.median(field.time(points, QUERIES)) * 1e6:.3g}"))
        report.update(index + 1)
    machine = describe()
    stream = io.StringIO()
    stream.write("# One query in C (pandis.h), median, on one thread. Sizes: faces, nodes per\n")
    stream.write("# axis, bytes, units per layer.\n")
    stream.write(f"# command: snakemake -j1 -f calibrate\n# machine: {machine['processor']}\n")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(("kind", "size", "microseconds"))
    writer.writerows(rows)
    return stream.getvalue()
