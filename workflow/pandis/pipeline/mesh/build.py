"""The mesh stage: builds the arrays and attributes of ``mesh.zarr.zip`` from a source."""

import numpy as np

from pandis.base.frame import Frame
from pandis.pipeline.geometry.shapes import find_shape
from pandis.pipeline.mesh.diagnosis import diagnose
from pandis.pipeline.mesh.intake import find_file, read_mesh
from pandis.pipeline.mesh.regions import named_in, read_beside, regions_after
from pandis.pipeline.mesh.repair import repair
from pandis.pipeline.mesh.topology import used_vertices


def build(options, source_file, log):
    """Read and repair a mesh, or tessellate a closed form.

    Parameters
    ----------
    options : pandis.pipeline.run.ask.tasks.MeshTask
    source_file : path-like or None
        The file that the workflow has fetched or found. If None, the source itself is read.
    log : pandis.base.progress.Log

    Returns
    -------
    arrays, attributes : dict

    Raises
    ------
    PandisError
        The source is unusable, or the mesh cannot be made valid.
    """
    source = options.source
    if source.startswith("analytic:"):
        return _closed_form(source, log)
    path = find_file(str(source_file or source))
    reading, record = read_mesh(
        source,
        path,
        options.sha256,
        seconds=options.reader_seconds,
        memory_gb=options.reader_memory_gb,
    )
    vertices, faces = reading.vertices, reading.faces
    log(f"read {source}")
    for note in reading.notes:
        log(f"{source}: {note}")
    beside = read_beside(path, record["format"], len(faces)) or named_in(reading, log)
    unit = options.unit if options.unit != "unknown" else reading.unit
    options = options.model_copy(update={"unit": unit})
    arrays, history = repair(vertices, faces, options, seed=options.seed, log=log)
    used = arrays["vertices"][used_vertices(arrays["faces"])]
    frame = Frame.of_bounds(used.min(axis=0), used.max(axis=0))
    attributes = history | {
        "source": {"name": source, **record, "unit": unit},
        **frame.attributes(),
        "shape": None,
    }
    repaired, regions = (arrays["vertices"], arrays["faces"]), None
    if beside:
        regions = regions_after((vertices, faces), beside, repaired, log=log)
    if regions:
        arrays["region"], attributes["regions"] = regions
    return arrays, attributes


def _closed_form(source, log):
    name = source.removeprefix("analytic:")
    shape = find_shape(name)
    vertices, faces = shape.tessellation()
    frame = Frame.of_bounds(-shape.half_extent, shape.half_extent)
    diagnosis = diagnose(vertices, faces)
    # distance from the centres of the flat faces to the true surface
    off = np.abs(shape.distance_and_normal(vertices[faces].mean(axis=1))[0])
    distances = {
        "max": float(off.max()),
        "p99": float(np.percentile(off, 99)),
        "mean": float(off.mean()),
    }
    log(f"{source}: {diagnosis.faces:,} faces, at most {off.max():.2g} from the closed form")
    attributes = {
        "source": {"name": source, "unit": "unknown"},
        "before": diagnosis.attributes(),
        "faults_before": diagnosis.faults(),
        "after": diagnosis.attributes(),
        "rungs": [],
        "solid": None,
        "deviation": {
            "to_result": distances | {"hidden": 0.0},
            "to_source": distances | {"caps": 0.0},
            "untouched": 1.0,
        },
        **frame.attributes(),
        "shape": name,
    }
    arrays = {
        "vertices": vertices,
        "faces": faces.astype(np.int32),
        "origin": np.zeros(len(faces), np.uint8),
        "deviation": off.astype(np.float32),
    }
    return arrays, attributes
