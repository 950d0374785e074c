"""Pictures of meshes: each pixel against every triangle."""

import numpy as np
import pytest

from pandis.pipeline.geometry.shapes import find_shape
from pandis.pipeline.report.render import _nearest_faces, render
from support import box_mesh


def test_each_pixel_has_the_colour_of_the_nearest_face_behind_its_middle():
    rng, size = np.random.default_rng(0), 40
    corners = rng.uniform(-10, 50, (60, 1, 3)) + rng.uniform(-12, 12, (60, 3, 3))
    corners[:20, :, 1] = corners[:20, :1, 1] + [0, 1e-3, 15]  # slivers, and edges along rows
    corners[20:30] = np.round(corners[20:30])
    seen, buffer = _nearest_faces(corners, size)
    column, row = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
    depth = np.full((len(corners), size, size), -np.inf)
    doubtful = np.zeros((size, size), bool)  # an edge runs through the middle
    for face, (a, b, c) in enumerate(corners):
        u, v, x, y = b - a, c - a, column - a[0], row - a[1]
        area = u[1] * v[0] - u[0] * v[1]
        s, t = (y * v[0] - x * v[1]) / area, (u[1] * x - u[0] * y) / area
        share = np.minimum(np.minimum(s, t), 1 - s - t)
        doubtful |= (abs(share) < 1e-9) & (area > 0)
        inside = (share > 0) & (area > 0)
        depth[face][inside] = (a[2] + s * u[2] + t * v[2])[inside]
    assert doubtful.mean() < 0.05
    certain = ~doubtful
    nearest = np.where(np.isfinite(depth.max(axis=0)), depth.argmax(axis=0), -1)
    assert np.array_equal(seen[certain], nearest[certain])
    assert np.allclose(buffer[certain], depth.max(axis=0)[certain])
    assert (seen < 0).sum() > 50
    assert len(np.unique(seen)) > 15


def test_no_pixel_is_lost_between_faces():
    vertices, faces = find_shape("torus").tessellation()
    for size in (60, 61):
        image = render(vertices / 1.5, faces, size)
        assert (image[..., 3] == 252).sum() > 0.2 * size**2
        inner = image[..., 3] > 0
        holes = ~inner & np.roll(inner, 1, 0) & np.roll(inner, -1, 0)
        holes &= np.roll(inner, 1, 1) & np.roll(inner, -1, 1)
        assert not holes.any()


def test_render_shows_the_mesh_where_it_is():
    vertices, faces = box_mesh()
    image = render(vertices * 0.5, faces, size=120, view=(0, 0, 1))
    assert image.shape == (120, 120, 4)
    rows, columns = np.nonzero(image[..., 3])
    width, height = np.ptp(columns) + 1, np.ptp(rows) + 1
    assert width / height == pytest.approx(1 / 0.7, rel=0.05)
    assert width == pytest.approx(120 * 0.78 / 2, abs=2)
    assert image[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1, 3].all()


def test_render_hides_what_lies_behind():
    vertices, faces = box_mesh()
    path = np.array([[-0.4, 0, 0.0], [0.4, 0, 0.0]])
    red = (200, 40, 40)
    for z, seen in ((0.26, True), (-0.26, False)):
        image = render(vertices * 0.5, faces, size=120, view=(0, 0, 1), points=path + [0, 0, z])
        assert (image[..., :3] == red).all(axis=2).any() == seen
