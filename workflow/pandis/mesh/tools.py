"""What runs in a process of its own: mesh readers, and tools under another licence.

Some readers crash on valid files, some hang, and PyMeshLab is GPL: so each call
is ``python -m pandis.mesh.tools OPERATION ARGUMENT… OUTPUT.npz`` under limits of
time and memory. Arrays travel as ``.npz`` in float64, never as a mesh format.
"""

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np


class ToolError(Exception):
    """A tool failed; the message says how, in a few words."""


def call(operation, *arguments, seconds, memory_gb):
    """Run an operation of this module in a child process.

    Parameters
    ----------
    operation : str
        A key of OPERATIONS.
    arguments : str
    seconds, memory_gb : float
        Limits; beyond them the child is ended.

    Returns
    -------
    vertices : ndarray, shape (V, 3), float64
    faces : ndarray, shape (F, 3), int64

    Raises
    ------
    ToolError
        It crashed, ran out of time or memory, or found nothing.
    """
    limit = int(memory_gb * 2**30)

    def restrict():
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "mesh.npz"
        command = [
            sys.executable,
            "-m",
            __spec__.name,
            operation,
            *map(str, arguments),
            str(output),
        ]
        root = str(Path(__file__).resolve().parents[2])
        environment = os.environ | {"PYTHONPATH": root, "OMP_NUM_THREADS": "1"}
        try:
            done = subprocess.run(
                command,
                env=environment,
                timeout=seconds,
                preexec_fn=restrict,
                capture_output=True,
                text=True,
                errors="replace",
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise ToolError(f"took longer than {seconds:g} s") from error
        if done.returncode < 0:
            raise ToolError(f"crashed (signal {-done.returncode})")
        if done.returncode or not output.is_file():
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            memory = "MemoryError" in last or "bad_alloc" in last
            raise ToolError(f"needs more than {memory_gb:g} GB of memory" if memory else last)
        with np.load(output) as data:
            return data["vertices"], data["faces"]


def read_trimesh(path):
    """Read a file with trimesh; scenes come as one mesh with their transforms applied."""
    import trimesh

    mesh = trimesh.load_mesh(path, process=False)
    return mesh.vertices, mesh.faces


def read_pymeshlab(path):
    """Read a file with PyMeshLab; several layers come as one mesh."""
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(path)
    if meshes.mesh_number() > 1:
        meshes.generate_by_merging_visible_meshes(mergevertices=False)
    mesh = meshes.current_mesh()
    return mesh.vertex_matrix(), mesh.face_matrix()


def close_holes(path, max_edges):
    """Close every hole of at most ``max_edges`` edges with PyMeshLab; no vertex moves."""
    import pymeshlab

    with np.load(path) as data:
        mesh = pymeshlab.Mesh(data["vertices"], data["faces"])
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(mesh)
    meshes.meshing_close_holes(
        maxholesize=int(max_edges), selfintersection=True, newfaceselected=False
    )
    mesh = meshes.current_mesh()
    return mesh.vertex_matrix(), mesh.face_matrix()


OPERATIONS = {f.__name__: f for f in (read_trimesh, read_pymeshlab, close_holes)}


def main(arguments):
    """Run one operation and store its mesh."""
    operation, *rest, output = arguments
    try:
        vertices, faces = OPERATIONS[operation](*rest)
    except MemoryError:
        raise
    except Exception as error:
        # one line on stderr is what the parent quotes
        sys.exit(" ".join(f"{type(error).__name__}: {error}".split())[:300])
    vertices = np.asarray(vertices, np.float64).reshape(-1, 3)
    np.savez(output, vertices=vertices, faces=np.asarray(faces, np.int64).reshape(-1, 3))


if __name__ == "__main__":
    main(sys.argv[1:])
