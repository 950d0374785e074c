"""Numbers and names of `pandis.h` that its users meet."""

#: Kinds of fields, as numbered in docs/format.md.
NETWORK, GRID, SPLINE, MESH, SHAPE, COMPACT = 1, 2, 3, 4, 5, 6
#: Flags of an answer whose search was cut short (see `pandis.h`), and of a point with no surface
#: within reach (see `NativeField.query_within`).
CUT, BEYOND = 3, 4
#: Interpolation rules of grids.
RULES = ("nearest", "trilinear", "trilinear-normal", "trilinear-gradient", "tricubic")
#: Closed forms, in the order of their numbers.
SHAPES = ("sphere", "torus", "box", "capsule")
#: Bytes written between queries to empty the caches: more than a core's caches can hold.
CACHES = 1 << 26
