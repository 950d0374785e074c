"""Wrong signs of libraries, judged by exact winding numbers; write docs/figures/signs.csv.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/signs.py

Each library gets the same points of each mesh: a third uniform in the box grown by a tenth, a third
moved from the surface by noise of 0.01 and a third by noise of 0.001 of the longest side. A point
counts if it is at least 1e-6 of the side from the surface. A library that is not installed, or that
fails, is left out with the reason. On open meshes there is no truth, and the judge is whether the
winding number exceeds a half. `hunyuan` is our re-creation of the recipe that many copy: the level
0.015 of an unsigned distance on a grid of 256, labelled with the sign of that double shell.
"""

import importlib
import os
import sys
from functools import partial
from importlib import metadata
from pathlib import Path

import igl
import numpy as np
import trimesh
from common import write

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.distance import MeshDistance

POINTS = 12_000
AWAY = 1e-6
COLUMNS = ("library", "version", "mesh", "points", "wrong", "error")
#: Thickness of the double shell of the recipe, and the nodes of its grid.
LEVEL, GRID = 0.015, 256


# --- meshes ------------------------------------------------------------------------------------


def box(size, place=(0, 0, 0)):
    """Return vertices and faces of a box."""
    mesh = trimesh.creation.box(size)
    return np.array(mesh.vertices) + place, np.array(mesh.faces)


def joined(*parts):
    """Return the meshes side by side."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts[:-1])])
    faces = [faces + start for (_, faces), start in zip(parts, starts, strict=True)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)


def turned(mesh):
    """Return a mesh inside out."""
    return mesh[0], mesh[1][:, ::-1]


def needle():
    """Return a tetrahedron with an edge of a thousandth of its height."""
    vertices = np.array([[0, 0, 0], [1e-3, 0, 0], [0, 1, 0], [0.4, 0.3, 1.0]])
    return vertices, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def acute():
    """Return a tetrahedron with dihedral angles of a few degrees, where pseudonormals matter."""
    vertices = np.array([[0, 0, 0], [1, 0, 0.02], [0.5, 1, 0.01], [0.5, 0.3, 0.05]])
    return vertices, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def ball(subdivisions=3):
    """Return a sphere of triangles."""
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    return np.array(mesh.vertices), np.array(mesh.faces)


def slivers():
    """Return a box whose sides are fans of needles."""
    mesh = trimesh.creation.cylinder(radius=1, height=0.2, sections=512)
    return np.array(mesh.vertices), np.array(mesh.faces)


def cut(mesh):
    """Return a mesh without its uppermost faces."""
    vertices, faces = mesh
    height = vertices[faces][:, :, 2].mean(axis=1)
    return vertices, faces[height < np.quantile(height, 0.85)]


def meshes():
    """Return vertices and faces by name: generated ones, then shared ones."""
    shapes = {
        "ball": ball(),
        "acute tetrahedron": acute(),
        "needle tetrahedron": needle(),
        "slivers": slivers(),
        "cavity": joined(ball(), turned(box((0.6, 0.6, 0.6)))),
        "nested three": joined(box((3, 3, 3)), turned(ball()), box((0.5, 0.5, 0.5))),
        "touching boxes": joined(box((1, 1, 1)), box((1, 1, 1), (1, 1, 0))),
        "thin plate": box((1, 1, 1e-4)),
        "far from origin": (ball()[0] + 1e5, ball()[1]),
        "open ball": cut(ball()),
    }
    folder = Path(os.environ["PANDIS_MESHES"])
    for name in ("fandisk", "fertility", "sword", "menger", "tooth"):
        (path,) = folder.glob(f"watertight/{name}*")
        mesh = trimesh.load(path, force="mesh", process=False)
        shapes[name] = np.array(mesh.vertices), np.array(mesh.faces)
    return shapes


# --- libraries ----------------------------------------------------------------------------------


def of_igl(kind, vertices, faces, points):
    """Libigl's signed distance."""
    return igl.signed_distance(points, vertices, faces, sign_type=kind)[0]


def of_trimesh(vertices, faces, points):
    """Rays of trimesh."""
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    # more rays at once take gigabytes where many faces overlap
    inside = [mesh.contains(part) for part in np.array_split(points, len(points) // 200 + 1)]
    return np.where(np.concatenate(inside), -1.0, 1.0)


def of_open3d(rays, vertices, faces, points):
    """Open3D's RaycastingScene."""
    import open3d

    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(vertices.astype(np.float32), faces.astype(np.uint32))
    return scene.compute_signed_distance(points.astype(np.float32), nsamples=rays).numpy()


def of_pcu(vertices, faces, points):
    """Distances of point-cloud-utils, without its repair."""
    import point_cloud_utils

    arrays = (points, vertices, faces.astype(np.int64))
    return point_cloud_utils.signed_distance_to_mesh(*map(np.ascontiguousarray, arrays))[0]


def of_warp(method, vertices, faces, points):
    """Queries of Warp, on the CPU."""
    import warp as wp

    kernels = importlib.import_module("signs_warp")
    mesh = wp.Mesh(
        points=wp.array(vertices.astype(np.float32), dtype=wp.vec3, device="cpu"),
        indices=wp.array(faces.astype(np.int32).reshape(-1), dtype=int, device="cpu"),
        support_winding_number=method == "winding",
    )
    queries = wp.array(points.astype(np.float32), dtype=wp.vec3, device="cpu")
    signs = wp.zeros(len(points), dtype=float, device="cpu")
    kernel = getattr(kernels, method)
    wp.launch(kernel, len(points), [mesh.id, queries, signs], device="cpu")
    return signs.numpy()


def fcpw_scene(vertices, faces, *, vectorize=False):
    """Build the tree of a mesh in fcpw."""
    import fcpw

    scene = fcpw.scene_3D()
    scene.set_object_count(1)
    scene.set_object_vertices(np.ascontiguousarray(vertices, np.float32), 0)
    scene.set_object_triangles(np.ascontiguousarray(faces, np.int32), 0)
    scene.build(fcpw.aggregate_type.bvh_surface_area, vectorize)
    return scene


def of_fcpw(vertices, faces, points):
    """fcpw's test of containment; its Python package has no signed distance without normals."""
    scene = fcpw_scene(vertices, faces)
    inside = [scene.contains(point) for point in points.astype(np.float32)]
    return np.where(inside, -1.0, 1.0)


def of_mesh2sdf(vertices, faces, points):
    """mesh2sdf on a grid of 128, with its repair, whose thickness is taken off again."""
    import mesh2sdf
    from scipy.interpolate import RegularGridInterpolator

    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle, half = (low + high) / 2, (high - low).max() / 2 / 0.8
    grid = mesh2sdf.compute((vertices - middle) / half, faces, 128, fix=True, level=2 / 128)
    axes = [np.linspace(-1, 1 - 2 / 128, 128)] * 3
    at = RegularGridInterpolator(axes, grid, bounds_error=False, fill_value=1.0)
    return at((points - middle) / half) + 2 / 128


def of_hunyuan(vertices, faces, points):
    """The copied recipe: the level set of an unsigned distance on a grid, labelled by libigl."""
    from skimage.measure import marching_cubes

    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle, half = (low + high) / 2, (high - low).max() / 2 / 0.98
    unit = (vertices - middle) / half
    axis = np.linspace(-1.05, 1.05, GRID)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    distance = np.concatenate([
        np.abs(MeshDistance(unit, faces).distance_and_normal(part, check=False)[0])
        for part in np.array_split(grid, 64)
    ]).reshape(GRID, GRID, GRID)  # fmt: skip
    shell, corners, _, _ = marching_cubes(distance, LEVEL)
    shell = axis[0] + shell * (axis[1] - axis[0])
    kind = igl.SIGNED_DISTANCE_TYPE_FAST_WINDING_NUMBER
    return of_igl(kind, shell, corners.astype(np.int64), (points - middle) / half)


def of_double(vertices, faces, points):
    """Exact distances of pandis."""
    body = Body(vertices, faces)
    return body.distance.distance_and_normal(body.frame.to_unit(points))[0]


def of_compact(vertices, faces, points):
    """The compact field of pandis, whose mesh is rounded to a lattice."""
    import pandis

    field = pandis.field((vertices, faces), kind="compact-16")
    return field.query(points).distance


MODES = {
    "pseudonormal": igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL,
    "winding number": igl.SIGNED_DISTANCE_TYPE_WINDING_NUMBER,
    "fast winding number": igl.SIGNED_DISTANCE_TYPE_FAST_WINDING_NUMBER,
}
LIBRARIES = {
    **{f"libigl, {name}": ("libigl", partial(of_igl, kind)) for name, kind in MODES.items()},
    **{f"Open3D, {rays} rays": ("open3d", partial(of_open3d, rays)) for rays in (1, 3, 11)},
    "trimesh": ("trimesh", of_trimesh),
    "point-cloud-utils": ("point-cloud-utils", of_pcu),
    **{f"Warp, {how}": ("warp-lang", partial(of_warp, how)) for how in ("normal", "winding",
                                                                       "parity")},
    "fcpw": ("fcpw", of_fcpw),
    "mesh2sdf": ("mesh2sdf", of_mesh2sdf),
    "copied recipe": ("scikit-image", of_hunyuan),
    "pandis, exact": ("pandis-fields", of_double),
    "pandis, compact-16": ("pandis-fields", of_compact),
}  # fmt: skip


# --- the comparison -----------------------------------------------------------------------------


def drawn(vertices, faces):
    """Return points and whether they are inside, by exact winding numbers."""
    rng = np.random.default_rng(0)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    side = (high - low).max()
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    third = POINTS // 3
    base = [np.array(trimesh.sample.sample_surface(mesh, third, seed=k)[0]) for k in (1, 2)]
    points = np.concatenate([
        rng.uniform(low - 0.05 * side, high + 0.05 * side, (third, 3)),
        *(b + rng.normal(0, s * side, b.shape) for b, s in zip(base, (1e-2, 1e-3), strict=True)),
    ])  # fmt: skip
    # all libraries get the same points, although some compute in single precision
    points = points.astype(np.float32).astype(np.float64)
    square = igl.point_mesh_squared_distance(points, vertices, faces.astype(np.int64))[0]
    points = points[np.sqrt(square) > AWAY * side]
    return points, igl.winding_number(vertices, faces.astype(np.int64), points) > 0.5


def version(package):
    """Return the version of an installed package; empty if it is not."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ""


def main():
    """Count, print and write the table."""
    rows = []
    for name, (vertices, faces) in meshes().items():
        points, inside = drawn(vertices, faces)
        for library, (package, ask) in LIBRARIES.items():
            row = {"library": library, "version": version(package), "mesh": name}
            row |= {"points": len(points), "wrong": "", "error": ""}
            try:
                row["wrong"] = int(((ask(vertices, faces, points) < 0) != inside).sum())
            except Exception as error:
                row["error"] = " ".join(f"{type(error).__name__}: {error}".split())[:80]
            rows.append(row)
            print(*row.values(), sep=" | ", flush=True)
    write("signs", COLUMNS, rows)


if __name__ == "__main__":
    sys.exit(main())
