"""Verified, reproducible force fields for haptic rendering, from any triangle mesh."""

from os import PathLike
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandis.native.runtime

__version__ = "0.1.0"


def load(path: str | PathLike[str]) -> "pandis.native.runtime.NativeField":
    """Return the field of a ``.pandis`` file: ``load("bunny.pandis").force(points, k=400)``.

    The C code is compiled on first use, with the system's compiler.

    Returns
    -------
    pandis.native.runtime.NativeField

    Raises
    ------
    pandis.errors.ArtifactError
        The file cannot be read, is damaged, or of another version.
    """
    from pandis.native.runtime import NativeField

    return NativeField(path)


def sample(shape: str, *sizes: float | int) -> "pandis.native.runtime.NativeField":
    """Return the field of a closed form, to try things on: ``sample("torus", 0.03, 0.01)``.

    See `pandis.native.samples.sample`.
    """
    from pandis.native import samples

    return samples.sample(shape, *sizes)
