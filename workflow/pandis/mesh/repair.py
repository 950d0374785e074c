"""From what was read to a closed, manifold, outward mesh, or a refusal with the diagnosis."""

import tempfile
from pathlib import Path

import igl
import numpy as np
from scipy.spatial import cKDTree

from pandis.errors import PandisError
from pandis.mesh import tools
from pandis.mesh.diagnosis import components, connected, diagnose, repeats_a_vertex, wrong_side


def repair(vertices, faces, options, log=print):
    """Climb a ladder of repairs, no higher than needed.

    A mesh that is valid as read is returned bit by bit as it is. The rungs:
    weld equal vertices and drop faces without area and doubles; weld within
    ``options["weld"]``; turn faces outward; fill small holes.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), float64, mesh units
    faces : ndarray, shape (F, 3), int64
    options : dict
        See `pandis.config.MeshOptions`.
    log : callable
        Takes a line of text.

    Returns
    -------
    vertices, faces : ndarray
    record : dict
        ``before`` and ``after`` (diagnoses), ``rungs`` (what was done, with counts).

    Raises
    ------
    PandisError
        The mesh stays open, non-manifold or inconsistent.
    """
    before = now = diagnose(vertices, faces)
    log(f"{now.vertices:,} vertices, {now.faces:,} faces; faults: {now.faults()}")
    rungs = []

    def climb(name, result, **details):
        nonlocal vertices, faces, now
        if result is not None:
            vertices, faces = result
            now = diagnose(vertices, faces)
            rungs.append({"rung": name, **details})
            log(f"{name}: {now.faces:,} faces; faults: {now.faults()}")

    if not now.valid:
        climb("clean", clean(vertices, faces), tolerance=0.0)
    if not now.closed and options["weld"]:
        tolerance = options["weld"] * now.diagonal
        climb("weld", clean(vertices, faces, tolerance), tolerance=tolerance)
    if now.closed and not now.valid:
        climb("orient", orient(vertices, faces))
    if now.boundary_edges and not now.nonmanifold_edges:
        check_holes(now, options)
        climb("orient", orient(vertices, faces))
        filled = fill_holes(vertices, faces, now, options)
        climb("fill holes", filled, tool="PyMeshLab meshing_close_holes", holes=len(now.holes))
        climb("orient", orient(vertices, faces))
    if not now.valid:
        raise PandisError(
            f"the mesh is still not closed and manifold after {_names(rungs)}: {now.faults()}; "
            "mend it in a mesh editor"
        )
    if now.self_intersections:
        log(
            f"warning: {now.self_intersections} pairs of faces cross each other; distances near "
            "them are to surfaces inside the body"
        )
    record = {"before": before.attributes(), "after": now.attributes(), "rungs": rungs}
    return vertices, faces, record


def _names(rungs):
    return ", ".join(rung["rung"] for rung in rungs) or "no repair"


def clean(vertices, faces, tolerance=0.0):
    """Weld vertices, drop degenerate and duplicate faces and unreferenced vertices.

    Parameters
    ----------
    tolerance : float
        Vertices this close become one (the first of them); 0 welds equal ones only.

    Returns
    -------
    (vertices, faces) or None
        None if nothing changed. Kept vertices keep their bits and their order.
    """
    if tolerance:
        # not igl.remove_duplicate_vertices: that rounds to a lattice and parts close pairs
        pairs = cKDTree(vertices).query_pairs(tolerance, output_type="ndarray")
        representative = connected(pairs, len(vertices))
    else:
        _, first, index = np.unique(vertices + 0.0, axis=0, return_index=True, return_inverse=True)
        representative = first[index.reshape(-1)]
    welded = representative[faces]
    welded = welded[~repeats_a_vertex(welded)]
    welded = resolve_duplicates(welded)
    used, compact = np.unique(welded, return_inverse=True)
    if len(used) == len(vertices) and len(welded) == len(faces):
        return None
    return vertices[used], compact.reshape(-1, 3).astype(np.int64)


def resolve_duplicates(faces):
    """Keep one of each set of faces over the same three vertices; opposite pairs vanish."""
    _, index, counts = np.unique(
        np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    if (counts == 1).all():
        return faces
    # the parity of the vertex order is the side a face shows
    rolled = rotate_to_smallest(faces)
    side = np.where(rolled[:, 1] < rolled[:, 2], 1, -1)
    index = index.reshape(-1)
    balance = np.bincount(index, side)
    _, first_of = np.unique(np.stack([index, side]), axis=1, return_index=True)
    keep = np.zeros(len(faces), bool)
    keep[first_of] = True
    return faces[keep & (np.sign(balance)[index] == side)]


def orient(vertices, faces):
    """Make neighbours agree, then turn each closed component outward (cavities inward).

    Returns
    -------
    (vertices, faces) or None
        None if nothing changed.
    """
    turned, _ = igl.bfs_orient(np.ascontiguousarray(faces, np.int64))
    component, count = components(turned)
    turn = wrong_side(vertices, turned, component, count)[component]
    turned[turn] = turned[turn][:, ::-1]
    if np.array_equal(rotate_to_smallest(turned), rotate_to_smallest(faces)):
        return None
    return vertices, turned


def rotate_to_smallest(faces):
    """Let every face begin with its smallest index; the side it shows stays."""
    start = np.argmin(faces, axis=1)
    return np.take_along_axis(faces, (start[:, None] + [0, 1, 2]) % 3, axis=1)


def check_holes(now, options):
    """Raise PandisError if a hole is too large to be filled without asking."""
    for hole in now.holes:
        share = hole["length"] / now.diagonal
        if hole["edges"] > options["max_hole_edges"]:
            key, value = "mesh.max_hole_edges", hole["edges"]
        elif share > options["small_hole"]:
            key, value = "mesh.small_hole", f"{share + 5e-4:.3f}"
        else:
            continue
        raise PandisError(
            f"the mesh is open: {now.faults()}. A hole this large may be an open surface, which "
            f"has no inside. To close it all the same, set {key}: {value} for this mesh"
        )


def fill_holes(vertices, faces, now, options):
    """Fill all holes with faces over the vertices that are there.

    Raises
    ------
    PandisError
        The tool failed, or moved a vertex.
    """
    most = max(hole["edges"] for hole in now.holes)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "open.npz"
        np.savez(path, vertices=vertices, faces=faces)
        limits = {"seconds": options["reader_seconds"], "memory_gb": options["reader_memory_gb"]}
        try:
            filled = tools.call("close_holes", path, most + 1, **limits)
        except tools.ToolError as error:
            raise PandisError(f"filling holes failed: PyMeshLab {error}") from error
    if not np.array_equal(filled[0][: len(vertices)], vertices):
        raise PandisError("filling holes moved vertices of the mesh; fill them in a mesh editor")
    return filled


def deviation(before, after, seed, samples=100_000):
    """Measure how far two meshes are apart, on their faces and in both directions.

    Parameters
    ----------
    before, after : (vertices, faces)
    seed : int
    samples : int
        Points per direction, uniform by area.

    Returns
    -------
    dict
        max, p99 and mean distance from each mesh to the other, in mesh units.
    """
    if before[0] is after[0] and before[1] is after[1]:
        zero = {"max": 0.0, "p99": 0.0, "mean": 0.0}
        return {"to_result": zero, "to_source": dict(zero)}
    rng = np.random.default_rng(seed)
    result = {}
    for name, (v, f), (other_v, other_f) in (
        ("to_result", before, after),
        ("to_source", after, before),
    ):
        corners = v[f]
        area = np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
        )
        face = rng.choice(len(f), samples, p=area / area.sum())
        a, b = np.sqrt(rng.random(samples)), rng.random(samples)
        weights = np.stack([1 - a, a * (1 - b), a * b], axis=1)
        points = np.einsum("ij,ijk->ik", weights, corners[face])
        squared, _, _ = igl.point_mesh_squared_distance(points, other_v, other_f)
        distance = np.sqrt(squared)
        result[name] = {
            "max": float(distance.max()),
            "p99": float(np.percentile(distance, 99)),
            "mean": float(distance.mean()),
        }
    return result
