"""Regions: the materials of a mesh file's faces, and their transfer to the repaired mesh.

OBJ, glTF and 3MF files name materials. Each face of the repaired mesh gets the material of the
nearest face in the file. For OBJ, PLY, STL and OFF files, an array beside the file may assign a
material to each face.
"""

import numpy as np

from pandis.base.errors import PandisError
from pandis.pipeline.mesh.tree import MeshTree
from pandis.pipeline.run.ask.sourcing import regions_file

#: Maximum number of regions in a mesh, because an index into them is stored in one byte.
MOST = 255
#: Formats whose readers preserve the order of a file's triangles.
IN_ORDER = "obj", "ply", "stl", "off"
#: Barycentric coordinates at which a face looks up its region: the centre, then near each corner.
_PLACES = np.array([[1, 1, 1], [4, 1, 1], [1, 4, 1], [1, 1, 4]]) / np.array([[3], [6], [6], [6]])


def named_in(reading, log):
    """Return the regions of a mesh as read, based on the materials named in its file.

    Parameters
    ----------
    reading : pandis.pipeline.mesh.formats.Reading
    log : pandis.base.progress.Log

    Returns
    -------
    region : ndarray, shape (F,)
        An index into the names.
    names : list of str
        Distinct, in alphabetical order.

    None if the file names fewer than two materials, or more than `MOST`.
    """
    if reading.materials is None:
        return None
    names, region = np.unique(reading.materials, return_inverse=True)
    if len(names) > MOST:
        log(f"the file names {len(names)} materials, too many for regions (at most {MOST})")
    if not 1 < len(names) <= MOST:
        return None
    return region.reshape(-1), [str(name) for name in names]


def read_beside(path, form, count):
    """Read the array, stored beside a mesh file, that names a material for each triangle.

    ``part.stl.regions.npy`` beside ``part.stl`` contains a number or a name for each triangle, in
    the file's order.

    Parameters
    ----------
    path : Path
        The mesh file.
    form : str
        A format of `pandis.pipeline.run.ask.sourcing.FORMATS`.
    count : int
        Number of triangles in the mesh.

    Returns
    -------
    region : ndarray, shape (count,)
        An index into the names.
    names : list of str

    None if there is no such file.

    Raises
    ------
    pandis.base.errors.PandisError
        The file is not such an array, or does not fit the mesh.
    """
    beside = regions_file(path)
    if not beside.is_file():
        return None
    if form not in IN_ORDER:
        raise PandisError(
            f"{beside}: the parts of a .{form} scene have no common order of triangles. "
            "Name the materials in the scene itself and remove this file"
        )
    try:
        whose = np.asarray(np.load(beside, allow_pickle=False))
    except (OSError, ValueError, EOFError) as error:
        raise PandisError(f"{beside}: not an array that NumPy can load ({error})") from None
    if whose.shape != (count,) or whose.dtype.kind not in "biuU":
        raise PandisError(
            f"{beside}: the array has shape {whose.shape} and type {whose.dtype}; the mesh has "
            f"{count:,} triangles: store as many integers or names, in the triangles' order"
        )
    names, region = np.unique(whose, return_inverse=True)
    if len(names) > MOST:
        raise PandisError(f"{beside}: {len(names)} regions; at most {MOST} are supported")
    return region, [str(name) for name in names]


def regions_after(mesh, regions, repaired, *, log):
    """Return the regions of a repaired mesh, from those of the mesh as read.

    Parameters
    ----------
    mesh : tuple of ndarray
        Vertices and faces as read.
    regions : tuple (region, names)
        Region of each face as read (an index into the names), and the names: see `named_in`.
    repaired : tuple of ndarray
        Vertices and faces of the repaired mesh.
    log : pandis.base.progress.Log

    Returns
    -------
    region, names
        As in `named_in`; None if only one region is left.
    """
    region, names = regions
    carried = carry(mesh, region, repaired)
    used, carried = np.unique(carried, return_inverse=True)
    if len(used) < 2:
        return None
    names = [names[i] for i in used]
    count = np.bincount(carried)
    counts = ", ".join(f"{name} ({n:,} faces)" for name, n in zip(names, count, strict=True))
    log(f"materials: {counts}")
    return carried.reshape(-1).astype(np.uint8), names


def carry(mesh, region, onto):
    """Return the region (F',) of each face of a mesh, taken from the nearest faces of another.

    Each face looks up the region at its centre and next to its corners. The majority decides, and
    the centre breaks ties.

    Parameters
    ----------
    mesh : tuple of ndarray
        Vertices and faces of the mesh whose regions are known.
    region : ndarray, shape (F,)
    onto : tuple of ndarray
        Vertices and faces of the mesh whose regions are returned.
    """
    corners = onto[0][onto[1]]
    points = np.einsum("ak,fkj->afj", _PLACES, corners).reshape(-1, 3)
    _, nearest = MeshTree(*mesh).closest(points)
    candidates = region[nearest].reshape(len(_PLACES), -1)
    # argmax returns the first of equal counts: the centre's region
    votes = (candidates[:, None] == candidates).sum(axis=1)
    return np.take_along_axis(candidates, votes.argmax(axis=0)[None], axis=0)[0].astype(np.uint8)
