"""Export for ``pandis.h``: every field as one file, compared with the library before it is written.

The format: docs/format.md.
"""

import copy

import numpy as np

from pandis.base.errors import PandisError
from pandis.base.forces import penalty_force
from pandis.pipeline.geometry.distance import MeshDistance, ShapeDistance
from pandis.pipeline.kinds.check import FORCE_LENGTH, check, check_nearest, check_points
from pandis.pipeline.kinds.clearance import clearance
from pandis.pipeline.kinds.compact.build import file_parts, find_originals
from pandis.pipeline.kinds.compact.reference import CompactField
from pandis.pipeline.kinds.exact.reference import MESH_VERSION, ExactField
from pandis.pipeline.kinds.exported import ExportedField
from pandis.pipeline.kinds.grid.reference import GridField
from pandis.pipeline.kinds.limits import least_limit
from pandis.pipeline.kinds.network.reference import SirenField
from pandis.pipeline.kinds.spline.reference import SplineField
from pandis.pipeline.run.ask.catalogue import BOX
from pandis.runtime.field import COMPACT, GRID, MESH, NETWORK, RULES, SPLINE, NativeField
from pandis.runtime.field.files import pack

#: Sums of a network run in so many lanes; rows of weights are padded to whole ones.
_LANES = 16
#: The first version of the format that knows these kinds, as they are written now.
VERSIONS = {COMPACT: 3, MESH: MESH_VERSION}
#: A query of an exact mesh looks at so many nodes, leaves and faces, which takes about a tenth of
#: a tick and cuts nothing on scans; more where that would cut a query next to the surface.
MOST = 1000
#: By how much distances of an exact mesh may differ from the library's (unit frame).
_ROUNDING = 1e-12
#: Steps of 16-bit weights to either side of zero.
_STEPS = 32767


def native_bytes(field, kind, provenance, weight_bits=32, safe=None):
    """Return a field as the bytes of a ``.pandis`` file.

    Parameters
    ----------
    field : pandis.pipeline.kinds.field.Field
    kind : str
        As in `pandis.pipeline.run.ask.catalogue.FieldSpec`; of a grid, how it is interpolated.
    provenance : dict
    weight_bits : {32, 16}
        Of a network's hidden layers.
    safe : ndarray, shape (9,), optional
        From `pandis.pipeline.kinds.clearance.clearance`; without it a scene asks the field at
        every tick.

    Raises
    ------
    PandisError
        ``pandis.h`` knows no such field.
    """
    return _file(field, _parts(field, kind, weight_bits), provenance, safe)


def _parts(field, kind, weight_bits):
    """Return what a file holds: the number of its kind, whole and real numbers, sections."""
    if isinstance(field, SirenField):
        return NETWORK, *_network(field, weight_bits)
    if isinstance(field, SplineField):
        return SPLINE, *_spline(field)
    if isinstance(field, CompactField):
        return COMPACT, *file_parts(field.arrays, field.record)
    if isinstance(field, GridField):
        return GRID, *_grid(field, kind)
    if isinstance(field, ExactField):
        return field.file_parts(_least_limit(field))
    raise PandisError(f"{field.name}: pandis.h knows no fields of the kind {kind}")


def _file(field, parts, provenance, safe=None):
    number, wholes, reals, sections = parts
    if safe is not None:
        sections = sections | {"SAFE": np.asarray(safe, np.float64)}
    version = VERSIONS.get(number, 2 if number == GRID and len(reals) else 1)
    return pack(number, field.frame, wholes, reals, sections, provenance, version)


def _network(field, weight_bits):
    layers, base = field.layers, field.base
    (first, _), (last, last_bias) = layers[0], layers[-1]
    width, depth, outputs = len(first), len(layers) - 1, len(last)
    hidden = [weight.T for weight, _ in layers[1:-1]]
    rows = np.concatenate(hidden) if hidden else np.empty((0, width), np.float32)
    biases = np.zeros((depth, _padded(width)), np.float32)
    for index, (_, bias) in enumerate(layers[:-1]):
        biases[index, :width] = bias
    tail = np.zeros(4, np.float32)
    tail[:outputs] = last_bias
    sections = {
        "WIN ": _pad(first.T),
        "WOUT": _pad(last),
        "BIAS": np.append(biases.ravel(), tail),
    }
    if weight_bits == 16:
        steps, scales = _quantised(rows)
        sections |= {"WHID": _pad(steps), "SCAL": scales}
    else:
        sections["WHID"] = _pad(rows)
    cells = 0
    if base is not None:
        cells, sections["BASE"] = len(base.coefficients) - 3, base.coefficients
    return (width, depth, outputs, cells, weight_bits), (), sections


def network_bytes(width, depth, outputs, base, weight_bits):
    """Return the bytes that ``pandis.h`` answers a network from.

    Parameters
    ----------
    width, depth, outputs : int
        Units of a layer of sines, layers, and numbers that the last one gives.
    base : int or None
        Cells per axis of the spline that it adds to.
    weight_bits : {32, 16}
    """
    row, rows = _padded(width), (depth - 1) * width
    scales = 4 * rows if weight_bits == 16 else 0
    ends = 4 * (3 * row + outputs * row + depth * row + 4)
    return ends + rows * row * weight_bits // 8 + scales + (4 * (base + 3) ** 3 if base else 0)


def _padded(width):
    return -(-width // _LANES) * _LANES


def _pad(rows):
    return np.pad(rows, ((0, 0), (0, _padded(rows.shape[1]) - rows.shape[1])))


def _grid(field, kind):
    rule, axes = kind.removesuffix(BOX), field.axes
    if rule not in RULES:
        raise PandisError(f"{field.name}: pandis.h knows no grids of the kind {kind}")
    nodes = field.coefficients if kind == "tricubic" else field.values
    covered = np.packbits(field.covered.ravel())
    sections = {"NODE": nodes.astype(np.float32), "COVR": covered}
    # readers of version 1 take every grid to lie on the cube
    corners = () if kind == rule else (*axes.low, *axes.high)
    return (RULES.index(rule), len(field.values)), corners, sections


def _spline(field):
    wholes, sections = {}, {}
    for index, (letter, level) in enumerate(zip("BF", field.levels, strict=True)):
        brick, mask, base = level.index
        stored = field.stored[index]
        wholes |= {index: level.lattice.size, 2 + index: level.bricks}
        wholes |= {4 + index: len(mask), 6 + index: len(stored)}
        sections |= {f"{letter}BRK": brick, f"{letter}MSK": mask, f"{letter}BAS": base}
        sections[f"{letter}COF"] = stored
    sections |= {"RCOF": field.stored[2], "SIDE": field.side_bits}
    lows = [lattice.low for lattice in (*(level.lattice for level in field.levels), field.far)]
    offsets, scales = zip(*field.scales, strict=True)
    reals = [*lows, *offsets, *scales, field.band.inside, field.band.outside]
    return [*(wholes[k] for k in range(8)), field.far.size], reals, sections


def _least_limit(exact):
    """Return how much a query of an exact field may look at: see `MOST`."""
    engine = exact.engine
    if isinstance(engine, ShapeDistance):
        return MOST

    def query(points, most):
        native = NativeField(exact.file(most))
        answer, clear = native.query_within(exact.frame.to_mesh(points), np.inf)
        return answer.distance, clear

    return least_limit(MOST, engine.vertices, engine.faces, query)


def export_native(field, kind, provenance, weight_bits, body, log, original_faces=False):
    """Return the ``.pandis`` file of a field, checked against it.

    Parameters
    ----------
    field, kind, provenance, weight_bits
        As for `native_bytes`.
    body : pandis.pipeline.geometry.body.Body
        What the field is of: how far its distances are off there goes with it.
    log : callable
    original_faces : bool
        The file of a compact mesh also says which faces of the body's mesh its faces stand for.

    Raises
    ------
    PandisError
        ``pandis.h`` does not answer as the field does.
    """
    *numbers, sections = _parts(field, kind, weight_bits)
    parts = *numbers, sections | _said_of_faces(field, body, original_faces)
    # the file that is checked is let go of before the next one is made: each can be a gigabyte
    safe = _checked(
        field, kind, NativeField(_file(field, parts, provenance)), weight_bits, body, log
    )
    return _file(field, parts, provenance, safe)


def _said_of_faces(field, body, original_faces):
    """Return the sections that say of a mesh's faces which they are, and what they are made of."""
    exact = isinstance(field, ExactField) and not body.shape
    if not exact and not isinstance(field, CompactField):
        return {}
    sections, regions = {}, body.regions
    of_face = regions and regions.of_face
    if not exact and (original_faces or regions):
        originals = find_originals(body, field.arrays, field.record)
        if original_faces:
            sections["ORIG"] = originals
        of_face = regions and np.where(originals < 0, 0, regions.of_face[originals])
    if regions:
        names = b"".join(name.encode() + b"\0" for name in regions.names)
        sections |= {"REGN": of_face.astype(np.uint8), "RNAM": names}
    return sections


def _checked(field, kind, native, weight_bits, body, log):
    """Compare a file with its field, and return how far a scene may trust it: `_clearance`."""
    wanted = field
    if weight_bits == 16 and isinstance(field, SirenField):
        # the file must answer as the rounded weights do; what rounding costs is told
        wanted = _rounded(field)
        whole = NativeField(native_bytes(field, kind, {}))
        log(f"16-bit weights change the answers: {_change(native, whole, field.frame)}")
    file = ExportedField(field.name, native)
    if isinstance(field, CompactField):
        differences = check_nearest(file, field.engine, field.record.rounding)
    elif isinstance(field, ExactField) and isinstance(field.engine, MeshDistance):
        differences = check(
            *(native.distance_and_normal, _reference(wanted), field.frame),
            left_out=lambda points: native.clear(points) < np.abs(native.query(points).distance),
        )
        # of what is cut the bounds
        differences |= check_nearest(file, field.engine, _ROUNDING)
    else:
        double = _reference(wanted.in_double()) if isinstance(field, SirenField) else None
        given = native.distance_and_normal, _reference(wanted), field.frame
        differences = check(*given, double=double)
    told = ", ".join(f"{key} {value:.1g}" for key, value in differences.items())
    log(f"answers as the library does: the largest differences (unit frame) are {told}")
    safe = _clearance(field, file, body)
    log(
        "a scene trusts its distances in free space to within {:.2g} of the unit frame, and where "
        "they are flagged as bounds to within {:.2g}".format(*safe[6:8])
    )
    return safe


def _clearance(field, file, body):
    """Return where contacts can be, and the margins of a field's distances: see `clearance`."""
    if isinstance(field, CompactField):
        return np.array([*field.record.low, *field.record.high, *[field.record.rounding] * 2, 0.0])
    return clearance(lambda points: file.query(points)[::2], body.distance)


def _rounded(field):
    """Return a network whose hidden weights are those of its 16-bit file."""
    rounded, inner = copy.copy(field), []
    for weight, bias in field.layers[1:-1]:
        steps, scales = _quantised(weight.T)
        inner.append(((steps * scales[:, None]).T.astype(np.float32), bias))
    rounded.layers = [field.layers[0], *inner, field.layers[-1]]
    return rounded


def _quantised(rows):
    """Return rows in whole steps of a size of each row's own, and the sizes."""
    scales = (np.abs(rows).max(axis=1, initial=0) / _STEPS).astype(np.float32)
    steps = np.rint(rows / np.maximum(scales, np.float32(1e-30))[:, None])
    return steps.astype(np.int16), scales


def _change(one, other, frame):
    """Return by how much the answers of two native fields differ, unit frame."""
    points = check_points(frame)
    inside = (np.abs(frame.to_unit(points)) <= 1).all(axis=1)
    (d1, n1), (d2, n2) = (field.distance_and_normal(points[inside]) for field in (one, other))
    force = penalty_force(d1 * frame.scale, n1) - penalty_force(d2 * frame.scale, n2)
    size = np.linalg.norm(force, axis=1)
    return {
        "distance": float(np.abs(d1 - d2).max() * frame.scale),
        "force, mean": float(size.mean()),
        "force, 99 %": float(np.percentile(size, 99)),
    }


def _reference(field):
    """Return what `check` compares with, at points of the unit frame."""

    def reference(points):
        return *field.answer(points), _direction_length(field, points)

    return reference


def _direction_length(field, points):
    if isinstance(field, SirenField):
        return np.linalg.norm(field.direction(np.clip(points, -1, 1))[1], axis=1)
    if isinstance(field, GridField):
        return np.minimum(field.direction_length(points), FORCE_LENGTH)
    # between two walls a direction is a matter of rounding: compare the force
    return np.full(len(points), FORCE_LENGTH)
