"""Regions: which material a mesh file gives each of its faces, and how a repair keeps that.

OBJ, glTF and 3MF files name materials: a face of the repaired mesh has the material of the face of
the file that is nearest to it. Beside a mesh of any other format, an array may say it, face by
face.
"""

import igl
import numpy as np

from pandis.base.errors import PandisError
from pandis.pipeline.run.ask.sourcing import regions_file

#: A region is one byte.
MOST = 255
#: Formats whose readers keep the order of a file's triangles.
IN_ORDER = "obj", "ply", "stl", "off"
#: Where a face asks what it is made of: at its middle, and next to each corner.
_PLACES = np.array([[1, 1, 1], [4, 1, 1], [1, 4, 1], [1, 1, 4]]) / np.array([[3], [6], [6], [6]])


def named_in(reading, log):
    """Return the regions of a mesh as it was read, by the materials that its file names.

    Parameters
    ----------
    reading : pandis.pipeline.mesh.formats.Reading
    log : callable

    Returns
    -------
    region : ndarray, shape (F,)
        An index into the names.
    names : list of str
        Each once, in alphabetical order.

    None, where the file does not name several materials, or too many.
    """
    if reading.materials is None:
        return None
    names, region = np.unique(reading.materials, return_inverse=True)
    if len(names) > MOST:
        log(f"it names {len(names)} materials; regions are kept of {MOST} at most")
    if not 1 < len(names) <= MOST:
        return None
    return region.reshape(-1), [str(name) for name in names]


def read_beside(path, form, count):
    """Read the array beside a mesh file that says what each of its triangles is made of.

    ``part.stl.regions.npy`` beside ``part.stl`` holds, for each triangle in the order of the file,
    a number or a name.

    Parameters
    ----------
    path : Path
        The mesh's file.
    form : str
        A format of `pandis.pipeline.run.ask.sourcing.FORMATS`.
    count : int
        Triangles that were read.

    Returns
    -------
    region : ndarray, shape (count,)
        An index into the names.
    names : list of str

    None, where there is no such file.

    Raises
    ------
    pandis.base.errors.PandisError
        It is no such array, or of another mesh.
    """
    beside = regions_file(path)
    if not beside.is_file():
        return None
    if form not in IN_ORDER:
        raise PandisError(
            f"{beside}: the parts of a .{form} scene have no common order of triangles; name "
            "materials in the scene itself, and remove this file"
        )
    try:
        whose = np.asarray(np.load(beside, allow_pickle=False))
    except (OSError, ValueError, EOFError) as error:
        raise PandisError(f"{beside}: not an array that NumPy can load ({error})") from None
    if whose.shape != (count,) or whose.dtype.kind not in "biuU":
        raise PandisError(
            f"{beside}: an array of shape {whose.shape} and type {whose.dtype}; the mesh has "
            f"{count:,} triangles: give as many whole numbers or names, in their order"
        )
    names, region = np.unique(whose, return_inverse=True)
    if len(names) > MOST:
        raise PandisError(f"{beside}: {len(names)} regions; at most {MOST} are possible")
    return region, [str(name) for name in names]


def regions_after(mesh, region, names, vertices, faces, log):
    """Return the regions of a repaired mesh, by those of the mesh that was read.

    Parameters
    ----------
    mesh : tuple of ndarray
        Vertices and faces as they were read.
    region : ndarray, shape (F,)
        Region of these faces, an index into the names.
    names : list of str
    vertices, faces : ndarray
        The repaired mesh.
    log : callable

    Returns
    -------
    region, names
        As of `named_in`; None where one is left.
    """
    carried = carry(*mesh, region, vertices, faces)
    used, carried = np.unique(carried, return_inverse=True)
    if len(used) < 2:
        return None
    names = [names[i] for i in used]
    count = np.bincount(carried)
    counts = ", ".join(f"{name} ({n:,} faces)" for name, n in zip(names, count, strict=True))
    log(f"materials: {counts}")
    return carried.reshape(-1).astype(np.uint8), names


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
    points = np.einsum("ak,fkj->afj", _PLACES, onto[onto_faces]).reshape(-1, 3)
    _, nearest, _ = tree.squared_distance(vertices, faces.astype(np.int64), points)
    candidates = region[nearest].reshape(len(_PLACES), -1)
    votes = (candidates[:, None] == candidates).sum(
        axis=1
    )  # argmax takes the first of equals: the middle
    return np.take_along_axis(candidates, votes.argmax(axis=0)[None], axis=0)[0].astype(np.uint8)
