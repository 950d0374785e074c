"""Training and probe points, with exact labels.

Points on the surface are stratified by area along a space-filling order of
the faces. All other strata start from such points. Every point can be made
again from the seed, its face, its barycentrics and its offset.
"""

import numpy as np

STRATA = ("surface", "offset", "penetration", "box", "held-out")
#: Depths below the surface of the two probe sets (unit frame).
PROBE_DEPTHS = {"shallow": 0.01, "deep": 0.04}


class Surface:
    """The surface of a mesh as something to draw points from.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), unit frame
    faces : ndarray, shape (F, 3)
    engine : object, optional
        If given, points are moved onto its zero level (for closed-form
        shapes, whose tessellation lies inside of them).
    """

    def __init__(self, vertices, faces, engine=None):
        corners = vertices[faces]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(cross, axis=1)
        self.corners = corners
        self.normals = cross / np.maximum(area, 1e-300)[:, None]
        self.order = np.argsort(_morton(corners.mean(axis=1)), kind="stable")
        cumulative = np.cumsum(area[self.order])
        self.share = cumulative / cumulative[-1]
        self.engine = engine

    def draw(self, count, rng):
        """Draw points stratified by area.

        Returns
        -------
        points, normals : ndarray, shape (count, 3)
        face : ndarray, shape (count,), int32
        barycentrics : ndarray, shape (count, 2), float32
            Weights of the face's second and third corner.
        """
        position = (np.arange(count) + rng.random(count)) / count
        rank = np.minimum(np.searchsorted(self.share, position, side="right"), len(self.order) - 1)
        face = self.order[rank]
        root, turn = np.sqrt(rng.random(count)), rng.random(count)
        weights = np.stack([root * (1 - turn), root * turn], axis=1).astype(np.float32)
        points, normals = self.at(face, weights)
        return points, normals, face.astype(np.int32), weights

    def at(self, face, barycentrics):
        """Return the points and outward normals at faces (n,) and barycentrics (n, 2)."""
        b = barycentrics.astype(np.float64)
        weights = np.concatenate([1 - b.sum(axis=1, keepdims=True), b], axis=1)
        points = np.einsum("ij,ijk->ik", weights, self.corners[face])
        if self.engine is None:
            return points, self.normals[face]
        for _ in range(2):
            distance, normal = self.engine.distance_and_normal(points)
            points = points - distance[:, None] * normal
        return points, normal


def open_surface(mesh, engine):
    """Return the `Surface` of a mesh artifact; closed forms are sampled exactly."""
    frame = engine.frame if mesh.attributes.get("shape") else None
    if frame is not None:
        return Surface(frame.to_unit(mesh.arrays["vertices"]), mesh.arrays["faces"], engine)
    return Surface(engine.vertices, engine.faces)


def probes(surface, engine, count, seed):
    """Return the probe sets of the paper notes' accuracy bars.

    Area-uniform surface points moved inward along the normal by a depth
    uniform in [0, 0.01] (``shallow``) or [0, 0.04] (``deep``).

    Returns
    -------
    dict of str to (points, distance, normal)
        Exact answers, unit frame, float64.
    """
    sets = {}
    for index, (name, deepest) in enumerate(PROBE_DEPTHS.items()):
        rng = np.random.default_rng([seed, index])
        points, normals, _, _ = surface.draw(count, rng)
        points = points - rng.uniform(0, deepest, count)[:, None] * normals
        sets[name] = (points, *engine.distance_and_normal(points))
    return sets


def sample(surface, engine, options, progress):
    """Draw and label all strata.

    Parameters
    ----------
    surface : Surface
    engine : object
        From `pandis.distance.open_distance`.
    options : dict
        See `pandis.config.SampleOptions`; and ``seed``.
    progress : callable
        Makes a `pandis.stage.Progress`.

    Returns
    -------
    arrays, attributes : dict
        As stored in ``samples.zarr.zip``: points, distance and normal are
        float32 in the unit frame; labels belong to the points as rounded.
    """
    parts, ranges, start = [], {}, 0
    for index, stratum in enumerate(STRATA):
        part = _stratum(stratum, surface, options, np.random.default_rng([options["seed"], index]))
        parts.append(part)
        ranges[stratum] = [start, start + len(part[0])]
        start = ranges[stratum][1]
    points, offset, face, barycentrics = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    points = points.astype(np.float32)
    distance, normal = engine.distance_and_normal(points, progress("labels", len(points)))
    # points drawn on the surface are on it by construction, but for their rounding
    low, high = ranges["surface"]
    distance[low:high] = 0.0
    normal[low:high] = surface.at(face[low:high], barycentrics[low:high])[1]
    stratum = np.repeat(np.arange(len(STRATA), dtype=np.uint8), [len(part[0]) for part in parts])
    arrays = {
        "points": points,
        "distance": distance.astype(np.float32),
        "normal": normal.astype(np.float32),
        "stratum": stratum,
        "face": face,
        "barycentrics": barycentrics,
        "offset": offset.astype(np.float32),
    }
    return arrays, {"strata": ranges, "seed": options["seed"]}


def _stratum(stratum, surface, options, rng):
    """Return points, offsets along the normal, faces and barycentrics of one stratum."""
    if stratum == "box":
        count = options["box"]
        points = rng.uniform(-1, 1, (count, 3))
        nowhere = np.full(count, -1, np.int32), np.zeros((count, 2), np.float32)
        return points, np.zeros(count), *nowhere
    if stratum == "surface":
        count = options["surface"]
        offset = np.zeros(count)
    elif stratum == "offset":
        count = options["offsets"]
        scales = np.array(options["scales"])
        offset = rng.normal(0, scales[np.arange(count) % len(scales)])
    elif stratum == "penetration":
        count = options["penetration"]
        offset = -rng.uniform(0, options["depth"], count)
    else:
        count = options["held_out"]
        deepest = np.array(list(PROBE_DEPTHS.values()))[np.arange(count) % len(PROBE_DEPTHS)]
        offset = -rng.uniform(0, deepest)
    points, normals, face, barycentrics = surface.draw(count, rng)
    return points + offset[:, None] * normals, offset, face, barycentrics


def _morton(points):
    """Return the Morton code of points, 21 bits per axis, for a spatial order."""
    low, high = points.min(axis=0), points.max(axis=0)
    cells = ((points - low) / np.maximum(high - low, 1e-300) * (2**21 - 1)).astype(np.uint64)
    code = np.zeros(len(points), np.uint64)
    for axis in range(3):
        bits = cells[:, axis]
        for shift, mask in (
            (32, 0x1F00000000FFFF),
            (16, 0x1F0000FF0000FF),
            (8, 0x100F00F00F00F00F),
            (4, 0x10C30C30C30C30C3),
            (2, 0x1249249249249249),
        ):
            bits = (bits | (bits << np.uint64(shift))) & np.uint64(mask)
        code |= bits << np.uint64(axis)
    return code
