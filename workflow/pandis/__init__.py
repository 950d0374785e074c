"""Verified, reproducible force fields for haptic rendering, from any triangle mesh."""

from os import PathLike
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandis.runtime.field

__version__ = "0.1.0"


def load(path: str | PathLike[str]) -> "pandis.runtime.field.NativeField":
    """Return the field of a ``.pandis`` file: ``load("bunny.pandis").force(points, k=400)``.

    The C code is compiled on first use, with the system's compiler.

    Returns
    -------
    pandis.runtime.field.NativeField

    Raises
    ------
    pandis.base.errors.ArtifactError
        The file cannot be read, is damaged, or of another version.
    """
    from pandis.runtime.field import NativeField

    return NativeField(path)


def sample(shape: str, *sizes: float | int) -> "pandis.runtime.field.NativeField":
    """Return the field of a closed form, to try things on: ``sample("torus", 0.03, 0.01)``.

    See `pandis.runtime.samples.sample`.
    """
    from pandis.runtime import samples

    return samples.sample(shape, *sizes)
