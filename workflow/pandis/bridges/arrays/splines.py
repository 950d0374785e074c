"""Splines on arrays: the arithmetic of parts/spline.h, for many points at once."""

import numpy as np

#: As in parts/spline.h: how far above a crease a spline is evaluated (steps), and how far below 1
#: the squared gradient must be before a point counts as near a crease.
_LIFT, _SHORT = 0.7, 0.02


def spline(contents):
    """Return a spline's evaluation function and its data."""
    wholes, reals = contents.wholes, contents.reals
    data = {"inside": reals[9], "outside": reals[10]}
    for level, (name, letter, kind) in enumerate((("coarse", "B", "<i2"), ("fine", "F", "<i1"))):
        size, bricks, low = wholes[level], wholes[2 + level], reals[level]
        stored = np.frombuffer(contents.sections[f"{letter}COF"], kind)
        values = (reals[3 + level] + reals[6 + level] * stored).astype(np.float32)
        data |= lattice(name, size, low)
        data[f"{name}_values"] = np.append(values, np.float32(0)).astype(np.float64)
        data[f"{name}_blocks"] = _blocks(contents.sections, letter, bricks)
        data[f"{name}_across"] = 4 * bricks
    size = wholes[8]
    data |= lattice("far", size, reals[2])
    stored = np.frombuffer(contents.sections["RCOF"], "<i2")
    data["far_values"] = (reals[5] + reals[8] * stored).astype(np.float32).astype(np.float64)
    sides = np.frombuffer(contents.sections["SIDE"], np.uint8)
    data["free"] = np.unpackbits(sides)[: data["coarse_across"] ** 3].astype(bool)
    return _answer, data


def lattice(name, size, low):
    """Return the parameters of a lattice with ``size`` nodes per axis, the first at ``low``."""
    return {f"{name}_size": size, f"{name}_low": low, f"{name}_rate": (size - 1) / (-2 * low)}


def _blocks(sections, letter, bricks):
    """Return the index of each block's first coefficient (blocks³,); -1 if it is not stored."""
    brick = np.frombuffer(sections[f"{letter}BRK"], "<u2").reshape((bricks,) * 3)
    mask = np.frombuffer(sections[f"{letter}MSK"], "<u8")
    stored = np.unpackbits(mask.astype("<u8").view(np.uint8), bitorder="little").reshape(
        -1, 4, 4, 4
    )
    number = np.cumsum(stored.reshape(-1), dtype=np.int64).reshape(stored.shape) - 1
    start = np.where(stored, 8 * number, -1)
    none = np.full((1, 4, 4, 4), -1)
    table = np.concatenate([start, none])[np.minimum(brick, len(start))]
    return table.transpose(0, 3, 1, 4, 2, 5).reshape(-1)


def _answer(xp, data, box, *, away, **_):
    p = off_edge(xp, box)
    value, gradient, covered = _both(xp, data, p)
    value, gradient = _sharpened(xp, data, p, value=value, gradient=gradient)
    far, slope = _beyond(xp, data, p)
    inside = covered & (away == 0)
    free = _free(xp, data, p) | (away > 0)
    bound = xp.where(free, xp.clip(far, data["outside"], None), xp.clip(far, None, -data["inside"]))
    return (
        xp.where(inside, value, bound + away),
        xp.where(inside[:, None], gradient, slope),
    )


def off_edge(xp, box):
    """Move points on the box's faces slightly inward, so that they are in its last cells."""
    edge = 1 - max(1e-12, 4 * float(xp.finfo(box.dtype).eps))
    return xp.clip(box, -edge, edge)


def _both(xp, data, p):
    value, gradient, covered = _level(xp, data, "coarse", p=p)
    more, steeper, _ = _level(xp, data, "fine", p=p)
    return value + more, gradient + steeper, covered


def _sharpened(xp, data, p, *, value, gradient):
    """Evaluate above a rounded crease, and extrapolate the answers back down."""
    missing = (1 - (gradient * gradient).sum(-1) - _SHORT) / (1 - _SHORT)
    lift = xp.clip(-value, 0, _LIFT / data["coarse_rate"])
    lift = lift * xp.where(missing > 0, missing * missing * (3 - 2 * missing), 0.0)
    above, steeper, covered = _both(xp, data, p + lift[:, None] * gradient)
    squared, length = (gradient * gradient).sum(-1), (steeper * steeper).sum(-1)
    turns = (lift > 0) & covered & (squared > 0) & (length > 0)
    normal = steeper / xp.sqrt(xp.where(turns, length, 1.0))[:, None]
    slope = xp.sqrt(xp.where(turns, squared, 1.0))
    carried = above - lift * (gradient * normal).sum(-1)
    return (
        xp.where(turns, carried, value),
        xp.where(turns[:, None], slope[:, None] * normal, gradient),
    )


def _place(xp, data, name, *, p):
    """Return first nodes (n, 3), weights, slopes (n, 3, 4), and a mask of points in the lattice."""
    rate, size = data[f"{name}_rate"], data[f"{name}_size"]
    x = (p - data[f"{name}_low"]) * rate
    cell = xp.floor(x)
    within = ((cell >= 1) & (cell <= size - 3)).all(-1)
    cell = xp.clip(cell, 1, size - 3)
    t = x - cell
    s = 1 - t
    weights = xp.stack([
        s * s * s / 6, (4 - 6 * t * t + 3 * t * t * t) / 6,
        (4 - 6 * s * s + 3 * s * s * s) / 6, t * t * t / 6,
    ], -1)  # fmt: skip
    slopes = rate * xp.stack([-s * s / 2, t * (3 * t - 4) / 2, -s * (3 * s - 4) / 2, t * t / 2], -1)
    return _whole(xp, cell) - 1, weights, slopes, within


def _whole(xp, x):
    x = xp.nan_to_num(x)  # NaN points need a valid index; their answers are NaN
    return x.to(xp.int64) if xp.__name__ == "torch" else x.astype(int)


def _sum(xp, c, weights, *, slopes):
    """Return values (n,) and gradients (n, 3), given coefficients (n, 4, 4, 4)."""
    x, y, z = weights[:, 0], weights[:, 1], weights[:, 2]
    along_z = xp.einsum("nxyz,nz->nxy", c, z)
    along_yz = xp.einsum("nxy,ny->nx", along_z, y)
    gradient = xp.stack([
        (along_yz * slopes[:, 0]).sum(-1),
        (xp.einsum("nxy,ny->nx", along_z, slopes[:, 1]) * x).sum(-1),
        xp.einsum("nxyz,nx,ny,nz->n", c, x, y, slopes[:, 2]),
    ], -1)  # fmt: skip
    return (along_yz * x).sum(-1), gradient


def _level(xp, data, name, *, p):
    """Return a sparse lattice's contribution, and a mask of the points with all 64 coefficients."""
    first, weights, slopes, within = _place(xp, data, name, p=p)
    values, blocks, across = data[f"{name}_values"], data[f"{name}_blocks"], data[f"{name}_across"]
    parts = []
    for i in range(4):
        for j in range(4):
            for k in range(4):
                x, y, z = first[:, 0] + i, first[:, 1] + j, first[:, 2] + k
                start = blocks[((x >> 1) * across + (y >> 1)) * across + (z >> 1)]
                at = start + (((x & 1) << 2) | ((y & 1) << 1) | (z & 1))
                parts.append(xp.where(start < 0, -1, at))
    at = xp.stack(parts, -1)
    c = values[at].reshape(-1, 4, 4, 4)  # index -1 selects the last value, which is zero
    value, gradient = _sum(xp, c, weights, slopes=slopes)
    zero = xp.where(within, 1.0, 0.0)
    return value * zero, gradient * zero[:, None], within & (at >= 0).all(-1)


def dense_sum(xp, data, name, *, p):
    """Return values (n,) and gradients (n, 3) of a dense lattice, and a mask of points in it."""
    first, weights, slopes, within = _place(xp, data, name, p=p)
    size, parts = data[f"{name}_size"], []
    for i in range(4):
        for j in range(4):
            row = ((first[:, 0] + i) * size + first[:, 1] + j) * size + first[:, 2]
            parts += [data[f"{name}_values"][row + k] for k in range(4)]
    coefficients = xp.stack(parts, -1).reshape(-1, 4, 4, 4)
    return *_sum(xp, coefficients, weights, slopes=slopes), within


def _beyond(xp, data, p):
    value, gradient, within = dense_sum(xp, data, "far", p=p)
    zero = xp.where(within, 1.0, 0.0)
    return value * zero, gradient * zero[:, None]


def _free(xp, data, p):
    """Return a mask of the points in blocks that are marked as outside."""
    at = (p - data["coarse_low"]) * data["coarse_rate"]
    block = _whole(xp, xp.floor(xp.clip(at, 0, data["coarse_size"] - 2) / 2))
    across = data["coarse_across"]
    return data["free"][(block[:, 0] * across + block[:, 1]) * across + block[:, 2]]
