"""Measures each field's errors for the report's view, on a mesh small enough for a page."""

import igl
import numpy as np

from pandis.base.forces import penalty_force
from pandis.pipeline.geometry.sampling import PROBE_DEPTHS

#: Approximate number of faces of the mesh that is shown.
FACES = 16_000
#: Depths over which errors are averaged: the middles of four equal parts of the deep probes' range.
DEPTHS = PROBE_DEPTHS["deep"] * (np.arange(4) + 0.5) / 4


def coarsen(vertices, faces, count=FACES):
    """Return a mesh of about ``count`` faces, or the mesh itself if it has fewer.

    Edges are collapsed to their midpoints (libigl), which keeps closed meshes closed.
    """
    if len(faces) <= count:
        return vertices, faces
    coarse, faces, _, _ = igl.decimate(
        np.asfortranarray(vertices, np.float64), np.asfortranarray(faces, np.int32), count
    )
    return coarse, faces


def surface_errors(fields, engine, vertices, *, faces, progress):
    """Measure the force error of every field below the vertices of a coarse mesh.

    Parameters
    ----------
    fields : list of pandis.pipeline.kinds.field.Field
    engine : object
        The exact distance of a `pandis.pipeline.geometry.body.Body`.
    vertices, faces : ndarray
        The mesh before coarsening, unit frame.
    progress : pandis.base.progress.Progress

    Returns
    -------
    dict of str to ndarray
        ``view_vertices`` (V, 3) float32, on the surface, unit frame; ``view_faces`` (F, 3) int32;
        ``view_error_{field}`` (V,) float32: ‖F − F_exact‖ at k = 1, averaged over `DEPTHS`. Fields
        that require a path are omitted.
    """
    coarse, triangles = coarsen(vertices, faces)
    distance, outward = engine.distance_and_normal(coarse)
    foot = coarse - distance[:, None] * outward
    inward = -_vertex_normals(foot, triangles)
    points = (foot[:, None] + DEPTHS[:, None] * inward[:, None]).reshape(-1, 3)
    exact = penalty_force(*engine.distance_and_normal(points))
    arrays = {"view_vertices": foot.astype(np.float32), "view_faces": triangles.astype(np.int32)}
    report = progress("view", len(fields), "fields")
    for index, field in enumerate(fields):
        if not field.ordered:
            off = np.linalg.norm(penalty_force(*field.answer(points)) - exact, axis=1)
            mean = off.reshape(-1, len(DEPTHS)).mean(axis=1)
            arrays[f"view_error_{field.name}"] = mean.astype(np.float32)
        report.update(index + 1)
    return arrays


def _vertex_normals(vertices, faces):
    """Return area-weighted unit normals (V, 3) of vertices."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals, across = np.zeros_like(vertices), np.cross(b - a, c - a)
    for k in range(3):
        np.add.at(normals, faces[:, k], across)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
