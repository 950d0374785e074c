"""Which fields there are: what each is called, which artifact holds it, what it exports.

Ground floor: names only, no code that answers a query.
"""

import re
from typing import NamedTuple

MESH_NAME = "[a-z][a-z0-9_-]*"
#: Folders of ``results/`` that are not meshes.
RESERVED_NAMES = ("logs", "benchmarks", "scenes", "native")

#: Fields stored on a grid, and what their grid's nodes hold.
GRID_FIELDS = {"nearest": "force", "trilinear": "force", "trilinear-normal": "normal"}


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
    size : int or None
        Nodes per axis of a grid.
    exports : tuple of str
        Endings of its files under ``results/{mesh}/export/``.
    """

    name: str
    kind: str
    artifact: str
    size: int | None
    exports: tuple[str, ...]


def is_builtin_field(name):
    """Tell whether ``name`` is taken by a field that is not a recipe."""
    return name == "exact" or re.fullmatch(rf"({'|'.join(GRID_FIELDS)})-\d+", name) is not None


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
    if match := re.fullmatch(f"({'|'.join(GRID_FIELDS)})-([1-9][0-9]*)", name):
        kind, size = match[1], int(match[2])
        if not 2 <= size <= 512:
            raise ValueError(f"{name}: a grid has 2 to 512 nodes per axis")
        return FieldSpec(name, kind, f"grid-{GRID_FIELDS[kind]}-{size}", size, ("onnx",))
    if name in recipes:
        return FieldSpec(name, "network", f"model-{name}", None, ("onnx",))
    known = ["exact", *(f"{kind}-64" for kind in GRID_FIELDS), *recipes]
    raise ValueError(f"'{name}' is no field; known are {', '.join(known)}")
