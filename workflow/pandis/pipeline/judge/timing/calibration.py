"""Query times of every kind of field on this machine: what `fields: auto` goes by."""

import csv
import io

import numpy as np
import torch

from pandis.base.frame import Frame
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.distance import MeshDistance
from pandis.pipeline.geometry.sampling import Surface
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.kinds.compact.build import pack_body
from pandis.pipeline.kinds.compact.reference import CompactField
from pandis.pipeline.kinds.exact.reference import ExactField
from pandis.pipeline.kinds.grid.build import DenseGrid
from pandis.pipeline.kinds.grids import open_field
from pandis.pipeline.kinds.native import native_bytes
from pandis.pipeline.kinds.network.base import fit_base
from pandis.pipeline.kinds.network.reference import SirenField
from pandis.pipeline.kinds.network.training.network import Siren, named_arrays
from pandis.pipeline.kinds.spline.build import SplineFit, samples_for
from pandis.pipeline.run.ask.catalogue import COMPACT, DENSE_KINDS, GRID_FIELDS, parse_field
from pandis.pipeline.run.job.artifact import Artifact
from pandis.pipeline.run.job.machine import describe
from pandis.pipeline.run.job.stage import silent_progress
from pandis.runtime.field import NativeField

#: What is timed: tessellations (faces), nodes per axis, bytes, units per layer.
TORI, NODES, BYTES, WIDTHS = (
    ((24, 12), (192, 96), (768, 384)),
    (16, 64, 128),
    (50_000, 800_000),
    (16, 64, 128, 256, 512),
)
BAND, BASE, DEPTH, BITS = (0.045, 0.02), 16, 4, 16
#: Queries of each.
QUERIES = 2000
FRAME = Frame((0.0, 0.0, 0.0), 1.0)


def calibrate(progress):
    """Time one query of every kind of field at several sizes, on a torus.

    Parameters
    ----------
    progress : callable
        Makes a `pandis.pipeline.run.job.stage.Progress`.

    Returns
    -------
    str
        The text of a CSV file for `pandis.pipeline.run.plan.query_times.QueryTimes`.
    """
    vertices, faces = SHAPES["torus"].tessellation()
    frame = Frame.of_bounds(vertices.min(axis=0), vertices.max(axis=0))
    engine = MeshDistance(frame.to_unit(vertices), faces)
    surface = Surface(engine.vertices, engine.faces)
    points = surface.draw(QUERIES, np.random.default_rng(0))[0] * 0.99
    cases = [
        *_exact(),
        *_compact(),
        *_grids(engine),
        *_splines(engine, surface),
        *_networks(engine),
    ]
    report, rows = progress("fields", len(cases), "fields"), []
    for index, (kind, size, make) in enumerate(cases):
        field = make()
        field.time(points, 100)
        rows.append((kind, size, f"{np.median(field.time(points, QUERIES)) * 1e6:.3g}"))
        report.update(index + 1)
    machine = describe()
    stream = io.StringIO()
    stream.write("# One query in C (pandis.h), median, on one thread. Sizes: faces, nodes per\n")
    stream.write("# axis, bytes, units per layer.\n")
    stream.write(f"# command: snakemake -f calibrate\n# machine: {machine['processor']}\n")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(("kind", "size", "microseconds"))
    writer.writerows(rows)
    return stream.getvalue()


def _exact():
    for cuts in (None, *TORI):
        shape = SHAPES["torus"]
        vertices, faces = shape.tessellation(*(cuts or ()))
        frame = Frame.of_bounds(vertices.min(axis=0), vertices.max(axis=0))
        body = Body(frame.to_unit(vertices), faces, FRAME, None if cuts else "torus")
        yield "exact", body.size, lambda b=body: _native(ExactField("exact", b), "exact")


def _compact():
    for cuts in TORI:
        vertices, faces = SHAPES["torus"].tessellation(*cuts)
        frame = Frame.of_bounds(vertices.min(axis=0), vertices.max(axis=0))
        body = Body(frame.to_unit(vertices), faces, FRAME)
        yield COMPACT, body.size, lambda b=body: _packed(b)


def _packed(body):
    arrays, record = pack_body(body, BITS)
    attributes = record.attributes() | FRAME.attributes()
    return _native(
        CompactField(COMPACT, Artifact(None, COMPACT, arrays, attributes, {}, "")), COMPACT
    )


def _grids(engine):
    for kind in DENSE_KINDS:
        for size in NODES:
            yield kind, size, lambda k=kind, n=size: _grid(engine, k, n)


def _grid(engine, kind, size):
    grid = DenseGrid(engine, GRID_FIELDS[kind], size, BAND, silent_progress)
    values = np.concatenate(list(grid.slabs(32)))
    attributes = grid.attributes() | FRAME.attributes()
    artifact = Artifact(None, "grid", {"values": values}, attributes, {}, "")
    return _native(open_field(parse_field(f"{kind}-{size}", ()), artifact), kind)


def _splines(engine, surface):
    for size in BYTES:
        yield "spline", size, lambda n=size: _spline(engine, surface, n)


def _spline(engine, surface, size):
    fitted = SplineFit(engine, surface, BAND, 0, samples_for(budget=size))
    arrays, attributes = fitted.build(fitted.choose_size(size), size, silent_progress)
    attributes |= FRAME.attributes()
    artifact = Artifact(None, "grid", arrays, attributes, {}, "")
    return _native(open_field(parse_field("spline-auto", ()), artifact), "spline")


def _networks(engine):
    base = fit_base(engine, BASE).coefficients
    for width in WIDTHS:
        yield "network", width, lambda w=width: _network(base, w)


def _network(base, width):
    network = Siren(width, DEPTH, 30.0, 1, torch.Generator().manual_seed(0))
    arrays = named_arrays(list(network.parameters())) | {"base": base}
    shape = {"width": width, "depth": DEPTH, "omega": 30.0, "outputs": 1}
    attributes = {"architecture": shape, **FRAME.attributes()}
    return _native(
        SirenField("network", Artifact(None, "model", arrays, attributes, {}, "")), "network"
    )


def _native(field, kind):
    return NativeField(native_bytes(field, kind, {}))
