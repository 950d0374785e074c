"""Runs rungs in child processes, diagnoses the results, and records whether each is kept."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from pandis.base.errors import PandisError
from pandis.pipeline.mesh import tools
from pandis.pipeline.mesh.deviation import Surface, deviation, inside_changed, none
from pandis.pipeline.mesh.diagnosis import Diagnosis, diagnose
from pandis.pipeline.mesh.processes import (
    CpuTime,
    CpuTimeError,
    LimitError,
    MissingError,
    ToolError,
)
from pandis.pipeline.mesh.topology import compact
from pandis.pipeline.run.ask.options import MeshOptions

#: Rungs that keep the source's surface; only these are tried if a solid is made otherwise.
EXACT = ("clean", "union", "fill")
#: Lossless operations, to which `mesh.solid_after` does not apply.
_UNTIMED = ("clean", "orient", "split")
#: Largest volume that a rung may add or remove, as a share of the inside.
INSIDE_CHANGED = 0.02


class State(NamedTuple):
    """A snapshot of a `Ladder`."""

    vertices: np.ndarray
    faces: np.ndarray
    now: Diagnosis
    source: Surface
    reference: Surface
    deviation: dict
    rungs: list


@dataclass
class Ladder:
    """A mesh under repair, with a record of all attempts to repair it.

    Attributes
    ----------
    vertices, faces : ndarray
        The current mesh.
    options : pandis.pipeline.run.ask.options.MeshOptions
    seed : int
    log : pandis.base.progress.Log
    now : Diagnosis
        Diagnosis of the current mesh.
    rungs : list of dict
        Every attempt: rung, operation, parameters, whether kept (if not, why), remaining faults.
    source, reference : Surface
        Meshes from which deviations are measured: the mesh as read, and the same mesh
        after welding and outward orientation, so that its inside is defined.
    deviation : dict or None
        Deviation of the current mesh; None if it was not measured.
    cpu : pandis.pipeline.mesh.processes.CpuTime or None
        What `union` and `fill` may still use before a solid is made; None if none is made.
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
    cpu: CpuTime | None = None
    _measured: dict | None = None

    def allows(self, rung):
        """Return whether the configuration allows a rung."""
        if self.cpu is not None and rung not in EXACT:
            return False
        return rung in self.options.rungs

    @property
    def closes_holes(self):
        """Whether large holes are filled, not refused."""
        return self.options.open == "cap" or (
            self.cpu is not None and self.options.open == "refuse"
        )

    def attempt(self, rung, operation, accept, **parameters):
        """Run an operation in a child process; keep its result if ``accept`` returns None.

        Parameters
        ----------
        rung : str
            Name of the rung in ``mesh.rungs``.
        operation : str
            A key of `pandis.pipeline.mesh.tools.OPERATIONS`.
        accept : callable
            Takes the result's vertices, faces and diagnosis; returns None or
            the reason for rejecting it.

        Returns
        -------
        bool
            Whether the result was kept.
        """
        cpu = None if operation in _UNTIMED else self.cpu
        limits = {
            "seconds": self.options.rung_seconds,
            "memory_gb": self.options.rung_memory_gb,
            "cpu": cpu,
        }
        entry = {"rung": rung, "operation": operation, "parameters": parameters}
        if cpu is not None and cpu.left <= 0:
            self.note(entry, "no time is left (mesh.solid_after)")
            return False
        try:
            vertices, faces = tools.call(
                operation, self.vertices, self.faces, **limits, **parameters
            )
        except CpuTimeError as error:
            self.note(entry, f"{error} (mesh.solid_after)")
            return False
        except (LimitError, MissingError) as error:
            left = [name for name in self.options.rungs if name != rung]
            out = f"or leave this rung out: mesh.rungs: [{', '.join(left)}]"
            # stop: if the next rung ran instead, the mesh would depend on what is installed
            if isinstance(error, MissingError):
                remedy = (
                    f"needs a package: {error}; pip install 'pandis-fields[make,repair]', {out}"
                )
            else:
                key = "rung_seconds" if "longer" in str(error) else "rung_memory_gb"
                remedy = f"{error}; raise mesh.{key}, {out}"
            raise PandisError(f"repair: {rung} {remedy}") from error
        except ToolError as error:
            self.note(entry, f"failed: {error}")
            return False
        if not len(faces):
            self.note(entry, "no faces are left")
            return False
        if np.array_equal(vertices, self.vertices) and np.array_equal(faces, self.faces):
            return False
        if not np.isfinite(vertices).all():
            self.note(entry, "some vertices are not finite")
            return False
        diagnosis = diagnose(vertices, faces)
        reason = accept(vertices, faces, diagnosis)
        if reason is None:
            self.vertices, self.faces, self.now = vertices, faces, diagnosis
            self.deviation, self._measured = self._measured, None
        self.note(entry, reason, diagnosis)
        return reason is None

    def state(self):
        """Return a snapshot that `go_back` can restore."""
        return State(
            self.vertices, self.faces, self.now, self.source, self.reference, self.deviation,
            [dict(entry) for entry in self.rungs],
        )  # fmt: skip

    def go_back(self, state):
        """Restore a snapshot; results kept since then are recorded as discarded."""
        since = self.rungs[len(state.rungs) :]
        aside = {"kept": False, "reason": "discarded to try another method"}
        self.rungs = state.rungs + [entry | aside if entry["kept"] else entry for entry in since]
        self.vertices, self.faces, self.now = state.vertices, state.faces, state.now
        self.source, self.reference = state.source, state.reference
        self.deviation = state.deviation

    def has_kept(self, operation, since):
        """Return whether an operation's result was kept since a snapshot."""
        new = self.rungs[len(since.rungs) :]
        return any(entry["kept"] and entry["operation"] == operation for entry in new)

    def leave_out(self, loose, what):
        """Remove faces from the mesh and from `source` and `reference`.

        Parameters
        ----------
        loose : ndarray, shape (F,)
            Mask of the faces to remove.
        what : str
            Description of these faces, for the log.
        """
        self.vertices, self.faces = compact(self.vertices, self.faces[~loose])
        self.now = diagnose(self.vertices, self.faces)
        self.source = self.reference = Surface(self.vertices, self.faces)
        entry = {"rung": "clean", "operation": "leave out", "parameters": {"what": what}}
        self.log(f"left out: {what}")
        self.note(entry, None, self.now)

    def note(self, entry, reason, diagnosis=None):
        """Record and log an attempt; ``reason`` is None if its result was kept."""
        entry["kept"] = reason is None
        entry["reason"] = reason
        entry["faults"] = diagnosis.faults() if diagnosis else None
        self.rungs.append(entry)
        text = f"{entry['operation']}: "
        text += "kept" if reason is None else f"not kept ({reason})"
        if diagnosis:
            text += f"; {diagnosis.faces:,} faces; faults: {entry['faults']}"
        self.log(text)

    # --- acceptance of results ----------------------------------------------------------

    def not_worse(self, vertices, faces, diagnosis):
        """Accept a mesh with no more faults than before."""
        del vertices, faces
        return None if diagnosis.rank <= self.now.rank else "more faults than before"

    def better(self, vertices, faces, diagnosis):
        """Accept a mesh with fewer faults, within the deviation budget."""
        if not diagnosis.valid and diagnosis.rank >= self.now.rank:
            return "no fewer faults than before"
        return self.within_budget(vertices, faces, diagnosis)

    def valid_only(self, vertices, faces, diagnosis):
        """Accept a valid mesh within the deviation budget."""
        if not diagnosis.valid:
            return "not valid"
        return self.within_budget(vertices, faces, diagnosis)

    def within_budget(self, vertices, faces, diagnosis, *, allowance=0.0):
        """Measure the deviation; return None if it is within the budget, else a reason."""
        del diagnosis
        result, seed = Surface(vertices, faces), self.seed
        changed = 0.0 if allowance else inside_changed(self.reference, result, seed)
        if changed > INSIDE_CHANGED:
            return f"{100 * changed:.3g} % of the inside would be added or lost"
        wall = 1.01 * allowance * self.source.diagonal
        moved = deviation(self.source, result, seed, reference=self.reference, wall=wall)
        for way in ("to_result", "to_source"):
            for key in ("p99", "max"):
                share = moved[way][key] / self.source.diagonal - allowance
                if share > getattr(self.options, f"deviation_{key}"):
                    return (
                        f"deviation {way.replace('_', ' ')}: {key} {100 * share:.3g} % of the "
                        f"diagonal, but mesh.deviation_{key} is "
                        f"{100 * getattr(self.options, f'deviation_{key}'):g} %"
                    )
        self._measured = moved
        return None
