"""How long one query and a batch take, with the program a user would run."""

import time

import numpy as np

from pandis.errors import PandisError
from pandis.evaluation import libtorch
from pandis.export.check import FORCE
from pandis.export.session import Session
from pandis.forces import penalty_force
from pandis.frame import Frame
from pandis.machine import describe


def time_fields(fields, exports, mesh, points, options, progress):
    """Time every field of a mesh along its trajectory.

    Parameters
    ----------
    fields : list of pandis.fields.base.Field
        What is timed as the library answers it, in C but called from Python.
    exports : list of Path
        ``{field}.onnx``: run by ONNX Runtime on one thread, as a user's program would.
    mesh : pandis.artifact.Artifact
    points : ndarray, shape (m, 3), unit frame
    options : dict
        See `pandis.config.TimingOptions`.
    progress : callable
        Makes a `pandis.stage.Progress`.

    Returns
    -------
    arrays, attributes : dict
        As stored in ``timing.zarr.zip``: seconds of every single query and of every batch (per
        point), by field.
    """
    points = Frame.from_attributes(mesh.attributes["frame"]).to_mesh(points)
    answers = {f.name: (f.distance_and_normal, "C, called from Python") for f in fields}
    for path in exports:
        answers[path.stem] = (Session(path).distance_and_normal, "ONNX Runtime, 1 thread")
    arrays, found = {}, {}
    report = progress("fields", len(answers), "fields")
    counts = (options["queries"], options["batch"], options["repeats"])
    for index, (name, (answer, engine)) in enumerate(answers.items()):
        single, batched = time_queries(answer, points, *counts)
        arrays |= {f"single_{name}": single, f"batch_{name}": batched}
        found[name] = summarise(single, batched) | {"engine": engine}
        report.update(index + 1)
    return arrays, {"fields": found, "machine": describe(), "reproducible": False}


def time_program(path, mesh, points, options, found, log):
    """Time a network as the paper does, from a C++ program on LibTorch.

    Parameters
    ----------
    path : Path
        ``{field}.pt2``, its ``.onnx`` beside it.
    mesh, points, options
        As for `time_fields`.
    found : dict
        The figures of all fields: percentiles ``libtorch_…_us`` are added to the field's.
    log : callable

    Returns
    -------
    dict
        Seconds of every query, as stored.

    Raises
    ------
    PandisError
        The program does not build, or does not answer as the ONNX model does.
    """
    frame, name = Frame.from_attributes(mesh.attributes["frame"]), path.stem
    points = frame.to_mesh(points)
    distance, normal, seconds = libtorch.ask(path, points, options["queries"])
    wanted = Session(path.with_suffix(".onnx")).distance_and_normal(points)
    force, wanted_force = penalty_force(distance, normal), penalty_force(*wanted)
    off = np.linalg.norm(force - wanted_force, axis=1).max() * frame.scale
    if not off <= 2 * FORCE:  # each may differ by so much from the network
        raise PandisError(
            f"{path}: its force in LibTorch differs from the ONNX model's by {off:.3g}, allowed is "
            f"{2 * FORCE:.3g}; please report it, and set timing.libtorch to false"
        )
    percentiles = dict(
        zip(("p50", "p99", "p999"), np.percentile(seconds, [50, 99, 99.9]), strict=True)
    )
    found[name] |= {f"libtorch_{key}_us": float(s * 1e6) for key, s in percentiles.items()}
    log(
        f"{name}: {percentiles['p50'] * 1e6:.1f} µs per query in LibTorch; force as ONNX, {off:.1e}"
    )
    return {f"libtorch_{name}": seconds}


def time_queries(answer, points, queries, batch, repeats):
    """Time a field.

    Parameters
    ----------
    answer : callable
        Answers (distance, normal) at points (n, 3).
    points : ndarray, shape (m, 3)
        Queries are taken from these in order, over and over.
    queries, batch, repeats : int
        Single queries; points of a batch; batches.

    Returns
    -------
    single : ndarray, shape (queries,)
        Seconds of each single query, after a warm-up.
    batched : ndarray, shape (repeats,)
        Seconds per point, of each batch.
    """
    single = np.empty(queries)
    clock = time.perf_counter
    one = [np.ascontiguousarray(points[i % len(points)][None]) for i in range(queries)]
    for point in one[:100]:
        answer(point)
    for index, point in enumerate(one):
        start = clock()
        answer(point)
        single[index] = clock() - start
    many = points[np.arange(batch) % len(points)]
    batched = np.empty(repeats)
    answer(many)
    for index in range(repeats):
        start = clock()
        answer(many)
        batched[index] = (clock() - start) / batch
    return single, batched


def summarise(single, batched):
    """Return the figures of `time_queries` in microseconds per query."""
    p50, p99, p999 = np.percentile(single, [50, 99, 99.9]) * 1e6
    return {
        "one_p50_us": float(p50),
        "one_p99_us": float(p99),
        "one_p999_us": float(p999),
        "batch_us": float(np.median(batched) * 1e6),
    }
