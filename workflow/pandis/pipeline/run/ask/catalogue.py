"""Which fields there are: what each is called, which artifact holds it, what it exports.

Ground floor: names only, no code that answers a query.
"""

import re
from typing import NamedTuple

MESH_NAME = "[a-z][a-z0-9_-]*"
#: Folders of ``results/`` that are not meshes.
RESERVED_NAMES = ("logs", "benchmarks", "scenes", "native")

#: Fields stored on a grid, and what their grid's nodes hold; with `BOX`, on the box around the
#: surface instead of the cube [-1, 1]³.
GRID_FIELDS = {
    "nearest": "force",
    "trilinear": "force",
    "nearest-box": "force-box",
    "trilinear-box": "force-box",
    "trilinear-normal": "normal",
    "trilinear-gradient": "distance",
    "tricubic": "distance",
    "kim": "distance",
    "kim-ray": "distance",
    "kim-cell": "distance",
    "spline": "spline",
}
#: Ends the names of grids on the box around the surface, as the paper has them.
BOX = "-box"
#: Dense grids that `fields: auto` tries.
DENSE_KINDS = ("nearest", "trilinear", "trilinear-normal", "trilinear-gradient", "tricubic")
#: Grid fields that are there to be compared with, or have no graph.
_UNEXPORTED = {"spline", "kim", "kim-ray", "kim-cell"}
#: The mesh with its vertices on a lattice of so many bits, and the fewest and the most of them.
COMPACT = "compact"
COMPACT_BITS = 10, 20
#: The paper's [16]: planes alone, with their distance maps, with the maps' slopes too.
PLANE_FIELDS = ("support-planes-only", "support-planes-distance", "support-planes")
#: The paper's [22]: a contact point tracked on the exact surface, or on another field's.
PROXY = "salisbury"
#: The paper's [10] on x² + y² + z² - 1, on the unit sphere.
ALGEBRAIC = "kim-algebraic"
#: The cheapest field that meets a budget, whichever it is.
AUTO = "auto"
#: Fields that ``pandis.h`` answers.
_NATIVE = {"exact", AUTO, "network", COMPACT, *GRID_FIELDS} - {"kim", "kim-ray", "kim-cell"}
#: Most nodes per axis.
LARGEST = {"spline": 320}
LARGEST_DENSE = 512


class FieldSpec(NamedTuple):
    """One entry of a configuration's ``fields``.

    Attributes
    ----------
    name : str
        As the user wrote it.
    kind : str
        ``exact``, COMPACT, a key of GRID_FIELDS, ``network``, or one of the paper's other methods:
        PROXY, ALGEBRAIC, one of PLANE_FIELDS; or AUTO: its artifact says.
    artifact : str
        Stem of the artifact that holds it: ``results/{mesh}/{artifact}.zarr.zip``.
    size : int, "auto" or None
        Nodes per axis of a grid; bits of a compact mesh.
    exports : tuple of str
        Endings of its files under ``results/{mesh}/export/``, except ``.pandis``: see ``native``.
    through : FieldSpec or None
        The field that a contact point is tracked on.
    """

    name: str
    kind: str
    artifact: str
    size: int | str | None
    exports: tuple[str, ...]
    through: "FieldSpec | None" = None

    @property
    def native(self):
        """Whether it has a file for ``pandis.h``, ``results/{mesh}/export/{name}.pandis``."""
        return self.kind in _NATIVE


def is_grid_field(name):
    """Tell whether ``name`` is that of a grid."""
    return re.fullmatch(rf"({'|'.join(GRID_FIELDS)})-(\d+|auto)", name) is not None


def is_builtin_field(name):
    """Tell whether ``name`` is taken by a field that is not a recipe."""
    method = name in PLANE_FIELDS or name.startswith((PROXY, ALGEBRAIC))
    compact = re.fullmatch(rf"{COMPACT}-(\d+|auto)", name) is not None
    return name in ("exact", AUTO) or is_grid_field(name) or compact or method


def in_order(names, recipes):
    """Return names of fields in the order of this module's kinds, then by size and by name.

    A configuration may list them in any order: that alone changes no result.

    Parameters
    ----------
    names : list of str
    recipes : container of str

    Raises
    ------
    ValueError
        As of `parse_field`.
    """
    kinds = ["exact", COMPACT, *GRID_FIELDS, "network", ALGEBRAIC, PROXY, *PLANE_FIELDS, AUTO]

    def place(name):
        spec = parse_field(name, recipes)
        sized = isinstance(spec.size, int)
        return kinds.index(spec.kind), not sized, spec.size if sized else 0, name

    return sorted(names, key=place)


def parse_field(name, recipes):
    """Return the FieldSpec of ``name``.

    Parameters
    ----------
    name : str
        An entry of ``fields``.
    recipes : container of str
        Names under ``train``.

    Raises
    ------
    ValueError
        The name is unknown, or a grid too small or too large.
    """
    if name == "exact":
        return FieldSpec(name, "exact", "mesh", None, ())
    if name == AUTO:
        return FieldSpec(name, AUTO, "choice", None, ())
    if name in PLANE_FIELDS:
        return FieldSpec(name, name, "method-support-planes", None, ())
    if name == PROXY or name.startswith(f"{PROXY}-"):
        inner = parse_field(name.removeprefix(PROXY).removeprefix("-") or "exact", recipes)
        if inner.through:
            raise ValueError(f"{name}: a contact point is tracked on a field, not on another one")
        if inner.kind == AUTO:
            raise ValueError(
                f"{name}: a contact point is tracked on a field that is known: name it"
            )
        if GRID_FIELDS.get(inner.kind) in ("force", "force-box"):
            raise ValueError(
                f"{name}: {inner.name} knows no distance outside of the surface, where "
                "a contact point is looked for; take trilinear-normal or tricubic"
            )
        return FieldSpec(name, PROXY, inner.artifact, None, (), inner)
    if match := re.fullmatch(f"{ALGEBRAIC}-([1-9][0-9]*)", name):
        if not 4 <= int(match[1]) <= LARGEST_DENSE:
            raise ValueError(f"{name}: it has 4 to {LARGEST_DENSE} nodes per axis")
        return FieldSpec(name, ALGEBRAIC, "mesh", int(match[1]), ())
    if match := re.fullmatch(f"{COMPACT}-([1-9][0-9]*|auto)", name):
        if match[1] == AUTO:
            return FieldSpec(name, COMPACT, name, AUTO, ())
        bits, (fewest, most) = int(match[1]), COMPACT_BITS
        if not fewest <= bits <= most:
            raise ValueError(f"{name}: its lattice has {fewest} to {most} bits")
        return FieldSpec(name, COMPACT, name, bits, ())
    if match := re.fullmatch(f"({'|'.join(GRID_FIELDS)})-([1-9][0-9]*|auto)", name):
        kind = match[1]
        exports = () if kind in _UNEXPORTED else ("onnx",)
        if match[2] == AUTO:
            return FieldSpec(name, kind, f"grid-{kind}-auto", AUTO, exports)
        size, smallest = int(match[2]), 32 if kind == "spline" else 4
        largest = LARGEST.get(kind, LARGEST_DENSE)
        if not smallest <= size <= largest:
            raise ValueError(f"{name}: it has {smallest} to {largest} nodes per axis")
        return FieldSpec(name, kind, f"grid-{GRID_FIELDS[kind]}-{size}", size, exports)
    if name in recipes:
        return FieldSpec(name, "network", f"model-{name}", None, ("onnx",))
    sized = [f"{COMPACT}-16", *(f"{kind}-64" for kind in GRID_FIELDS)]
    known = ["exact", *sized, *PLANE_FIELDS, PROXY, *recipes]
    raise ValueError(f"'{name}' is no field; known are {', '.join(known)}")
