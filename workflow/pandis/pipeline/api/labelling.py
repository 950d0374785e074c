"""Labels points with exact distances and normals, for training and for queries."""

import os
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pandis.base.errors import PandisError
from pandis.base.frame import Frame
from pandis.base.progress import Log
from pandis.pipeline.api.options import sections
from pandis.pipeline.api.running import stages
from pandis.pipeline.api.writing import write_arrays
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.strata import STRATA
from pandis.pipeline.run.ask.datasets import LABELS
from pandis.pipeline.run.records.mesh import MeshRecord
from pandis.runtime.field import Floats
from pandis.runtime.field.points import as_rows

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
else:
    ArrayLike = object  # NumPy accepts more than numpy.typing.ArrayLike allows

#: Bytes of memory that a point takes while it is drawn, labelled and converted.
_BYTES = 200


class Labels(NamedTuple):
    """Points with exact labels, in mesh units.

    Attributes
    ----------
    points : ndarray, shape (n, 3), float64
    distance : ndarray, shape (n,), float64
        Signed distance, negative inside: exact at these points, and rounded to single precision.
        On the stratum ``surface`` it is 0, though single precision moves points by up to 1e-7 of
        the size.
    normal : ndarray, shape (n, 3), float32
        Unit vector away from the surface outside, towards it inside: the gradient of the distance.
    stratum : ndarray, shape (n,), uint8
        The rule by which each point was drawn: an index into `STRATA`.
    tied : ndarray, shape (n,), bool
        Whether two points of the surface are closest, so that the normal is arbitrary.
    frame : Frame
        The unit frame, for programs that normalise.
    moved : float
        Largest distance between the mesh and its repaired surface, either way, caps apart; 0 if it
        was valid.
    """

    points: np.ndarray
    distance: np.ndarray
    normal: np.ndarray
    stratum: np.ndarray
    tied: np.ndarray
    frame: Frame
    moved: float

    def save(self, path: str | PathLike[str], force: bool = False) -> None:
        """Write an ``.npz`` file with these arrays, ``strata``, ``centre`` and ``scale``."""
        arrays = self._asdict()
        frame = arrays.pop("frame")
        arrays |= {"strata": np.array(STRATA), "centre": np.array(frame.centre)}
        if Path(path).suffix != ".npz":
            raise PandisError(f"{path}: labels are written as .npz")
        write_arrays(path, arrays | {"scale": np.array(frame.scale)}, force=force)


def labels(mesh: object, /, *, log: Log | None = None, **options: object) -> Labels:
    """Draw points on, near and around a mesh, and label them with exact distances and normals.

    A mesh that is not valid is repaired first.

    Parameters
    ----------
    mesh : path-like, pair of arrays, or object
        See `pandis.pipeline.api.sources.source_of`.
    log : callable, optional
        Receives lines about the progress.
    **options
        Options of `samples` and `mesh` in a configuration: ``surface``, ``near``, ``volume`` and
        the other strata are counts of points; and ``seed`` and ``name``.

    Raises
    ------
    PandisError
        The mesh cannot be read or repaired; the message says why, and which option would help.
    """
    config = sections(options, ("mesh", "samples"))
    counts = LABELS | config.get("samples", {})
    _check_counts([counts[name] for name in LABELS])
    config |= {"samples": LABELS | config.get("samples", {}), "fields": ["exact"]}
    with stages(mesh, config, log) as run:
        samples = run.artifact("samples")
        repaired = MeshRecord.of(run.artifact("mesh"))
    frame, arrays = Frame.of(samples), samples.arrays
    return Labels(
        points=frame.to_mesh(arrays["points"].astype(np.float64)),
        distance=arrays["distance"].astype(np.float64) / frame.scale,
        normal=arrays["normal"],
        stratum=arrays["stratum"],
        tied=arrays["tied"].astype(bool),
        frame=frame,
        moved=0.0 if repaired.shape else repaired.moved,
    )


def _check_counts(counts):
    """Refuse no points, and more than fit into this machine's memory."""
    total = sum(count for count in counts if isinstance(count, int) and count > 0)
    if not total and not any(counts):
        raise PandisError("no points are wanted: all counts are 0; set surface, near or volume")
    there = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if total * _BYTES > there:
        raise PandisError(
            f"{total:,} points need about {total * _BYTES / 1e9:,.0f} GB of memory, and there are "
            f"{there / 1e9:,.0f} GB; draw fewer, with several seeds"
        )


def signed_distance(
    mesh: object, points: ArrayLike, /, *, log: Log | None = None, **options: object
) -> Floats:
    """Return the exact signed distances (n,) of points (n, 3) from a mesh, negative inside.

    A mesh that is not valid is repaired first. The mesh is read and prepared at every call: for
    repeated queries, use `pandis.field` with ``kind="exact"``.

    Parameters
    ----------
    mesh, log
        As for `labels`.
    points : array-like, shape (n, 3), mesh units
    **options
        Options of `mesh` in a configuration, and ``seed`` and ``name``.
    """
    rows = as_rows(points)
    with stages(mesh, sections(options, ("mesh",)), log) as run:
        body = Body.open(run.artifact("mesh"))
    return body.distance.distance_and_normal(body.frame.to_unit(rows))[0] / body.frame.scale
