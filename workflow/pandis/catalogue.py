"""Which fields there are: what each is called, which artifact holds it, what it exports.

Ground floor: names only, no code that answers a query.
"""

import re
from typing import NamedTuple

MESH_NAME = "[a-z][a-z0-9_-]*"
#: Folders of ``results/`` that are not meshes.
RESERVED_NAMES = ("logs", "benchmarks", "scenes", "native")

#: Fields stored on a grid, and what their grid's nodes hold.
GRID_FIELDS = {
    "nearest": "force",
    "trilinear": "force",
    "trilinear-normal": "normal",
    "trilinear-gradient": "distance",
    "tricubic": "distance",
    "spline": "spline",
}
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
        ``exact``, a key of GRID_FIELDS, or ``network``.
    artifact : str
        Stem of the artifact that holds it: ``results/{mesh}/{artifact}.zarr.zip``.
    size : int, "auto" or None
        Nodes per axis of a grid.
    exports : tuple of str
        Endings of its files under ``results/{mesh}/export/``.
    """

    name: str
    kind: str
    artifact: str
    size: int | str | None
    exports: tuple[str, ...]


def is_grid_field(name):
    """Tell whether ``name`` is that of a grid."""
    return re.fullmatch(rf"({'|'.join(GRID_FIELDS)})-(\d+|auto)", name) is not None


def is_builtin_field(name):
    """Tell whether ``name`` is taken by a field that is not a recipe."""
    return name == "exact" or is_grid_field(name)


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
    if match := re.fullmatch(f"({'|'.join(GRID_FIELDS)})-([1-9][0-9]*|auto)", name):
        kind = match[1]
        exports = () if kind == "spline" else ("onnx",)
        if match[2] == "auto":
            return FieldSpec(name, kind, f"grid-{kind}-auto", "auto", exports)
        size, smallest = int(match[2]), 32 if kind == "spline" else 4
        largest = LARGEST.get(kind, LARGEST_DENSE)
        if not smallest <= size <= largest:
            raise ValueError(f"{name}: it has {smallest} to {largest} nodes per axis")
        return FieldSpec(name, kind, f"grid-{GRID_FIELDS[kind]}-{size}", size, exports)
    if name in recipes:
        return FieldSpec(name, "network", f"model-{name}", None, ("onnx",))
    known = ["exact", *(f"{kind}-64" for kind in GRID_FIELDS), *recipes]
    raise ValueError(f"'{name}' is no field; known are {', '.join(known)}")
