"""Regions: which material a mesh file gives each of its faces, and how a repair keeps that.

OBJ, glTF and 3MF files name materials. They are read once more for them, apart from the reading of
the mesh itself: a face of the repaired mesh has the material of the face of the file that is
nearest to it.
"""

import igl
import numpy as np

from pandis.mesh import tools
from pandis.mesh.materials import names_several

#: A region is one byte.
MOST = 255
#: Where a face asks what it is made of: at its middle, and next to each corner.
_ASKED = np.array([[1, 1, 1], [4, 1, 1], [1, 4, 1], [1, 1, 4]]) / np.array([[3], [6], [6], [6]])


def regions_of(path, form, vertices, faces, log, **limits):
    """Return the regions of a repaired mesh, by the materials that its file names.

    Parameters
    ----------
    path : Path
        The file, not compressed.
    form : str
        Of `pandis.run.sourcing.FORMATS`.
    vertices, faces : ndarray
        The repaired mesh.
    log : callable
    **limits
        ``seconds`` and ``memory_gb`` of the reader.

    Returns
    -------
    region : ndarray, shape (F,), uint8
    names : list of str
        Of the regions that are there, in alphabetical order.

    None, where the file does not name several materials, or too many.
    """
    if not names_several(path, form):
        return None
    try:
        *mesh, region, names = read_regions(path, form, **limits)
    except tools.ToolError as error:
        log(f"the materials that it names are not known: {error}")
        return None
    if len(names) > MOST:
        log(f"it names {len(names)} materials; regions are kept of {MOST} at most")
        return None
    carried = carry(*mesh, region, vertices, faces)
    used, carried = np.unique(carried, return_inverse=True)
    if len(used) < 2:
        return None
    names = [names[i] for i in used]
    count = np.bincount(carried)
    told = ", ".join(f"{name} ({n:,} faces)" for name, n in zip(names, count, strict=True))
    log(f"materials: {told}")
    return carried.reshape(-1).astype(np.uint8), names


def read_regions(path, form, **limits):
    """Read which material each face of a file has.

    Parameters
    ----------
    path, form, limits
        As of `regions_of`.

    Returns
    -------
    vertices, faces : ndarray
    region : ndarray, shape (F,)
        An index into the names.
    names : list of str
        Each once, in alphabetical order.

    Raises
    ------
    pandis.mesh.tools.ToolError
        The file cannot be read so.
    """
    vertices, faces, names = tools.call("read_materials", path=str(path), form=form, **limits)
    found, region = np.unique(names, return_inverse=True)
    return vertices, faces, region.reshape(-1), [str(name) for name in found]


def carry(vertices, faces, region, onto, onto_faces):
    """Return the region (F',) of each face of a mesh, by the nearest faces of another.

    Each face asks at its middle and next to its corners; most of the answers count, with a tie that
    of the middle.

    Parameters
    ----------
    vertices, faces, region
        The mesh whose regions are known.
    onto, onto_faces : ndarray
        Vertices and faces of the other one.
    """
    vertices, faces = np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(faces)
    tree = igl.AABB()
    tree.init(vertices, faces.astype(np.int64))
    points = np.einsum("ak,fkj->afj", _ASKED, onto[onto_faces]).reshape(-1, 3)
    _, nearest, _ = tree.squared_distance(vertices, faces.astype(np.int64), points)
    said = region[nearest].reshape(len(_ASKED), -1)
    votes = (said[:, None] == said).sum(axis=1)  # argmax takes the first of equals: the middle
    return np.take_along_axis(said, votes.argmax(axis=0)[None], axis=0)[0].astype(np.uint8)
