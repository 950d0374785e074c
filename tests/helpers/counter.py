"""A strict counter of mesh files, apart from the project, that its readers are held against.

It knows the formats' standards, the standard library and NumPy, and nothing else. What has
no bearing on triangles (materials, declared bounds, indices of textures) it leaves alone.
"""

import gzip
import zlib
from pathlib import Path

import numpy as np

from counting import gltf, ply, text, threemf
from counting.base import Counted, Refused

__all__ = ["ENDINGS", "Counted", "Refused", "count"]

_COUNTERS = {
    ".obj": lambda data, folder: text.obj(data),
    ".off": lambda data, folder: text.off(data),
    ".stl": lambda data, folder: text.stl(data),
    ".ply": lambda data, folder: ply.ply(data),
    ".glb": gltf.glb,
    ".gltf": gltf.gltf,
    ".3mf": lambda data, folder: threemf.threemf(data),
}
#: Endings that are counted; each also with ``.gz``.
ENDINGS = tuple(_COUNTERS)


def count(path):
    """Count the triangles of a mesh file as its format's standard reads it.

    Parameters
    ----------
    path : path-like
        Its ending says the format, in any case; ``.gz`` after it says that it is packed.

    Returns
    -------
    Counted

    Raises
    ------
    Refused
        Where the standard does not allow the file, or it has no triangle.
    """
    path = Path(path)
    data, name = path.read_bytes(), path.name.lower()
    if name.endswith(".gz"):
        name = name.removesuffix(".gz")
        try:
            data = gzip.decompress(data)
        except (OSError, EOFError, zlib.error) as error:
            raise Refused(f"no gzip: {error}") from None
    ending = Path(name).suffix
    if ending not in _COUNTERS:
        raise Refused(f"no format {ending!r}")
    # what overflows is refused as not finite, or is an open file's volume
    with np.errstate(all="ignore"):
        return _COUNTERS[ending](data, path.parent)
