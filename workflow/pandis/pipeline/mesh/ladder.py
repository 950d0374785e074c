"""One rung at a time: run it in its own process, diagnose, keep it or not, and write down why."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from pandis.base.errors import PandisError
from pandis.pipeline.mesh import tools
from pandis.pipeline.mesh.deviation import Surface, deviation, inside_changed, none
from pandis.pipeline.mesh.diagnosis import Diagnosis, diagnose
from pandis.pipeline.mesh.topology import compact
from pandis.pipeline.run.ask.options import MeshOptions

#: No rung may turn more of the inside to outside, or back, than this.
INSIDE_CHANGED = 0.02


class State(NamedTuple):
    """Where a ladder stood."""

    vertices: np.ndarray
    faces: np.ndarray
    now: Diagnosis
    source: Surface
    reference: Surface
    deviation: dict
    rungs: list


@dataclass
class Ladder:
    """A mesh on its way up, and what has been done to it.

    Attributes
    ----------
    vertices, faces : ndarray
        The mesh as it is now.
    options : pandis.pipeline.run.ask.options.MeshOptions
    seed : int
    log : callable
    now : Diagnosis
        Diagnosis of the mesh as it is now.
    rungs : list of dict
        Every attempt: rung, operation, parameters, kept or not, why not, faults left.
    source, reference : Surface
        What deviations are measured from: the mesh as read; the same, welded
        and turned outward, which knows inside from outside.
    deviation : dict or None
        Deviation of the mesh as it is now; None where it was not measured.
    """

    vertices: np.ndarray
    faces: np.ndarray
    options: MeshOptions
    seed: int
    log: Callable
    now: Diagnosis
    rungs: list = field(default_factory=list)
    source: Surface = None
    reference: Surface = None
    deviation: dict | None = field(default_factory=none)
    _measured: dict | None = None

    def allows(self, rung):
        """Tell whether the configuration lets this rung run."""
        return rung in self.options.rungs

    def attempt(self, rung, operation, accept, **parameters):
        """Run an operation in its own process; keep its result if ``accept`` says so.

        Parameters
        ----------
        rung : str
            The name under which ``mesh.rungs`` lists it.
        operation : str
            See `pandis.pipeline.mesh.tools`.
        accept : callable
            From the result's vertices, faces and diagnosis to None or the
            reason for refusing it.

        Returns
        -------
        bool
            Whether the result was kept.
        """
        limits = {
            "seconds": self.options.rung_seconds,
            "memory_gb": self.options.rung_memory_gb,
        }
        entry = {"rung": rung, "operation": operation, "parameters": parameters}
        try:
            vertices, faces = tools.call(
                operation, self.vertices, self.faces, **limits, **parameters
            )
        except tools.LimitError as error:
            left = [name for name in self.options.rungs if name != rung]
            key = "rung_seconds" if "longer" in str(error) else "rung_memory_gb"
            raise PandisError(
                f"repair: {rung} {error}; raise mesh.{key}, or leave this rung out: "
                f"mesh.rungs: [{', '.join(left)}]"
            ) from error
        except tools.ToolError as error:
            self._note(entry, f"failed: {error}")
            return False
        if not len(faces):
            self._note(entry, "nothing is left")
            return False
        if np.array_equal(vertices, self.vertices) and np.array_equal(faces, self.faces):
            return False
        if not np.isfinite(vertices).all():
            self._note(entry, "gave vertices that are not finite")
            return False
        diagnosis = diagnose(vertices, faces)
        reason = accept(vertices, faces, diagnosis)
        if reason is None:
            self.vertices, self.faces, self.now = vertices, faces, diagnosis
            self.deviation, self._measured = self._measured, None
        self._note(entry, reason, diagnosis)
        return reason is None

    def state(self):
        """Return what `go_back` takes."""
        return State(
            self.vertices, self.faces, self.now, self.source, self.reference, self.deviation,
            [dict(entry) for entry in self.rungs],
        )  # fmt: skip

    def go_back(self, state):
        """Be where a state was; what was kept since then is written down as set aside."""
        since = self.rungs[len(state.rungs) :]
        aside = {"kept": False, "reason": "set aside for another way"}
        self.rungs = state.rungs + [entry | aside if entry["kept"] else entry for entry in since]
        self.vertices, self.faces, self.now = state.vertices, state.faces, state.now
        self.source, self.reference = state.source, state.reference
        self.deviation = state.deviation

    def has_kept(self, operation, since):
        """Tell whether an operation was kept since a state."""
        new = self.rungs[len(since.rungs) :]
        return any(entry["kept"] and entry["operation"] == operation for entry in new)

    def leave_out(self, loose, what):
        """Go on without some faces (F,), from which deviations are not measured either.

        Parameters
        ----------
        loose : ndarray, shape (F,)
        what : str
            What they are.
        """
        self.vertices, self.faces = compact(self.vertices, self.faces[~loose])
        self.now = diagnose(self.vertices, self.faces)
        self.source = self.reference = Surface(self.vertices, self.faces)
        entry = {"rung": "clean", "operation": "leave out", "parameters": {"what": what}}
        self.log(f"left out: {what}")
        self._note(entry, None, self.now)

    def _note(self, entry, reason, diagnosis=None):
        entry["kept"] = reason is None
        entry["reason"] = reason
        entry["faults"] = diagnosis.faults() if diagnosis else None
        self.rungs.append(entry)
        text = f"{entry['operation']}: "
        text += "kept" if reason is None else f"not kept ({reason})"
        if diagnosis:
            text += f"; {diagnosis.faces:,} faces; faults: {entry['faults']}"
        self.log(text)

    # --- what counts as better ----------------------------------------------------------

    def not_worse(self, vertices, faces, diagnosis):
        """Accept what keeps or lowers the number of faults."""
        del vertices, faces
        return None if diagnosis.rank <= self.now.rank else "more faults than before"

    def better(self, vertices, faces, diagnosis):
        """Accept fewer faults within the deviation budget."""
        if not diagnosis.valid and diagnosis.rank >= self.now.rank:
            return "no fewer faults than before"
        return self.within_budget(vertices, faces, diagnosis)

    def valid_only(self, vertices, faces, diagnosis):
        """Accept a valid mesh within the deviation budget."""
        if not diagnosis.valid:
            return "not valid"
        return self.within_budget(vertices, faces, diagnosis)

    def within_budget(self, vertices, faces, diagnosis, allowance=0.0):
        """Measure the deviation; return None or what exceeds the budget."""
        del diagnosis
        result, seed = Surface(vertices, faces), self.seed
        changed = 0.0 if allowance else inside_changed(self.reference, result, seed)
        if changed > INSIDE_CHANGED:
            return f"{100 * changed:.3g} % of the inside would be added or lost"
        wall = 1.01 * allowance * self.source.diagonal
        moved = deviation(self.source, result, seed, self.reference, wall)
        for way in ("to_result", "to_source"):
            for key in ("p99", "max"):
                share = moved[way][key] / self.source.diagonal - allowance
                if share > getattr(self.options, f"deviation_{key}"):
                    return (
                        f"deviation {way.replace('_', ' ')}: {key} {100 * share:.3g} % of the "
                        f"diagonal, mesh.deviation_{key} is "
                        f"{100 * getattr(self.options, f'deviation_{key}'):g} %"
                    )
        self._measured = moved
        return None
