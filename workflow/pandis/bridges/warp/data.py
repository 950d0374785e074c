"""Fields on a Warp device: the sections of a ``.pandis`` file as arrays."""

import numpy as np
import warp as wp

from pandis.runtime.field.constants import COMPACT, NETWORK, SPLINE

#: Half the longest side, in the unit frame. The lattice begins at -HALF.
HALF = 0.9
#: Maximum number of pending boxes of a query: up to seven for each level of the tree.
ROOM = 256


@wp.struct
class Lattice:
    """A lattice of cubic B-spline coefficients: ``size`` nodes per axis, the first at ``low``."""

    size: wp.int32
    bricks: wp.int32
    low: wp.float64
    per_step: wp.float64
    offset: wp.float64
    scale: wp.float64
    brick: wp.array(dtype=wp.uint16)
    mask: wp.array(dtype=wp.uint64)
    base: wp.array(dtype=wp.uint32)


@wp.struct
class Field:
    """A field's data for kernels: its numbers, and the sections of its file.

    The names are those of docs/format.md. Only the members of the field's kind are filled.
    """

    kind: wp.int32
    centre: wp.vec3d
    scale: wp.float64
    # spline: two sparse lattices, and a dense one for the space beyond them
    coarse: Lattice
    fine: Lattice
    far: Lattice
    coarse_values: wp.array(dtype=wp.int16)
    fine_values: wp.array(dtype=wp.int8)
    far_values: wp.array(dtype=wp.int16)
    side: wp.array(dtype=wp.uint8)
    inside: wp.float64
    outside: wp.float64
    # compact mesh: branches, blocks and their bytes, in words of eight bytes
    step: wp.float64
    reach: wp.float64
    branches: wp.array(dtype=wp.uint64)
    blocks: wp.array(dtype=wp.uint64)
    packed: wp.array(dtype=wp.uint64)
    # network, and the coarse spline that it corrects
    width: wp.int32
    depth: wp.int32
    outputs: wp.int32
    first: wp.array2d(dtype=wp.float32)
    hidden: wp.array2d(dtype=wp.float32)
    last: wp.array2d(dtype=wp.float32)
    biases: wp.array(dtype=wp.float32)
    under: Lattice
    under_values: wp.array(dtype=wp.float32)


@wp.struct
class Answer:
    """Distance in mesh units, unit normal, and flag as in `pandis.runtime.field`."""

    distance: wp.float64
    normal: wp.vec3d
    flag: wp.int32


def upload(contents, device):
    """Return the `Field` of a file's contents, with its arrays on a device.

    Parameters
    ----------
    contents : pandis.runtime.field.files.Contents
        Contents of a spline, a compact mesh or a network.
    device : str or wp.Device, optional
        Warp's default device if None.
    """
    fill = {SPLINE: _spline, COMPACT: _compact, NETWORK: _network}

    def there(name, kind, shape=None):
        section = np.frombuffer(contents.sections[name], np.dtype(kind).newbyteorder("<"))
        return to_device(section if shape is None else section.reshape(shape), kind)

    def to_device(values, kind):
        return wp.array(np.ascontiguousarray(values, kind), device=device)

    field, frame = Field(), contents.field.frame
    field.kind, field.centre, field.scale = (
        contents.field.kind,
        wp.vec3d(*frame.centre),
        frame.scale,
    )
    fill[field.kind](field, contents, there, to_device)
    return field


def _lattice(size, low):
    lattice = Lattice()
    lattice.size, lattice.low, lattice.per_step = size, low, (size - 1) / (-2 * low)
    return lattice


def _spline(field, contents, there, _):
    wholes, reals = contents.wholes, contents.reals
    for level, (name, letter) in enumerate((("coarse", "B"), ("fine", "F"))):
        lattice = _lattice(wholes[level], reals[level])
        lattice.bricks = wholes[2 + level]
        lattice.brick = there(f"{letter}BRK", np.uint16)
        lattice.mask = there(f"{letter}MSK", np.uint64)
        lattice.base = there(f"{letter}BAS", np.uint32)
        setattr(field, name, lattice)
    field.far = _lattice(wholes[8], reals[2])
    for level, each in enumerate((field.coarse, field.fine, field.far)):
        each.offset, each.scale = reals[3 + level], reals[6 + level]
    field.coarse_values, field.fine_values = there("BCOF", np.int16), there("FCOF", np.int8)
    field.far_values, field.side = there("RCOF", np.int16), there("SIDE", np.uint8)
    field.inside, field.outside = reals[9], reals[10]


def _compact(field, contents, there, to_device):
    field.step, field.reach = 2 * HALF / ((1 << contents.wholes[0]) - 1), contents.reals[0]
    field.branches, field.blocks = there("BRCH", np.uint64), there("BLCK", np.uint64)
    section = np.frombuffer(contents.sections["PACK"], np.uint8)
    # a read of eight bytes may begin at any byte, so pad the end
    whole = np.zeros(-(-len(section) // 8) + 1, np.uint64)
    whole.view(np.uint8)[: len(section)] = section
    field.packed = to_device(whole, np.uint64)


def _network(field, contents, there, to_device):
    field.width, field.depth, field.outputs, cells, bits = contents.wholes[:5]
    stride, rows = -(-field.width // 16) * 16, (field.depth - 1) * field.width
    field.first = there("WIN ", np.float32, (3, stride))
    field.last = there("WOUT", np.float32, (field.outputs, stride))
    field.biases = there("BIAS", np.float32)
    # pad rows, too, to a multiple of sixteen, so that kernels need no remainder loop
    whole = np.zeros((field.depth - 1, stride, stride), np.float32)
    if bits == 32:
        weights = np.frombuffer(contents.sections["WHID"], "<f4").reshape(rows, stride)
    else:
        stored = np.frombuffer(contents.sections["WHID"], "<i2").reshape(rows, stride)
        weights = stored * np.frombuffer(contents.sections["SCAL"], "<f4")[:, None]
    whole[:, : field.width] = weights.reshape(field.depth - 1, field.width, stride)
    field.hidden = to_device(whole.reshape(-1, stride), np.float32)
    if cells:
        field.under = _lattice(cells + 3, -1 - 2 / cells)
        field.under.scale = 1.0
        field.under_values = there("BASE", np.float32)
