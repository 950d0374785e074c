"""Output files: meshes and arrays, each checked before it takes its place."""

import io
from pathlib import Path

import numpy as np

from pandis.base.errors import PandisError
from pandis.base.files import check_output, write_new
from pandis.base.obj import obj_text
from pandis.pipeline.mesh.diagnosis import diagnose
from pandis.pipeline.mesh.intake import read_mesh
from pandis.pipeline.mesh.topology import compact, same_place

#: Formats in which meshes are written; all but STL store every coordinate exactly.
MESH_FORMATS = ("obj", "off", "ply", "stl")
SINGLE = "STL stores coordinates in single precision, in which this mesh is not valid"


def mesh_format(path):
    """Return the format of a path's ending.

    Raises
    ------
    PandisError
        Meshes cannot be written in this format.
    """
    form = Path(path).suffix.lower().removeprefix(".")
    if form not in MESH_FORMATS:
        raise PandisError(
            f"{path}: meshes are written as "
            + ", ".join(f".{known}" for known in MESH_FORMATS)
            + f", not as '.{form}'"
        )
    return form


def mesh_bytes(form, vertices, faces):
    """Return a mesh as the bytes of a file.

    Parameters
    ----------
    form : str
        One of `MESH_FORMATS`.
    vertices : ndarray, shape (V, 3), float64
    faces : ndarray, shape (F, 3), integer
    """
    if form == "obj":
        return obj_text(vertices, faces).encode()
    if form == "off":
        rows = [f"OFF\n{len(vertices)} {len(faces)} 0"]
        rows += ["{!r} {!r} {!r}".format(*row) for row in vertices.tolist()]
        rows += ["3 {} {} {}".format(*row) for row in faces.tolist()]
        return ("\n".join(rows) + "\n").encode()
    if form == "ply":
        header = (
            "ply\nformat binary_little_endian 1.0\n"
            f"element vertex {len(vertices)}\n"
            "property double x\nproperty double y\nproperty double z\n"
            f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
        )
        rows = np.empty(len(faces), [("count", "u1"), ("corners", "<i4", 3)])
        rows["count"], rows["corners"] = 3, faces
        return header.encode() + np.asarray(vertices, "<f8").tobytes() + rows.tobytes()
    corners = np.asarray(vertices, np.float64)[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    rows = np.zeros(len(faces), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("end", "<u2")])
    rows["normal"], rows["corners"] = normals, corners
    return b"pandis".ljust(80) + np.uint32(len(faces)).tobytes() + rows.tobytes()


def write_mesh(path, vertices, faces, *, force=False):
    """Write a valid mesh, read it again and check it; only then does it take its place.

    Raises
    ------
    PandisError
        The file exists, cannot be written, or would not contain a valid mesh: STL stores
        coordinates in single precision, which may merge vertices or let faces cross.
    """
    path = Path(path)
    form = mesh_format(path)
    check_output(path, force=force)

    def check(part):
        try:
            reading, _ = read_mesh(str(path), part)
        except PandisError as error:
            if form != "stl":
                raise
            raise PandisError(f"{path}: {SINGLE} ({error}); write .ply or .obj instead") from None
        corners = reading.vertices[reading.faces]
        same = np.array_equal(
            corners, vertices[faces].astype(np.float32 if form == "stl" else float)
        )
        welded = same_place(reading.vertices)[reading.faces]  # STL repeats every vertex
        diagnosis = diagnose(*compact(reading.vertices, welded))
        if not (same and diagnosis.valid):
            raise PandisError(
                f"{path}: {SINGLE} ({diagnosis.faults()}); write .ply or .obj instead"
                if form == "stl"
                else f"{path}: the file does not contain the mesh that was written to it; this is "
                "a defect of pandis: please report it"
            )

    write_new(path, mesh_bytes(form, vertices, faces), check=check, force=force)


def write_arrays(path, arrays, *, force=False):
    """Write arrays as an ``.npz`` file."""
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    write_new(path, stream.getvalue(), force=force)
