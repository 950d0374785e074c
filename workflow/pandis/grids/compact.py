"""Builds the compact mesh of a body, and says how far it can be trusted."""

import numpy as np

from pandis.errors import PandisError
from pandis.geometry.distance import MeshDistance
from pandis.geometry.sampling import Surface
from pandis.grids.lattice import snap, step_of, to_unit
from pandis.grids.sides import find_sides
from pandis.native.packing import BLOCK_BYTES, BRANCH_BYTES, distances, pack_mesh
from pandis.run.records.compact import CompactRecord

#: Groups of eight faces, and blocks, that one query looks at: what takes about a tenth of a tick.
#: How many queries of scans are cut by it: tests/benchmarks/compact.py.
MOST = 704
#: Points at which sides are compared with the body's: half in the box, half near the surface.
SIDES = 1_000_000
#: Heights of the latter above and below the surface (unit frame), spread by logarithm.
_HEIGHTS = 1e-5, 0.1


def build_compact(body, bits, seed, log):
    """Return the arrays and the record of a body's compact mesh.

    Parameters
    ----------
    body : pandis.geometry.body.Body
        Of a closed form its tessellation is taken.
    bits : int
        Of a coordinate.
    seed : int
        Of the points at which sides are compared.
    log : callable

    Returns
    -------
    arrays : dict of str to ndarray
    record : pandis.run.records.compact.CompactRecord

    Raises
    ------
    PandisError
        Points farther from the surface than it can have moved are on the wrong side.
    """
    snapped = snap(body.corners, body.faces, bits)
    sides = find_sides(snapped.vertices, snapped.faces)
    packed = pack_mesh(snapped.vertices, snapped.faces, sides)
    places = to_unit(snapped.vertices, bits)
    record = CompactRecord(
        bits=bits,
        faces=len(snapped.faces),
        vertices=len(snapped.vertices),
        deviation=snapped.deviation,
        rounding=_rounding(packed, snapped, bits),
        turned=snapped.turned,
        reach=float(np.abs(places).max()),
        low=tuple(places.min(axis=0)),
        high=tuple(places.max(axis=0)),
    )
    arrays = packed._asdict()
    log(
        f"{bits} bits: {record.faces:,} of {len(body.faces):,} faces in "
        f"{sum(part.nbytes for part in arrays.values()):,} bytes; distances are within "
        f"{record.deviation:.2g} of the mesh's (unit frame)"
    )
    _compare_sides(body, arrays, record, seed)
    return arrays, record


def file_parts(arrays, record):
    """Return whole numbers, real numbers and sections of a compact mesh in a ``.pandis`` file."""
    wholes = [
        record.bits,
        len(arrays["branches"]) // BRANCH_BYTES,
        len(arrays["blocks"]) // BLOCK_BYTES,
        len(arrays["packed"]),
        MOST,
    ]
    sections = {"BRCH": arrays["branches"], "BLCK": arrays["blocks"], "PACK": arrays["packed"]}
    sections["BOND"] = np.array([record.deviation, record.rounding])
    return wholes, [record.reach], sections


def _rounding(packed, snapped, bits):
    """Return by how much a distance can be too large, because a wrong face was taken (unit frame).

    It holds in the box [-1, 1]³.

    Faces are compared in single precision, relative to their block: a point is off by half a unit
    in the last place of its coordinates, the closest point on an edge by some more. Inside of a
    triangle the error grows as the sine of its corner falls, up to half its height, for then its
    edges stand in.
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
    # two diagonals of the box away from the block at most
    far = 16 * unit * (4 * np.sqrt(3) + 2 * extent * step_of(bits))
    return float(far + inside.max() * step_of(bits))


def _compare_sides(body, arrays, record, seed):
    """Compare sides with those of the body at many points.

    Raises
    ------
    PandisError
        One that is farther from the surface than the deviation differs.
    """
    rng = np.random.default_rng(seed)
    half = SIDES // 2
    box = rng.uniform(-1, 1, (half, 3))
    engine = MeshDistance(body.corners, body.faces) if body.shape else body.distance
    feet = Surface(engine.vertices, engine.faces).draw(half, rng)[0]
    height = np.exp(rng.uniform(*np.log(_HEIGHTS), half)) * rng.choice((-1, 1), half)
    away = rng.normal(size=(half, 3))
    away *= (height / np.linalg.norm(away, axis=1))[:, None]
    points = np.concatenate([box, feet + away])
    exact, _ = engine.distance_and_normal(points)
    distance = distances(arrays, record.bits, points, MOST)
    wrong = (exact < 0) != (distance < 0)
    wrong &= np.abs(exact) > record.deviation + record.rounding
    if wrong.any():
        raise PandisError(
            f"on a lattice of {record.bits} bits {wrong.sum():,} of {SIDES:,} points are on the "
            f"wrong side of the surface, one of them {np.abs(exact[wrong]).max():.2g} of the unit "
            f"frame away from it ({record.turned:,} faces are turned over): take more bits"
        )
