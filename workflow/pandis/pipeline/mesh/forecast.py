"""Forecasts what repair would do with a mesh, without running the slow rungs."""

from typing import NamedTuple

import numpy as np

from pandis.base.errors import PandisError, RepairError
from pandis.pipeline.mesh import tools
from pandis.pipeline.mesh.diagnosis import diagnose
from pandis.pipeline.mesh.ladder import Ladder
from pandis.pipeline.mesh.repair import climb
from pandis.pipeline.mesh.solidify import with_solid
from pandis.pipeline.mesh.topology import compact

#: Operations that change no surface and take seconds at most; a forecast runs them.
_LOSSLESS = ("clean", "orient")


class Forecast(NamedTuple):
    """What repair would do.

    Attributes
    ----------
    outcome : {"nothing", "lossless", "repair", "refusal"}
        The mesh is valid; its faults go away without moving the surface; rungs that fill holes,
        unite or rebuild will be tried; or it is refused unless an option changes.
    begins_with : str
        With ``repair``: the first of these rungs.
    option : dict
        With ``refusal``: options of `mesh` with which it would be repaired, as far as is known.
    message : str
        With ``refusal``: the reason, and what to do.
    """

    outcome: str
    begins_with: str = ""
    option: dict = {}  # noqa: RUF012
    message: str = ""


class _SlowRungError(Exception):
    """The ladder has come to a rung that a forecast does not run."""


class _Forecasting(Ladder):
    """A ladder that runs only lossless operations, in this process."""

    def attempt(self, rung, operation, accept, **parameters):
        if operation not in _LOSSLESS:
            raise _SlowRungError(rung)
        entry = {"rung": rung, "operation": operation, "parameters": parameters}
        vertices, faces = tools.OPERATIONS[operation](self.vertices, self.faces, **parameters)
        if np.array_equal(vertices, self.vertices) and np.array_equal(faces, self.faces):
            return False
        diagnosis = diagnose(vertices, faces)
        reason = accept(vertices, faces, diagnosis)
        if reason is None:
            self.vertices, self.faces, self.now = vertices, faces, diagnosis
        self.note(entry, reason, diagnosis)
        return reason is None

    def within_budget(self, vertices, faces, diagnosis, *, allowance=0.0):
        """Accept: lossless operations move nothing."""
        del vertices, faces, diagnosis, allowance


def forecast(vertices, faces, options, *, diagnosis, seed=0):
    """Return the `Forecast` of a mesh.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), float64
    faces : ndarray, shape (F, 3), int64
    options : pandis.pipeline.run.ask.options.MeshOptions
    diagnosis : pandis.pipeline.mesh.diagnosis.Diagnosis
        Diagnosis of this mesh.
    seed : int
    """
    if diagnosis.valid:
        return Forecast("nothing")
    # otherwise cleaning would drop unreferenced vertices and need another diagnosis
    vertices, faces = compact(vertices, faces)
    ladder = _Forecasting(vertices, faces, options, seed, lambda text: None, now=diagnosis)
    try:
        climb(ladder)
    except _SlowRungError as rung:
        return Forecast("repair", begins_with=str(rung))
    except RepairError as error:
        if options.solid == "always":
            return Forecast("repair", begins_with="solid")
        error = with_solid(error, vertices, faces, options=options)
        return Forecast("refusal", option=error.option, message=str(error))
    except PandisError as error:
        return Forecast("refusal", message=str(error))
    return Forecast("lossless")
