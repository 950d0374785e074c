"""Exports a mesh's distances for Newton's cache, after comparing them with the exact ones."""

import numpy as np

from pandis.base.errors import PandisError
from pandis.base.frame import UNIT_SIDE
from pandis.bridges.newton.cache import keep
from pandis.bridges.newton.cells import CELLS
from pandis.bridges.newton.reading import sample
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.kinds.native import native_bytes
from pandis.pipeline.run.job.artifact import seal_zip
from pandis.runtime.field import NativeField

#: Number of voxels along the longest side; Newton's margin and band, as fractions of the size.
_RESOLUTION, _MARGIN, _BAND = 128, 0.05, 0.1
#: Number of points compared, and the distance from the surface (fraction of the size) within which
#: errors are logged.
_POINTS, _NEAR = 100_000, 0.01
#: Largest accepted mean error of distances in the band, in cell diagonals.
_MEAN = 0.05


def export_newton(body, size, provenance, *, log, progress):
    """Return a ``.npz`` file that `pandis.bridges.newton.cache.unpack` puts into Newton's cache.

    Parameters
    ----------
    body : pandis.pipeline.geometry.body.Body
    size : float
        Longest side of the object, m.
    provenance : dict
    log : pandis.base.progress.Log
    progress : pandis.base.progress.Progress

    Raises
    ------
    PandisError
        Newton's interpolated distances differ from the exact ones by more than its resolution
        explains.
    """
    field = NativeField(native_bytes(ExactField("exact", body), {}))
    options = {
        "max_resolution": _RESOLUTION,
        "margin": _MARGIN * size,
        "narrow_band_range": (-_BAND * size, _BAND * size),
        "texture_format": "uint16",
        "sign_method": "winding",  # independent of whether Newton considers the mesh closed
    }
    length = size * body.frame.scale / UNIT_SIDE
    reports = {}

    def report(done, total):
        reports.setdefault(total, progress("cook", total)).update(done)

    data = keep(
        field,
        (body.vertices, body.faces),
        length,
        options=options,
        provenance=provenance,
        progress=report,
    )
    _compare(data.content, field, length, size=size, log=log)
    return seal_zip(data.packed())


def _compare(content, field, length, *, size, log):
    """Compare Newton's interpolated distances with exact ones within the extents of the grid."""
    rng = np.random.default_rng(0)
    points = rng.uniform(content["min_extents"], content["max_extents"], (_POINTS, 3))
    exact = field.query(points / length).distance * length
    off, exact = np.abs(sample(content, points)[0] - exact), np.abs(exact)
    # a distance changes no more than the point moves, and only the band has fine cells
    cell = float(np.linalg.norm(content["cell_size"]))
    band = exact < _BAND * size
    bound = np.where(band, cell, CELLS * cell)
    # errors comparable in size to a cell occur only at edges and creases, which are few
    if not ((off <= bound).all() and off[band].mean() <= _MEAN * cell):
        raise PandisError(
            f"Newton's interpolated distances are off by up to {float(off.max()):.3g} m; this is a "
            "defect of the export: please report it"
        )
    near = exact < _NEAR * size
    log(
        f"voxels of {1e3 * float(content['cell_size'].max()):.3g} mm: distances are off by "
        f"{1e6 * float(off[near].mean()):.3g} µm on average within {1e3 * _NEAR * size:.3g} mm "
        f"of the surface, and by {1e6 * float(off[near].max()):.3g} µm at most"
    )
