"""Renders a mesh without a graphics library, by scan lines and a depth buffer."""

import struct
import zlib

import numpy as np

#: Default direction to the eye: the front (+z), a little toward +x and +y (up).
VIEW = (0.45, 0.35, 1.0)
#: Upward direction.
_UP = (0.0, 1.0, 0.0)
#: Supersampling: pixels drawn along each side of an output pixel.
_FINER = 2
#: Spans of pixels that are drawn together, which limits the memory.
_TOGETHER = 500_000


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
    corners = project(vertices, axes, size)[faces]
    seen, buffer = _nearest_faces(corners, size)
    row, column = np.nonzero(seen >= 0)
    face = seen[row, column]
    sides = vertices[faces[face, 1:]] - vertices[faces[face, :1]]
    n = np.cross(sides[:, 0], sides[:, 1])
    n = n / np.linalg.norm(n, axis=1, keepdims=True) @ axes.T
    light = np.clip(n @ _unit([-0.35, 0.55, 0.75]), 0, 1) * 0.75 + 0.25 * (0.5 + 0.5 * n[:, 1])
    base = np.array([176, 190, 214]) if colours is None else colours[face]
    image = np.zeros((size, size, 4), np.uint8)
    image[row, column, :3] = np.clip(light[:, None] * base + 26, 0, 255).astype(np.uint8)
    image[row, column, 3] = 255
    if points is not None:
        _draw_path(image, buffer, points, axes=axes, size=size)
    return image


def _nearest_faces(corners, size):
    """Return the nearest front-facing triangle behind the middle of each pixel, and its depth.

    Parameters
    ----------
    corners : ndarray, shape (F, 3, 3)
        Column, row and depth of each triangle's corners.
    size : int

    Returns
    -------
    seen : ndarray, shape (size, size), int64
        -1 where there is none.
    buffer : ndarray, shape (size, size)
    """
    seen, buffer = np.full(size * size, -1), np.full(size * size, -np.inf)
    u, v = (corners[:, 1:] - corners[:, :1]).transpose(1, 2, 0)
    area = u[1] * v[0] - u[0] * v[1]  # rows count downwards
    # the solid is closed, so faces that point away are hidden
    front = np.flatnonzero(area > 0)
    slope = np.stack([v[2] * u[1] - u[2] * v[1], u[2] * v[0] - v[2] * u[0]])[:, front] / area[front]
    corners = corners[front]
    lowest, highest = corners[..., 2].min(axis=1), corners[..., 2].max(axis=1)
    first, last = (_pixel(f(axis=1), size) for f in (corners[..., 1].min, corners[..., 1].max))
    work = np.cumsum(last - first + area[front] / 2) // _TOGETHER
    for part in np.split(np.arange(len(front)), np.flatnonzero(np.diff(work)) + 1):
        face, row = _ranges(part, first[part], last[part])
        span, column = _ranges(np.arange(len(face)), *_span(corners[face], row, size))
        face, row = face[span], row[span]
        x, y, z = corners[face, 0].T
        depth = z + slope[0, face] * (column + 0.5 - x) + slope[1, face] * (row + 0.5 - y)
        # rounding must not tear a face that is seen from its edge
        depth = np.clip(depth, lowest[face], highest[face])
        pixel = row * size + column
        np.maximum.at(buffer, pixel, depth)
        nearest = depth == buffer[pixel]
        seen[pixel[nearest]] = front[face[nearest]]
    return seen.reshape(size, size), buffer.reshape(size, size)


def _span(corners, row, size):
    """Return the first column of each triangle in a row, and the one after its last."""
    left, right = np.full(len(row), np.inf), np.full(len(row), -np.inf)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        upwards = corners[:, a, 1] > corners[:, b, 1]
        low = np.where(upwards[:, None], corners[:, b], corners[:, a])
        high = np.where(upwards[:, None], corners[:, a], corners[:, b])
        way, down = (high - low).T[:2], row + 0.5 - low[:, 1]
        with np.errstate(divide="ignore", invalid="ignore"):  # an edge along the row
            x = low[:, 0] + down * (way[0] / way[1])
        crossed = (down >= 0) & (down < way[1])
        left, right = (np.where(crossed, f(x, end), end)
                       for f, end in ((np.minimum, left), (np.maximum, right)))  # fmt: skip
    return _pixel(left, size), _pixel(right, size)


def _pixel(place, size):
    """Return the first pixel whose middle is not before a place."""
    return np.ceil(np.clip(place - 0.5, 0, size)).astype(np.int64)


def _ranges(items, start, stop):
    """Return each item once for every whole number from its start to its stop, and the numbers."""
    counts = np.maximum(stop - start, 0)
    behind = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.repeat(items, counts), np.repeat(start, counts) + behind


def camera(view, up):
    """Return the camera's axes as rows: right, up, toward the eye."""
    toward = _unit(view)
    right = _unit(np.cross(up, toward))
    return np.stack([right, np.cross(toward, right), toward])


def project(points, axes, size):
    """Return column, row and depth (toward the eye) of points in orthographic projection."""
    x, y, depth = (points @ axes.T).T
    half = size / 2
    return np.stack([half + 0.78 * half * x, half - 0.78 * half * y, depth], axis=-1)


def _draw_path(image, buffer, points, *, axes, size):
    steps, way = np.linspace(0, 1, 8, endpoint=False), np.diff(points, axis=0)
    length = np.linalg.norm(way, axis=1)
    whole = length <= 8 * np.median(length)  # a longer step jumps to where the path starts again
    dense = (points[:-1][whole, None] + steps[:, None] * way[whole, None]).reshape(-1, 3)
    column, row, depth = project(dense, axes, size).T
    row, column = (np.clip(at, 0, size - 1).astype(np.int64) for at in (row, column))
    # the path runs below the surface: allow for the depth of penetration
    seen = depth > buffer[row, column] - 0.06
    for dr in range(-_FINER, _FINER + 1):
        for dc in range(-_FINER, _FINER + 1):
            r = np.clip(row[seen] + dr, 0, size - 1)
            c = np.clip(column[seen] + dc, 0, size - 1)
            image[r, c] = (200, 40, 40, 255)


def _unit(vector):
    return np.asarray(vector, float) / np.linalg.norm(vector)
