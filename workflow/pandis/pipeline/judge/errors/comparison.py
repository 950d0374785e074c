"""Measures all errors of a mesh's fields, for the evaluation stage."""

import numpy as np

from pandis.base.physical import Scale
from pandis.base.streams import CONTACTS, generator
from pandis.pipeline.geometry.measure import draw_contacts
from pandis.pipeline.geometry.sampling import probes
from pandis.pipeline.judge.controls import controls
from pandis.pipeline.judge.errors.coverage import coverage
from pandis.pipeline.judge.errors.errors import evaluate
from pandis.pipeline.judge.errors.paths import over_paths, several
from pandis.pipeline.judge.errors.view import surface_errors
from pandis.pipeline.run.records.evaluation import EvaluationRecord


def compare(fields, trajectory, options, *, progress):
    """Compare all fields of a body with the exact one.

    Parameters
    ----------
    fields : pandis.pipeline.kinds.opening.Fields
    trajectory : dict of str to ndarray
        ``points``, ``distance`` and ``normal`` along the probe's path: exact, unit frame.
    options : pandis.pipeline.run.ask.tasks.EvaluateTask
    progress : pandis.base.progress.Progress

    Returns
    -------
    arrays, attributes : dict
        As stored in ``evaluation.zarr.zip``, without the frame.

    Raises
    ------
    PandisError
        The measure of missing surface passes a control.
    """
    body, seed, count = fields.body, options.seed, options.probes
    scale = Scale.of(options)
    path = tuple(trajectory[key] for key in ("points", "distance", "normal"))
    sets = probes(body, count, seed)
    contacts = draw_contacts(body, scale, count, rng=generator(seed, CONTACTS), even=True)
    tried = controls(fields.exact, scale)
    arrays, attributes = evaluate(
        fields, tried, path, probe_sets=sets, contacts=contacts, progress=progress
    )
    arrays |= surface_errors(
        fields, body.distance, body.corners, faces=body.faces, progress=progress
    )
    paths = several(path, body, options, progress=progress)
    arrays["paths"] = np.array([points for points, _, _ in paths], np.float32)
    record = EvaluationRecord(
        **attributes,
        coverage=coverage(body, arrays["paths"], seed),
        paths=over_paths(fields, paths) if len(paths) > 1 else {},
        size=scale.size,
        stiffness=scale.stiffness,
        newtons=scale.newtons,
        count=len(paths),
    )
    return arrays, record.attributes()
