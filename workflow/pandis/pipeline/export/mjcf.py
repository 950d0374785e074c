"""Exports a MuJoCo model with one geom per field, and compares its distances with the library's."""

import os
import tempfile
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from pandis.base.errors import PandisError
from pandis.bridges.mujoco import register
from pandis.bridges.mujoco.asking import asker
from pandis.bridges.mujoco.instances import instances
from pandis.bridges.mujoco.mjcf import mjcf_text
from pandis.pipeline.export.distances import with_distances
from pandis.runtime.field import NativeField
from pandis.runtime.scene import Placed

#: Distance between the origins of neighbouring objects in the row, as a multiple of their size.
_PITCH = 1.5
#: Number of points compared per field, and their largest absolute coordinate (unit frame).
_POINTS, _REACH = 2000, 1.3
#: Largest accepted difference between distances, as a fraction of the size. It is not 0, because
#: MuJoCo rounds the position of a mesh.
_CLOSE = 1e-9


def export_mjcf(model, paths, drawn, *, size, log):
    """Return the text of a model that has one body per field, in a row along x.

    Parameters
    ----------
    model : str
        Name of the model.
    paths : list of path-like
        Field files for ``pandis.h``.
    drawn : path-like
        The mesh shared by all fields, an ``.obj`` file.
    size : float
        Longest side of an object, m.
    log : pandis.base.progress.Log

    Raises
    ------
    PandisError
        No field has distances, or MuJoCo's distances differ from the library's.
    """
    fields = with_distances([NativeField(path) for path in paths], log)
    placed = {
        field.path.stem: Placed.at(field, size, 0.0, position=(_PITCH * size * number, 0.0, 0.0))
        for number, field in enumerate(fields)
    }
    text = mjcf_text(model, placed, dict.fromkeys(placed, drawn), frictions={})
    try:
        register()
    except PandisError as error:
        log(f"the model is not compared with MuJoCo: {error}")
    else:
        off = _differences(text, placed, size)
        log(
            f"MuJoCo's distances and gradients match the library's: distances are off by at most "
            f"{off:.1g} of the size"
        )
    return text


class Query(NamedTuple):
    """A field in a model: its name, its placement, its geom, and a function that queries MuJoCo."""

    name: str
    placed: Placed
    geom: object
    ask: Callable


def _differences(text, placed, size):
    """Return MuJoCo's largest distance error in any field, as a fraction of the object's size."""
    here = os.getcwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)  # MuJoCo writes warnings to this folder
        try:
            return max(_off(query, size) for query in _queries(text, placed))
        finally:
            os.chdir(here)


def _queries(text, placed):
    """Yield the `Query` of each field."""
    import mujoco

    try:
        model = mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        raise PandisError(f"MuJoCo cannot load the model: {error}") from error
    for geom, (name, each) in zip(instances(model), placed.items(), strict=True):
        yield Query(name, each, geom, asker(model, geom.geom))


def _off(query, size):
    """Return the largest distance error, as a fraction of the size; raise if it is too large."""
    name, each, geom, ask = query
    rng = np.random.default_rng(0)
    points = each.field.frame.to_mesh(rng.uniform(-_REACH, _REACH, (_POINTS, 3)))
    expected = each.field.query(points)
    distance, gradient = ask((each.scale * points - geom.origin) @ geom.turn)
    # rounding a point may change which of two faces is nearest, but only at few points
    turned = np.abs(gradient @ geom.turn.T - expected.normal).max(axis=1)
    off = float(np.abs(distance - each.scale * expected.distance).max() / size)
    if not (off <= _CLOSE and np.percentile(turned, 99) <= 1e-4):  # NaN fails too
        raise PandisError(
            f"{name}: MuJoCo's distances differ from the library's by {off:.3g} of the size; "
            "this is a defect of the export: please report it"
        )
    return off
