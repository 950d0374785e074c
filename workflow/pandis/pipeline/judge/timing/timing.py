"""Times single queries and batches, with the program a user would run."""

import time

import numpy as np

from pandis.base.errors import PandisError
from pandis.base.forces import penalty_force
from pandis.base.frame import Frame
from pandis.pipeline.judge.timing import libtorch
from pandis.pipeline.kinds.check import FORCE
from pandis.pipeline.kinds.session import Session
from pandis.pipeline.run.job.machine import describe
from pandis.pipeline.run.records.timing import TimingRecord
from pandis.runtime.field import NativeField
from pandis.runtime.field.constants import CACHES

#: BRUTE names the exact field without a tree, the paper's ground truth: a query visits every face.
#: BRUTE_COUNTS are its numbers of single queries, points per batch, and batches.
BRUTE, BRUTE_COUNTS = "exact-all-faces", (200, 0, 0)
_IN_C = "C, called from Python"
#: Number of random points in the box that are queried in C, and tries at each. The shortest time at
#: a point counts, so that the maximum is due to the field, not to the system.
ANYWHERE, TRIES = 2000, 3


def _of_format(files, suffix):
    return [path for path in files if path.suffix == suffix]


def time_fields(fields, files, body, *, points, options, progress):
    """Time every field of a mesh along its trajectory.

    Parameters
    ----------
    fields : list of pandis.pipeline.kinds.field.Field
        Fields to be called from Python.
    files : list of Path
        ``{field}.onnx``: run by ONNX Runtime on one thread, as in a user's program;
        ``{field}.pandis``: run by ``pandis.h``, timed in C.
    body : pandis.pipeline.geometry.body.Body
    points : ndarray, shape (m, 3), unit frame
    options : pandis.pipeline.run.ask.options.TimingOptions
    progress : pandis.base.progress.Progress

    Returns
    -------
    arrays, attributes : dict
        As stored in ``timing.zarr.zip``, by field and for `BRUTE`: time (s) of each single query,
        of each query with empty caches, and per point of each batch.
    """
    points = body.frame.to_mesh(points)
    counts = (options.queries, options.batch, options.repeats)
    answers = [(f.name, f.distance_and_normal, _IN_C, counts) for f in fields]
    if body.can_be_scanned:
        answers.append((BRUTE, body.scan, _IN_C, BRUTE_COUNTS))
    for path in _of_format(files, ".onnx"):
        answer = Session(path).distance_and_normal
        answers.append((path.stem, answer, "ONNX Runtime, 1 thread", counts))
    arrays, figures = {}, {}
    report = progress("fields", len(answers), "fields")
    for index, (name, answer, engine, counts) in enumerate(answers):
        queries, batch, repeats = counts
        single, batched = time_queries(answer, points, queries, batch=batch, repeats=repeats)
        arrays |= {f"single_{name}": single, f"batch_{name}": batched}
        figures[name] = summarise(single, batched) | {"engine": engine}
        if options.cold:
            cold = arrays[f"cold_{name}"] = time_cold(answer, points, options.cold)
            figures[name]["cold_p50_us"] = float(np.median(cold) * 1e6)
        report.update(index + 1)
    for path in _of_format(files, ".pandis"):
        seconds_of, quantiles = time_native(NativeField(path), points, options)
        arrays |= {f"{way}_{path.stem}": seconds for way, seconds in seconds_of.items()}
        figures.setdefault(path.stem, {}).update(quantiles)
    return arrays, TimingRecord(fields=figures, machine=describe()).attributes()


def time_native(field, points, options):
    """Time an exported field in C: along a path, at random points, and with empty caches.

    Parameters
    ----------
    field : pandis.runtime.field.NativeField
    points : ndarray, shape (m, 3), mesh units
        The trajectory.
    options : pandis.pipeline.run.ask.options.TimingOptions

    Returns
    -------
    arrays : dict of str to ndarray
        Time of each query (s): ``native`` in order along the path, ``anywhere`` at random points of
        the box (the shortest of several tries at each), ``native_cold`` along the path with empty
        caches.
    figures : dict
        Median and maximum of each of the three, and percentiles of ``native``, in microseconds.
    """
    field.time(points, 100)
    arrays = {"native": field.time(points, options.queries)}
    places = field.frame.to_mesh(np.random.default_rng(0).uniform(-1, 1, (ANYWHERE, 3)))
    tries = [field.time(places, ANYWHERE) for _ in range(TRIES)]
    arrays["anywhere"] = np.min(tries, axis=0)
    if options.cold:
        some = points[np.arange(options.cold) * len(points) // options.cold]
        arrays["native_cold"] = field.time(some, options.cold, cold=True)
    figures = _percentiles("native", arrays["native"])
    for way, seconds in arrays.items():
        figures[f"{way}_p50_us"] = float(np.median(seconds) * 1e6)
        figures[f"{way}_max_us"] = float(seconds.max() * 1e6)
    return arrays, figures


def time_program(path, mesh, points, *, options, figures, log):
    """Time a network as the paper does, from a C++ program on LibTorch.

    Parameters
    ----------
    path : Path
        ``{field}.pt2``, with its ``.onnx`` beside it.
    mesh, points, options
        The mesh's artifact; the others as for `time_fields`.
    figures : dict
        Figures of all fields. Percentiles ``libtorch_…_us`` are added to those of this field.
    log : pandis.base.progress.Log

    Returns
    -------
    dict
        Time of each query (s), as stored.

    Raises
    ------
    PandisError
        The program does not build, or its forces differ from the ONNX model's.
    """
    frame, name = Frame.of(mesh), path.stem
    points = frame.to_mesh(points)
    distance, normal, seconds = libtorch.ask(path, points, options.queries)
    expected = Session(path.with_suffix(".onnx")).distance_and_normal(points)
    force, wanted_force = penalty_force(distance, normal), penalty_force(*expected)
    off = np.linalg.norm(force - wanted_force, axis=1).max() * frame.scale
    if not off <= 2 * FORCE:  # each may differ from the network by FORCE
        raise PandisError(
            f"{path}: its force in LibTorch differs from the ONNX model's by {off:.3g} "
            f"({2 * FORCE:.3g} allowed); please report it, and set timing.libtorch to false"
        )
    times = _percentiles("libtorch", seconds)
    figures[name] |= times
    median = times["libtorch_p50_us"]
    log(f"{name}: {median:.1f} µs per query in LibTorch; force differs from ONNX by {off:.1e}")
    return {f"libtorch_{name}": seconds}


def time_queries(answer, points, queries, *, batch, repeats):
    """Time single queries and batches of a field.

    Parameters
    ----------
    answer : callable
        Returns (distance, normal) at points (n, 3).
    points : ndarray, shape (m, 3)
        Queries cycle through these points in order.
    queries, batch, repeats : int
        Number of single queries, of points per batch, and of batches.

    Returns
    -------
    single : ndarray, shape (queries,)
        Time of each single query (s), after a warm-up.
    batched : ndarray, shape (repeats,)
        Time per point of each batch (s).
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
    if not batch:
        return single, np.empty(0)
    many = points[np.arange(batch) % len(points)]
    batched = np.empty(repeats)
    answer(many)
    for index in range(repeats):
        start = clock()
        answer(many)
        batched[index] = (clock() - start) / batch
    return single, batched


def time_cold(answer, points, queries):
    """Time single queries after other work has emptied the caches.

    Parameters
    ----------
    answer, points, queries
        As for `time_queries`.

    Returns
    -------
    ndarray, shape (queries,)
        Time of each query (s).
    """
    clock, other, single = time.perf_counter, np.zeros(CACHES, np.uint8), np.empty(queries)
    for index in range(queries):
        point = np.ascontiguousarray(points[index * len(points) // queries][None])
        other += 1
        start = clock()
        answer(point)
        single[index] = clock() - start
    return single


def summarise(single, batched):
    """Return the figures of `time_queries` in microseconds per query."""
    figures = _percentiles("one", single)
    return figures | ({"batch_us": float(np.median(batched) * 1e6)} if len(batched) else {})


def _percentiles(way, seconds):
    """Return percentiles of single queries, in µs, with names that begin with ``way``."""
    times = np.percentile(seconds, [50, 99, 99.9]) * 1e6
    return dict(zip((f"{way}_{p}_us" for p in ("p50", "p99", "p999")), times.tolist(), strict=True))
