"""Fields of a body in the unit frame, as the benchmarks of contacts ask them."""

import re
from pathlib import Path
from tempfile import TemporaryDirectory

import common  # noqa: F401 - makes pandis importable
import numpy as np

from pandis.base.frame import UNIT
from pandis.pipeline.kinds.clearance import clearance
from pandis.pipeline.kinds.compact.file import file_parts
from pandis.pipeline.kinds.compact.packing import pack_body
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.kinds.grid.dense import DenseGrid
from pandis.pipeline.kinds.grid.spec import CONTENTS
from pandis.pipeline.kinds.native import native_bytes
from pandis.pipeline.kinds.opening import open_field
from pandis.pipeline.kinds.spline.lattices import SplineFit, samples_for
from pandis.pipeline.run.ask.catalogue import parse_field
from pandis.pipeline.run.ask.recipes import RECIPES
from pandis.pipeline.run.job.artifact import Artifact
from pandis.pipeline.run.job.stage import silent_progress
from pandis.runtime.field import NativeField
from pandis.runtime.field.files import pack

#: Unit frame, inside and outside: of the splines and of the grids.
BAND, WIDE = (0.08, 0.04), (0.2, 0.1)


def field_of(body, name):
    """Return a field of a body by name, as `file_of` makes it."""
    return NativeField(file_of(body, name))


def file_of(body, name):
    """Return the bytes of a field's file.

    Parameters
    ----------
    body : pandis.pipeline.geometry.body.Body
    name : str
        ``exact``, ``compact-{bits}``, ``spline-{kilobytes}K``, a network trained for a number of
        steps (``network-{steps}`` of 32 channels, ``pandis-exact-{steps}`` of the size that a
        configuration has, with CUDA where found), or a grid, as in a configuration.

    Returns
    -------
    bytes
    """
    engine = body.distance
    if name == "exact":
        field = ExactField("exact", body)
        return native_bytes(field, {}, safe=_safe(field, engine))
    kind, size = re.fullmatch(r"(.*)-(\d+)K?", name).groups()
    if kind == "compact":
        return pack(UNIT, file_parts(*pack_body(body, int(size))), {}, version=3)
    if kind == "network":
        return _network_of(body, {"width": 32}, int(size))
    if kind == "pandis-exact":
        return _network_of(body, RECIPES[kind], int(size))
    if kind == "spline":
        budget = 1000 * int(size)
        fit = SplineFit(body, BAND, 0, count=samples_for(budget=budget))
        made = fit.build(fit.choose_size(budget), budget, silent_progress)
        field = _opened("spline-auto", *made)
    else:
        return file_of_grid(body, name)
    return native_bytes(field, {}, safe=_safe(field, engine))


def file_of_grid(body, name, steep=1):
    """Return the bytes of a grid's file, with its values multiplied by `steep`."""
    kind, _, size = name.rpartition("-")
    grid = DenseGrid(body.distance, CONTENTS[kind], int(size), band=WIDE, progress=silent_progress)
    values = np.float32(steep) * np.concatenate(list(grid.slabs(32)))
    field = _opened(name, {"values": values}, grid.attributes())
    return native_bytes(field, {}, safe=_safe(field, body.distance))


def _network_of(body, options, steps):
    """Return the file of a network that was trained with these options for a number of steps."""
    from networks import ExactRecipe, export, train  # with PyTorch

    with TemporaryDirectory() as folder:
        recipe = ExactRecipe(**options | {"steps": steps})
        field, trainer = train(body, recipe, Path(folder) / "checkpoint.pt")
        trainer.finish()
    return export(field, body)


def _opened(name, arrays, attributes):
    held = Artifact("grid", arrays, attributes | UNIT.attributes(), path=Path("grid.zarr.zip"))
    return open_field(parse_field(name, ()), held)


def _safe(field, engine):
    return clearance(lambda points: field.query(points)[::2], engine)
