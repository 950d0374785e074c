"""Operations that run in child processes: readers, repair rungs and tools under other licences.

Each call runs ``python -m pandis.pipeline.mesh.tools`` with limits on time and memory; in a worker
of a data set, a copy of the worker. There are three reasons: a crafted file can take hours to read,
some tools crash or hang, and PyMeshLab, the exact union and MeshFix are licensed under the GPL or
AGPL: no other process of ours imports them. Arrays come back as ``.npz`` in float64, never in a
mesh format.
"""

import json
import os
import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np

from pandis.base.children import python_path
from pandis.pipeline.mesh.formats import FormatError, Reading
from pandis.pipeline.mesh.formats import read as read_format
from pandis.pipeline.mesh.processes import (
    Clock,
    Limits,
    MissingError,
    ToolError,
    forked,
    lacks_memory,
    limit_memory,
    spawned,
)

#: Operations that can run in a process which is isolated itself: our own code, quick and harmless.
_QUICK = {"read_file", "clean", "orient", "split"}
_SETTINGS = {"isolated": True}


def isolate(isolated):
    """Set whether every operation has a new process; otherwise it is at most a copy of this one.

    Starting Python takes longer than repairing a small mesh. A worker that may crash, and whose
    time and memory are limited, runs quick operations itself and others in copies of itself.
    """
    _SETTINGS["isolated"] = isolated


def call(operation, vertices=None, faces=None, *, seconds, memory_gb, cpu=None, **parameters):
    """Run an operation of this module in a child process.

    Parameters
    ----------
    operation : str
        A key of `OPERATIONS`.
    vertices, faces : ndarray, optional
        The mesh to work on.
    seconds, memory_gb : float
        Limits on time (s) and memory (GiB).
    cpu : pandis.pipeline.mesh.processes.CpuTime, optional
        CPU time that is lent to the operation; what it uses is taken off if it succeeds.
    **parameters
        Further arguments of the operation: numbers and strings.

    Returns
    -------
    vertices : ndarray, shape (V, 3), float64
    faces : ndarray, shape (F, 3), int64

    Raises
    ------
    LimitError
        The operation exceeded its limit on time or memory.
    CpuTimeError
        It exceeded its limit on CPU time.
    MissingError
        The operation's package is not installed.
    ToolError
        The operation crashed or raised an exception.
    """
    return _run(operation, (vertices, faces), parameters, limits=Limits(seconds, memory_gb, cpu))[
        :2
    ]


def read(path, form, folder, *, seconds, memory_gb):
    """Read a mesh file in a child process.

    Parameters
    ----------
    path, form, folder
        As in `pandis.pipeline.mesh.formats.read`.
    seconds, memory_gb
        As in `call`.

    Returns
    -------
    pandis.pipeline.mesh.formats.Reading

    Raises
    ------
    pandis.pipeline.mesh.formats.FormatError
        The file cannot be read; the message says why.
    LimitError, ToolError
        As in `call`.
    """
    parameters = {"path": str(path), "form": form, "folder": str(folder)}
    try:
        return _run("read_file", (None, None), parameters, limits=Limits(seconds, memory_gb))
    except ToolError as error:
        prefix, _, message = str(error).partition(": ")
        if prefix == FormatError.__name__:
            raise FormatError(message) from None
        raise


def _run(operation, mesh, parameters, *, limits):
    if operation in _QUICK and not _SETTINGS["isolated"]:
        return _here(operation, mesh, parameters)
    lent = limits.cpu.left if limits.cpu else None
    with tempfile.TemporaryDirectory() as folder:
        source, output = Path(folder) / "given.npz", Path(folder) / "result.npz"
        if not _SETTINGS["isolated"]:
            _import_timed(lent)
            operate = partial(OPERATIONS[operation], *mesh, **parameters)
            forked(partial(_save, operate, output, lent), limits)
        else:
            if mesh[0] is not None:
                np.savez(source, vertices=mesh[0], faces=mesh[1])
            terms = json.dumps([limits.memory_gb, lent])
            arguments = [operation, json.dumps(parameters), terms, source, output]
            root = Path(__file__).resolve().parents[3]
            # the exact union orders faces by the number of libigl's threads
            one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "IGL_NUM_THREADS"), "1")
            environment = os.environ | {"PYTHONPATH": python_path(root), **one}
            spawned([sys.executable, "-m", __spec__.name, *arguments], environment, limits)
        if not output.is_file():
            raise ToolError("no result")
        with np.load(output) as data:
            if limits.cpu:
                limits.cpu.left -= float(data["seconds"])
            unit = str(data.get("unit", "unknown"))
            notes = data["notes"].tolist() if "notes" in data else []
            return Reading(data["vertices"], data["faces"], data.get("materials"), notes, unit)


def _here(operation, mesh, parameters):
    """Run an operation in this process; raise what `_run` would."""
    arrays = () if mesh[0] is None else mesh
    try:
        result = OPERATIONS[operation](*arrays, **parameters)
    except MemoryError:
        raise
    except ModuleNotFoundError as error:
        raise MissingError(str(error)) from None
    except Exception as error:
        if lacks_memory(error):  # the next rung would be tried in its place
            raise MemoryError from error
        raise ToolError(_in_one_line(error)) from None
    if isinstance(result, Reading):
        return result._replace(vertices=np.asarray(result.vertices, np.float64).reshape(-1, 3),
                               faces=np.asarray(result.faces, np.int64).reshape(-1, 3))  # fmt: skip
    return Reading(*result)


def _in_one_line(error):
    return " ".join(f"{type(error).__name__}: {error}".split())[:600]


def read_file(path, form, folder):
    """Read a file: see `pandis.pipeline.mesh.formats.read`."""
    return read_format(Path(path), form, Path(folder))


# --- rungs -----------------------------------------------------------------------------


def clean(vertices, faces, tolerance=0.0):
    """Weld, drop degenerate and duplicate faces: see `pandis.pipeline.mesh.cleanup.clean`."""
    from pandis.pipeline.mesh import cleanup

    return cleanup.clean(vertices, faces, tolerance)


def orient(vertices, faces, nested="cavity"):
    """Turn faces outward: see `pandis.pipeline.mesh.cleanup.orient`."""
    from pandis.pipeline.mesh import cleanup

    return cleanup.orient(vertices, faces, nested)


def split(vertices, faces, straight=False):
    """Make edges and vertices manifold: see `pandis.pipeline.mesh.cleanup.split`."""
    from pandis.pipeline.mesh import cleanup

    return cleanup.split(vertices, faces, straight)


def union(vertices, faces):
    """Compute the union of all enclosed volumes in exact arithmetic, with libigl and CGAL."""
    from igl.copyleft import cgal

    from pandis.pipeline.mesh import cleanup
    from pandis.pipeline.mesh.diagnosis import FLAT, altitudes
    from pandis.pipeline.mesh.topology import crossing_faces, edges_of, rotate_to_smallest

    vertices, faces, birth = cgal.mesh_boolean(
        vertices, faces, np.empty((0, 3)), np.empty((0, 3), np.int64), "union"
    )
    if not len(faces):
        return vertices, faces
    # sort the pieces of cut faces, because their order differs from run to run
    faces = rotate_to_smallest(faces)
    faces = faces[np.lexsort((*faces.T[::-1], birth))]
    flat = altitudes(vertices[faces])[0] <= FLAT
    if not (flat.any() or len(crossing_faces(vertices, faces))):
        return vertices, faces
    # rounding to float64 flattened faces or made them cross: weld close vertices, then perturb what
    # still crosses
    diagonal = np.linalg.norm(np.ptp(vertices, axis=0))
    welded = cleanup.clean(vertices, faces, 1e-9 * diagonal)
    if len(welded[1]) and edges_of(welded[1]).balanced:
        vertices, faces = welded
    vertices, faces = cleanup.loosen(vertices, faces)
    if left := len(crossing_faces(vertices, faces)):
        raise RuntimeError(f"{left} pairs of faces still cross after rounding")
    return vertices, faces


def skin(vertices, faces):
    """Remove the walls between the cells of one body, with libigl and CGAL.

    If a connected piece has edges with more than two faces, only its faces with the outside on
    exactly one side are kept. These are oriented outward.
    """
    from igl.copyleft import cgal

    from pandis.pipeline.mesh.topology import compact, components, edges_of

    label, count = components(faces)
    edges = edges_of(faces)
    torn = np.unique(label[np.flatnonzero(edges.nonmanifold[edges.edge_of]) // 3])
    stays, flipped = np.ones(len(faces), bool), np.zeros(len(faces), bool)
    for part in torn[torn < count]:
        members = np.flatnonzero(label == part)
        _, cells = cgal.extract_cells(*compact(vertices, faces[members]))
        outside = np.asarray(cells) == 0
        stays[members] = outside.sum(axis=1) == 1
        flipped[members] = outside[:, 1]
    faces = faces.copy()
    faces[flipped] = faces[flipped][:, ::-1]
    return compact(vertices, faces[stays])


def fill(vertices, faces):
    """Close every hole: see `pandis.pipeline.mesh.holes.fill_holes`."""
    from pandis.pipeline.mesh import holes

    return holes.fill_holes(vertices, faces)


def meshfix(vertices, faces):
    """Run MeshFix (Attene 2010) on each component separately, because it handles single bodies."""
    import pymeshfix
    from scipy.spatial import cKDTree

    from pandis.pipeline.mesh.topology import compact, components, used_vertices

    label, count = components(faces)
    parts, offset = [], 0
    for k in range(count):
        part = compact(vertices, faces[label == k])
        fixed = pymeshfix.clean_from_arrays(
            part[0], part[1].astype(np.int32), False, False, remove_smallest_components=False
        )
        if len(fixed[1]):
            parts.append((fixed[0], np.asarray(fixed[1], np.int64) + offset))
            offset += len(fixed[0])
    if not parts:
        return np.empty((0, 3)), np.empty((0, 3), np.int64)
    fixed = np.concatenate([p[0] for p in parts])
    # MeshFix rounds coordinates: restore those of vertices that it has not moved
    diagonal = np.linalg.norm(np.ptp(vertices[used_vertices(faces)], axis=0))
    gap, nearest = cKDTree(vertices).query(fixed)
    still = gap <= 1e-6 * diagonal
    fixed[still] = vertices[nearest[still]]
    return fixed, np.concatenate([p[1] for p in parts])


def remesh(vertices, faces, level):
    """Remesh by winding number: see `pandis.pipeline.mesh.remesh.winding_remesh`."""
    from pandis.pipeline.mesh.remesh import winding_remesh

    return winding_remesh(vertices, faces, level)


def wrap(vertices, faces, alpha, *, offset):
    """Wrap with CGAL's alpha wrap through PyMeshLab; lengths are shares of the diagonal."""
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces))
    meshes.generate_alpha_wrap(
        alpha=pymeshlab.PercentageValue(100 * alpha), offset=pymeshlab.PercentageValue(100 * offset)
    )
    mesh = meshes.current_mesh()
    return mesh.vertex_matrix(), mesh.face_matrix()


def simplify(vertices, faces, count):
    """Reduce to ``count`` faces by quadrics (Garland & Heckbert 1997), through libigl."""
    import igl

    vertices, faces = np.asfortranarray(vertices, np.float64), np.asfortranarray(faces, np.int32)
    simple, left, *_ = igl.qslim(vertices, faces, count)
    return simple, left


OPERATIONS = {
    f.__name__: f
    for f in (
        read_file,
        clean,
        orient,
        split,
        union,
        skin,
        fill,
        meshfix,
        remesh,
        wrap,
        simplify,
    )
}


def main(arguments):
    """Run one operation and store the resulting mesh."""
    operation, parameters, terms, source, output = arguments
    memory_gb, lent = json.loads(terms)
    limit_memory(memory_gb)
    _import_timed(lent)
    operate = partial(OPERATIONS[operation], **json.loads(parameters))
    if Path(source).is_file():
        with np.load(source) as data:
            operate = partial(operate, data["vertices"], data["faces"])
    _save(operate, output, lent)


def _import_timed(lent):
    """Import the modules of operations with a limit on CPU time, as imports do not count."""
    if lent is not None:
        from pandis.pipeline.mesh import cleanup, holes  # noqa: F401


def _save(operate, output, lent):
    """Run an operation within the CPU time that is lent to it, and store the result."""
    clock = Clock(lent)
    try:
        vertices, faces, *more = operate()
    except MemoryError:
        raise
    except Exception as error:
        if lacks_memory(error):
            raise MemoryError from error
        # the parent quotes the last line of stderr
        sys.exit(_in_one_line(error))
    spent = clock.stop()
    arrays = {
        "vertices": np.asarray(vertices, np.float64).reshape(-1, 3),
        "faces": np.asarray(faces, np.int64).reshape(-1, 3),
        "seconds": spent,
    }
    if more:
        materials, notes, unit = more
        arrays |= {"notes": np.array(notes, str), "unit": np.array(unit)}
        arrays |= {} if materials is None else {"materials": materials}
    np.savez(output, **arrays)


if __name__ == "__main__":
    main(sys.argv[1:])
