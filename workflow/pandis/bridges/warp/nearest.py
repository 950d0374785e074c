"""Nearest faces of compact meshes in Warp, as in parts/packed.h and the searches of compact.h.

The search runs in single precision and adds in the same order as pandis.h, so that both find the
same face among several that are almost equally near.
"""

import warp as wp

from pandis.bridges.warp.data import ROOM, Field

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

vec8i = wp.types.vector(length=8, dtype=wp.int32)
NONE = wp.constant(2147483647)
WAITING = wp.constant(ROOM)
WORDS_OF_A_BRANCH, BOXES = wp.constant(12), wp.constant(48)
GROUP_BYTES, FACES_OF_A_BLOCK = wp.constant(18), wp.constant(64)


@wp.struct
class Block:
    """Byte offsets of a block's parts in ``PACK``, and the contents of its record."""

    boxes: wp.int32
    faces: wp.int32
    corners: wp.int32
    sides: wp.int32
    face_count: wp.int32
    corner_count: wp.int32
    groups: wp.int32
    stride: wp.int32
    has_sides: wp.int32
    bits: wp.vec3i
    origin: wp.vec3i
    shift: wp.vec3i


@wp.struct
class Branch:
    """The header of a branch."""

    origin: wp.vec3i
    shift: wp.vec3i
    count: wp.int32


@wp.func
def word_at(packed: wp.array(dtype=wp.uint64), byte: wp.int32) -> wp.uint64:
    """Return the eight bytes at any offset as a little-endian number."""
    at, off = byte >> 3, wp.uint64((byte & 7) * 8)
    word = packed[at] >> off
    if off > wp.uint64(0):
        word = word | (packed[at + 1] << (wp.uint64(64) - off))
    return word


@wp.func
def bits_of(word: wp.uint64, first: wp.int32, count: wp.int32) -> wp.int32:
    return wp.int32(
        (word >> wp.uint64(first)) & ((wp.uint64(1) << wp.uint64(count)) - wp.uint64(1))
    )


@wp.func
def block_of(field: Field, number: wp.int32) -> Block:
    head, origin = field.blocks[2 * number], field.blocks[2 * number + 1]
    b = Block()
    b.face_count = bits_of(head, 32, 6) + 1
    b.corner_count = bits_of(head, 38, 6) + 1
    b.groups = (b.face_count + 7) >> 3
    for k in range(3):
        b.bits[k] = bits_of(head, 44 + 5 * k, 5)
        b.origin[k] = bits_of(origin, 21 * k, 21)
        b.shift[k] = wp.max(b.bits[k] - 8, 0)
    b.stride = ((b.bits[0] + b.bits[1] + b.bits[2]) >> 3) + 1
    b.boxes = bits_of(head, 0, 32)
    b.faces = b.boxes + BOXES
    b.corners = b.faces + GROUP_BYTES * b.groups
    b.sides = b.corners + b.stride * b.corner_count
    b.has_sides = bits_of(head, 59, 1)
    return b


@wp.func
def branch_of(field: Field, number: wp.int32) -> Branch:
    at = WORDS_OF_A_BRANCH * number
    xy, rest = field.branches[at], field.branches[at + 1]
    b = Branch()
    b.origin = wp.vec3i(bits_of(xy, 0, 32), bits_of(xy, 32, 32), bits_of(rest, 0, 32))
    b.shift = wp.vec3i(bits_of(rest, 32, 8), bits_of(rest, 40, 8), bits_of(rest, 48, 8))
    b.count = bits_of(rest, 56, 8)
    return b


@wp.func
def child_of(field: Field, branch: wp.int32, place: wp.int32) -> wp.int32:
    word = field.branches[WORDS_OF_A_BRANCH * branch + 8 + (place >> 1)]
    return wp.int32(wp.uint32(word >> wp.uint64(32 * (place & 1)) & wp.uint64(4294967295)))


@wp.func
def byte_of(word: wp.uint64, place: wp.int32) -> wp.int32:
    return wp.int32(word >> wp.uint64(8 * place) & wp.uint64(255))


@wp.func
def keys_of(
    x0: wp.uint64, y0: wp.uint64, z0: wp.uint64, x1: wp.uint64, y1: wp.uint64, z1: wp.uint64,
    count: wp.int32, shift: wp.vec3i, q: wp.vec3f,
) -> vec8i:  # fmt: skip
    """Return lower bounds of squared distances to eight boxes, as order-preserving integers."""
    keys = vec8i()
    scale, low, high = wp.vec3f(), wp.vec3f(), wp.vec3f()
    for k in range(3):
        scale[k] = float(1 << shift[k])
        slack = 1e-6 * (wp.abs(q[k]) + 256.0 * scale[k])
        low[k] = q[k] + slack
        high[k] = q[k] - slack
    for i in range(8):
        x = wp.max(
            float(byte_of(x0, i)) * scale[0] - low[0], high[0] - float(byte_of(x1, i)) * scale[0]
        )
        y = wp.max(
            float(byte_of(y0, i)) * scale[1] - low[1], high[1] - float(byte_of(y1, i)) * scale[1]
        )
        z = wp.max(
            float(byte_of(z0, i)) * scale[2] - low[2], high[2] - float(byte_of(z1, i)) * scale[2]
        )
        x, y, z = wp.max(x, 0.0), wp.max(y, 0.0), wp.max(z, 0.0)
        bits = wp.cast((x * x + y * y + z * z) * 0.99999, wp.int32)
        keys[i] = NONE
        if i < count:
            keys[i] = (bits & ~7) | i
    return keys


@wp.func
def branch_keys(field: Field, number: wp.int32, p: wp.vec3d) -> vec8i:
    b, at = branch_of(field, number), WORDS_OF_A_BRANCH * number + 2
    q = wp.vec3f()
    for k in range(3):
        q[k] = float(p[k] - wp.float64(b.origin[k]))
    w = field.branches
    return keys_of(
        w[at], w[at + 1], w[at + 2], w[at + 3], w[at + 4], w[at + 5], b.count, b.shift, q
    )


@wp.func
def group_keys(field: Field, b: Block, q: wp.vec3f) -> vec8i:
    at, w = b.boxes, field.packed
    return keys_of(
        word_at(w, at), word_at(w, at + 8), word_at(w, at + 16), word_at(w, at + 24),
        word_at(w, at + 32), word_at(w, at + 40), b.groups, b.shift, q,
    )  # fmt: skip


@wp.func
def least_of(keys: vec8i) -> wp.int32:
    least = keys[0]
    for i in range(1, 8):
        least = wp.min(least, keys[i])
    return least


@wp.func
def corner_number(field: Field, b: Block, place: wp.int32, corner: wp.int32) -> wp.int32:
    """Return a corner's index in its block, stored as six bits; a group holds eight faces."""
    codes = word_at(field.packed, b.faces + GROUP_BYTES * (place >> 3) + 6 * corner)
    return bits_of(codes, 6 * (place & 7), 6)


@wp.func
def corner_steps(packed: wp.array(dtype=wp.uint64), b: Block, number: wp.int32) -> wp.vec3i:
    """Return a corner's position, in steps from the block's origin."""
    word = word_at(packed, b.corners + b.stride * number)
    x, y, z = b.bits[0], b.bits[1], b.bits[2]
    return wp.vec3i(bits_of(word, 0, x), bits_of(word, x, y), bits_of(word, x + y, z))


@wp.func
def corner_floats(
    packed: wp.array(dtype=wp.uint64), b: Block, codes: wp.uint64, i: wp.int32
) -> wp.vec3f:
    """Return a corner of face i of a group; ``codes`` packs the corner numbers."""
    at = corner_steps(packed, b, bits_of(codes, 6 * i, 6))
    return wp.vec3f(float(at[0]), float(at[1]), float(at[2]))


@wp.func
def share(t: wp.float32) -> wp.float32:
    """Clamp to [0, 1]; NaN becomes 0."""
    if not (t > 0.0):
        return 0.0
    return wp.min(t, 1.0)


@wp.func
def dot(u: wp.vec3f, v: wp.vec3f) -> wp.float32:
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@wp.func
def triangle_squared(a: wp.vec3f, b: wp.vec3f, c: wp.vec3f, q: wp.vec3f) -> wp.float32:
    """Return the squared distance to a triangle, as pandis__eight_distances does."""
    x, u, v = q - a, b - a, c - a
    w, e = v - u, x - u
    s = share(dot(u, x) / dot(u, u))
    r = x - s * u
    best = dot(r, r)
    t = share(dot(v, x) / dot(v, v))
    r = x - t * v
    best = wp.min(best, dot(r, r))
    t = share(dot(w, e) / dot(w, w))
    r = e - t * w
    best = wp.min(best, dot(r, r))
    n = wp.vec3f(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
    per = 1.0 / dot(n, n)
    s = (
        dot(
            wp.vec3f(
                x[1] * v[2] - x[2] * v[1], x[2] * v[0] - x[0] * v[2], x[0] * v[1] - x[1] * v[0]
            ),
            n,
        )
        * per
    )
    t = (
        dot(
            wp.vec3f(
                u[1] * x[2] - u[2] * x[1], u[2] * x[0] - u[0] * x[2], u[0] * x[1] - u[1] * x[0]
            ),
            n,
        )
        * per
    )
    if s >= 0.0 and t >= 0.0 and s + t <= 1.0:
        r = (x - s * u) - t * v
        best = wp.min(best, dot(r, r))
    return best


@wp.struct
class Near:
    """The nearest face so far: squared distance, its key, and face number, block · 64 + place."""

    squared: wp.float32
    key: wp.int32
    face: wp.int32


@wp.func
def nearest_in_block(field: Field, number: wp.int32, p: wp.vec3d, best: Near) -> Near:
    b = block_of(field, number)
    q = wp.vec3f()
    for k in range(3):
        q[k] = float(p[k] - wp.float64(b.origin[k]))
    keys, eight = group_keys(field, b, q), int(8)
    key = least_of(keys)
    while key <= best.key:
        group = key & 7
        keys[group] = NONE
        at = b.faces + GROUP_BYTES * group
        first, second = word_at(field.packed, at), word_at(field.packed, at + 6)
        third = word_at(field.packed, at + 12)
        for i in range(eight):  # not unrolled: that would take minutes to compile
            squared = triangle_squared(
                corner_floats(field.packed, b, first, i),
                corner_floats(field.packed, b, second, i),
                corner_floats(field.packed, b, third, i),
                q,
            )
            face = FACES_OF_A_BLOCK * number + 8 * group + i
            if squared < best.squared or (squared == best.squared and face < best.face):
                best.squared = squared
                best.face = face
                best.key = wp.cast(squared, wp.int32) | 7
        key = least_of(keys)
    return best


@wp.func
def nearest_face(field: Field, p: wp.vec3d) -> wp.int32:
    """Return the number (block · 64 + place) of the face nearest to a point in lattice steps."""
    waiting = wp.zeros(shape=WAITING, dtype=wp.int32)
    keys_waiting = wp.zeros(shape=WAITING, dtype=wp.int32)
    best = Near()
    best.squared = 3.4028235e38
    best.key = NONE - 1
    best.face = NONE
    top, eight = int(1), int(8)
    while top > 0:
        top -= 1
        child = waiting[top]
        if keys_waiting[top] <= best.key:
            if child < 0:
                best = nearest_in_block(field, ~child, p, best)
            else:
                keys = branch_keys(field, child, p)
                for _ in range(eight):  # push the farthest first, so that the nearest is next
                    farthest, place = int(-1), int(-1)
                    for i in range(8):
                        if keys[i] <= best.key and keys[i] > farthest:
                            farthest, place = keys[i], i
                    if place >= 0:
                        keys[place] = NONE
                        waiting[top] = child_of(field, child, place)
                        keys_waiting[top] = farthest
                        top += 1
    return best.face
