"""Repairs one mesh."""

from dataclasses import dataclass
from os import PathLike

import numpy as np

from pandis.base.frame import Frame
from pandis.base.progress import Log
from pandis.pipeline.api.options import sections
from pandis.pipeline.api.running import stages
from pandis.pipeline.api.writing import write_mesh
from pandis.pipeline.mesh.deviation import ORIGINS
from pandis.pipeline.run.records.mesh import MeshRecord


@dataclass(frozen=True)
class Mesh:
    """A valid mesh: closed, manifold, oriented outward, without self-intersections.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3), float64
        In the units of the source.
    faces : ndarray, shape (F, 3), int32
    origin : ndarray, shape (F,), uint8
        Where each face comes from: an index into `ORIGINS`.
    deviation : ndarray, shape (F,), float32
        Distance of each face's centre from the source, mesh units.
    record : MeshRecord
        The diagnoses ``before`` and ``after``, every repair that was tried (``rungs``), the
        ``deviation`` in both directions, and ``source``: as in ``mesh.zarr.zip``.
    frame : Frame
        The unit frame: the box's centre becomes 0, and its longest side 1.8.
    """

    vertices: np.ndarray
    faces: np.ndarray
    origin: np.ndarray
    deviation: np.ndarray
    record: MeshRecord
    frame: Frame

    #: Names of the numbers in `origin`.
    ORIGINS = ORIGINS

    @property
    def unchanged(self) -> bool:
        """Whether the source was valid as read."""
        return not self.record.rungs

    @property
    def rungs(self) -> list[str]:
        """Names of the repairs that were kept, in order."""
        return [attempt.operation for attempt in self.record.rungs if attempt.kept]

    def save(self, path: str | PathLike[str], force: bool = False) -> None:
        """Write the mesh as ``.ply``, ``.obj``, ``.off`` or ``.stl``.

        Raises
        ------
        PandisError
            The file exists (and not ``force``), or it would not contain this mesh: see
            `pandis.pipeline.api.writing.write_mesh`.
        """
        write_mesh(path, self.vertices, self.faces, force=force)

    def __repr__(self) -> str:
        did = "unchanged" if self.unchanged else "repaired by " + ", ".join(self.rungs)
        return f"<Mesh: {len(self.vertices):,} vertices, {len(self.faces):,} faces, {did}>"


def repair(mesh: object, /, *, log: Log | None = None, **options: object) -> Mesh:
    """Return a mesh as one closed, outward oriented surface, with a record of what was done.

    A mesh that is valid as read comes back bit for bit.

    Parameters
    ----------
    mesh : path-like, pair of arrays, or object
        See `pandis.pipeline.api.sources.source_of`.
    log : callable, optional
        Receives lines about the progress.
    **options
        Options of `mesh` in a configuration, such as ``open="cap"``, and ``seed`` and ``name``.

    Raises
    ------
    PandisError
        The mesh cannot be read or repaired; the message says why, and which option would help.
    """
    with stages(mesh, sections(options, ("mesh",)), log) as run:
        return mesh_of(run)


def mesh_of(run):
    """Return the `Mesh` of a `pandis.pipeline.api.running.Stages`."""
    artifact = run.artifact("mesh")
    arrays = [artifact.arrays[name] for name in ("vertices", "faces", "origin", "deviation")]
    return Mesh(*arrays, MeshRecord.of(artifact), Frame.of(artifact))
