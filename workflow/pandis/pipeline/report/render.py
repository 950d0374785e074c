"""Renders a mesh without a graphics library, from dense surface points and a depth buffer."""

import struct
import zlib

import numpy as np

from pandis.pipeline.geometry.sampling import Surface

#: Default direction to the eye: the front (+z), a little toward +x and +y (up).
VIEW = (0.45, 0.35, 1.0)
#: Upward direction.
_UP = (0.0, 1.0, 0.0)
#: Supersampling: pixels drawn along each side of an output pixel.
_FINER = 2


def to_png(image):
    """Return an image (height, width, 4), uint8, as the bytes of a PNG file."""
    height, width, _ = image.shape
    rows = np.concatenate([np.zeros((height, 1), np.uint8), image.reshape(height, -1)], axis=1)
    parts = [(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)),
             (b"IDAT", zlib.compress(rows.tobytes(), 9)), (b"IEND", b"")]  # fmt: skip
    chunks = [struct.pack(">I", len(data)) + name + data
              + struct.pack(">I", zlib.crc32(name + data)) for name, data in parts]  # fmt: skip
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def render(vertices, faces, size=560, *, view=VIEW, points=None, colours=None):
    """Draw a shaded mesh.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), unit frame
    faces : ndarray, shape (F, 3)
    size : int
        Pixels per side.
    view : sequence of float
        Direction from the mesh to the eye; up is +y.
    points : ndarray, shape (n, 3), optional
        A path to draw over the surface, where it is not hidden.
    colours : ndarray, shape (F, 3), optional
        Red, green and blue of each face, 0 to 255, before shading.

    Returns
    -------
    ndarray, shape (size, size, 4), uint8
        RGBA; transparent where there is no mesh.
    """
    axes = camera(view, _UP)
    fine = _draw(vertices, faces, _FINER * size, axes=axes, points=points, colours=colours)
    # a pixel is the mean of finer ones, weighted by coverage, so that edges are smooth
    parts = fine.reshape(size, _FINER, size, _FINER, 4).astype(float)
    cover = parts[..., 3:].sum(axis=(1, 3))
    colour = (parts[..., :3] * parts[..., 3:]).sum(axis=(1, 3)) / np.maximum(cover, 1)
    image = np.concatenate([colour, cover / _FINER**2], axis=2)
    return np.rint(image).astype(np.uint8) & 0xFC  # fewer tones make files smaller


def _draw(vertices, faces, size, *, axes, points, colours):
    """Draw a mesh without smoothing: see `render`."""
    whole = Surface(vertices, faces)
    # the solid is closed, so faces that point away are hidden
    front = np.flatnonzero(whole.normals @ axes[2] > 0)
    surface = Surface(vertices, np.asarray(faces)[front])
    count = round(10 * size * size * surface.areas.sum() / whole.areas.sum())
    position, normal, face, _ = surface.draw(count, np.random.default_rng(0))
    face = front[face]
    row, column, depth = project(position, axes, size)
    # from far to near, so that the nearest point in a pixel is written last
    order = np.argsort(depth, kind="stable")
    row, column = row[order], column[order]
    image = np.zeros((size, size, 4), np.uint8)
    buffer = np.full((size, size), -np.inf)
    n = (normal @ axes.T)[order]
    light = np.clip(n @ _unit([-0.35, 0.55, 0.75]), 0, 1) * 0.75 + 0.25 * (0.5 + 0.5 * n[:, 1])
    base = np.array([176, 190, 214]) if colours is None else colours[face[order]]
    colour = np.clip(light[:, None] * base + 26, 0, 255)
    image[row, column, :3] = colour.astype(np.uint8)
    image[row, column, 3] = 255
    buffer[row, column] = depth[order]
    _close_pinholes(image, buffer)
    if points is not None:
        _draw_path(image, buffer, points, axes=axes, size=size)
    return image


def _close_pinholes(image, buffer):
    """Colour each empty pixel that has at least three covered neighbours like one of them."""
    covered = image[..., 3] > 0
    steps = ((0, 1), (0, -1), (1, 0), (-1, 0))
    around = sum(np.roll(covered, step, (0, 1)).astype(int) for step in steps)
    row, column = np.nonzero(~covered & (around >= 3))
    for down, right in steps:
        beside = (row + down) % len(image), (column + right) % len(image)
        take = covered[beside]
        for layer in (image, buffer):
            layer[row[take], column[take]] = layer[beside][take]


def camera(view, up):
    """Return the camera's axes as rows: right, up, toward the eye."""
    toward = _unit(view)
    right = _unit(np.cross(up, toward))
    return np.stack([right, np.cross(toward, right), toward])


def project(points, axes, size):
    """Return row, column and depth (toward the eye) of points in orthographic projection."""
    x, y, depth = (points @ axes.T).T
    half = size / 2
    column = np.clip(half + x * half * 0.78, 0, size - 1).astype(np.int64)
    row = np.clip(half - y * half * 0.78, 0, size - 1).astype(np.int64)
    return row, column, depth


def _draw_path(image, buffer, points, *, axes, size):
    steps, way = np.linspace(0, 1, 8, endpoint=False), np.diff(points, axis=0)
    length = np.linalg.norm(way, axis=1)
    whole = length <= 8 * np.median(length)  # a longer step jumps to where the path starts again
    dense = (points[:-1][whole, None] + steps[:, None] * way[whole, None]).reshape(-1, 3)
    row, column, depth = project(dense, axes, size)
    # the path runs below the surface: allow for the depth of penetration
    seen = depth > buffer[row, column] - 0.06
    for dr in range(-_FINER, _FINER + 1):
        for dc in range(-_FINER, _FINER + 1):
            r = np.clip(row[seen] + dr, 0, size - 1)
            c = np.clip(column[seen] + dc, 0, size - 1)
            image[r, c] = (200, 40, 40, 255)


def _unit(vector):
    return np.asarray(vector, float) / np.linalg.norm(vector)
