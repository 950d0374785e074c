"""Builds the compact mesh of a body, and computes bounds on its errors."""

import numpy as np

from pandis.base.errors import PandisError
from pandis.engine.packing import (
    BLOCK_BYTES,
    BLOCK_FACES,
    distance_and_clear,
    pack_mesh,
)
from pandis.engine.packing.unpacking import unpack
from pandis.pipeline.geometry.distance import MeshDistance
from pandis.pipeline.geometry.hausdorff import farthest
from pandis.pipeline.kinds.compact.lattice import snap, step_of, to_unit
from pandis.pipeline.kinds.compact.record import CompactRecord
from pandis.pipeline.kinds.compact.sides import find_sides
from pandis.pipeline.kinds.limits import least_limit, near_surface

#: A query visits at most this many blocks and groups of eight faces, which takes about a tenth of a
#: tick. The limit is raised if half of it would cut a query next to the surface.
#: tests/benchmarks/compact.py counts the cut queries on scans.
MOST = 704
#: Points at which inside and outside are compared with the body: half in the box, half near the
#: surface.
SIDES = 1_000_000


def build_compact(body, bits, seed, *, log):
    """Return the arrays and record of a body's compact mesh, after checking inside and outside.

    Parameters
    ----------
    body : pandis.pipeline.geometry.body.Body
        A closed form is replaced by its tessellation.
    bits : int
        Bits per coordinate.
    seed : int
        Seed of the points at which sides are compared.
    log : pandis.base.progress.Log

    Returns
    -------
    arrays : dict of str to ndarray
    record : pandis.pipeline.kinds.compact.record.CompactRecord

    Raises
    ------
    PandisError
        Some points are on the wrong side, although the surface cannot have moved past them.
    """
    arrays, record = pack_body(body, bits)
    log(describe(arrays, record))
    record = limit_queries(arrays, record)
    compare_sides(body, arrays, record, seed=seed)
    return arrays, record


def pack_body(body, bits, surface=None):
    """Pack a body's mesh, or a simpler substitute, on a lattice; sides are not compared.

    Parameters
    ----------
    body : pandis.pipeline.geometry.body.Body
    bits : int
    surface : tuple of ndarray, optional
        Vertices (V, 3) in the unit frame and faces (F, 3) of a closed surface near the body's. The
        record's deviation excludes the distance between the two surfaces: see `bound_deviation`.

    Returns
    -------
    arrays, record
        As returned by `build_compact`.

    Raises
    ------
    PandisError
        No face is left on a lattice of so few bits.
    """
    vertices, faces = surface or (body.corners, body.faces)
    snapped = snap(vertices, faces, bits)
    sides = find_sides(snapped.vertices, snapped.faces)
    packed = pack_mesh(snapped.vertices, snapped.faces, sides)
    places = to_unit(snapped.vertices, bits)
    record = CompactRecord(
        bits=bits,
        faces=len(snapped.faces),
        faces_before=len(body.faces),
        vertices=len(snapped.vertices),
        deviation=snapped.deviation,
        rounding=_rounding(packed, snapped, bits),
        turned=snapped.turned,
        most=MOST,
        reach=float(np.abs(places).max()),
        low=tuple(places.min(axis=0)),
        high=tuple(places.max(axis=0)),
    )
    return packed._asdict(), record


def bound_deviation(body, arrays, record):
    """Return the record with a bound on the compact mesh's deviation from the body's mesh."""
    if record.faces == record.faces_before:
        return record
    vertices, faces = unpack(arrays)
    mesh, vertices = _mesh_distance(body), to_unit(vertices, record.bits)
    there = farthest(vertices, faces, mesh)
    back = farthest(mesh.vertices, mesh.faces, MeshDistance(vertices, faces))
    return record.model_copy(update={"deviation": max(there, back)})


def limit_queries(arrays, record):
    """Return the record with a limit at which no query next to the surface is cut.

    See `pandis.pipeline.kinds.limits`.
    """
    vertices, faces = unpack(arrays)

    def query(points, most):
        return distance_and_clear(arrays, record.bits, points, most=most)

    most = least_limit(record.most, to_unit(vertices, record.bits), faces, query=query)
    return record.model_copy(update={"most": most})


def _mesh_distance(body):
    """Return the exact distance to a body's mesh; for a closed form, to its tessellation."""
    return MeshDistance(body.corners, body.faces) if body.shape else body.distance


def size_of(arrays):
    """Return the size of a packed mesh in bytes, in the form that ``pandis.h`` queries."""
    return sum(part.nbytes for part in arrays.values())


def describe(arrays, record):
    """Return a summary of a compact mesh as text."""
    return (
        f"{record.bits} bits: {record.faces:,} of {record.faces_before:,} faces in "
        f"{size_of(arrays):,} bytes; unsigned distances are within "
        f"{record.deviation:.2g} of the mesh's (unit frame)"
    )


def find_originals(body, arrays, record):
    """Return the face of a body's mesh that corresponds to each face of a compact mesh.

    It is the face nearest to a point just outside the compact face's centroid. On a thin wall this
    avoids the faces of the other side.

    Parameters
    ----------
    body : pandis.pipeline.geometry.body.Body
    arrays, record
        As returned by `build_compact`.

    Returns
    -------
    ndarray, shape (blocks, 64), int32
        Face indices by block and place in the block; -1 where a block has fewer faces.
    """
    vertices, faces = unpack(arrays)
    corners = to_unit(vertices, record.bits)[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    beside = corners.mean(axis=1) + (record.deviation + record.rounding) * normal
    nearest = _mesh_distance(body).label(beside, ties=False, check=False).face
    counts = (arrays["blocks"].view(np.uint32).reshape(-1, BLOCK_BYTES // 4)[:, 1] & 63) + 1
    originals = np.full((len(counts), BLOCK_FACES), -1, np.int32)
    originals[np.arange(BLOCK_FACES) < counts[:, None]] = nearest
    return originals


def _rounding(packed, snapped, bits):
    """Bound the amount by which choosing a wrong face makes a distance too large (unit frame).

    The bound holds in the box [-1, 1]³.

    Faces are compared in single precision, relative to their block. A point is off by half a unit
    in the last place of its coordinates, the closest point on an edge by a little more. Inside a
    triangle the error grows as the sine of its corner angle falls, up to half the triangle's
    height: its edges prevent larger errors.
    """
    unit = 2.0**-24
    counts = packed.blocks.view(np.uint32).reshape(-1, 4)[:, 1]
    extent = max(float(2 ** int((counts >> (12 + 5 * k) & 31).max())) for k in range(3))
    corners = snapped.vertices.astype(np.float64)[snapped.faces]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area, longest = np.linalg.norm(np.cross(u, v), axis=1), sides.max(axis=1)
    sine = area / (np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1))
    inside = np.minimum(area / longest / 2, 24 * unit * longest / np.maximum(sine, 1e-12))
    # a point is at most two box diagonals from the block
    far = 16 * unit * (4 * np.sqrt(3) + 2 * extent * step_of(bits))
    return float(far + inside.max() * step_of(bits))


def compare_sides(body, arrays, record, *, seed):
    """Check at many points that a compact mesh and the body agree on inside and outside.

    Parameters
    ----------
    body : pandis.pipeline.geometry.body.Body
    arrays, record
        As returned by `build_compact`.
    seed : int
        Seed of the points.

    Raises
    ------
    PandisError
        A side differs at a point that is farther from the surface than the deviation.
    """
    rng = np.random.default_rng(seed)
    half = SIDES // 2
    box = rng.uniform(-1, 1, (half, 3))
    engine = _mesh_distance(body)
    near = near_surface(engine.vertices, engine.faces, half, rng=rng)
    points = np.concatenate([box, near])
    distance, _ = distance_and_clear(arrays, record.bits, points, most=record.most)
    differ = points[engine.inside(points) != (distance < 0)]
    if not len(differ):
        return
    # distances take much longer than sides, so they are computed only where sides differ
    apart = np.abs(engine.distance_and_normal(differ, check=False)[0])
    wrong = apart > record.deviation + record.rounding
    if wrong.any():
        raise PandisError(
            f"on a lattice of {record.bits} bits {wrong.sum():,} of {SIDES:,} points are on the "
            f"wrong side of the surface, the farthest {apart[wrong].max():.2g} of the unit "
            f"frame away from it ({record.turned:,} faces are turned over): use more bits; "
            "above 16, use fewer, because single precision cannot separate sheets that are so close"
        )
