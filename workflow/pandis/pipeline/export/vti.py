"""Writes and reads grids as VTK image data (``.vti``), for ParaView and 3D Slicer.

The format is VTK's XML (https://docs.vtk.org): ImageData with x varying fastest, and
appended raw data with 64-bit byte counts. Lengths are in mesh units; distances are
negative inside.
"""

import hashlib
import json
from xml.etree import ElementTree

import numpy as np

from pandis.base.errors import PandisError
from pandis.pipeline.kinds.axes import Axes
from pandis.pipeline.kinds.record import GridRecord
from pandis.pipeline.run.ask.catalogue import known_field
from pandis.pipeline.run.ask.kinds import kind_module

_MARK = b"<!-- sha256:"
_TYPES = {"Float32": np.dtype("<f4"), "UInt8": np.dtype("u1")}


def write_vti(origin, spacing, arrays, *, note=None):
    """Return image data as bytes.

    Parameters
    ----------
    origin : sequence of 3 float
        Position of the first node, mesh units.
    spacing : sequence of 3 float
    arrays : dict of str to ndarray, shape (x, y, z) or (x, y, z, 3)
        float32 or uint8.
    note : object
        Stored as JSON in a comment. The last comment is the SHA-256 of everything before it.
    """
    shape = next(iter(arrays.values())).shape[:3]
    extent = " ".join(f"0 {n - 1}" for n in shape)
    lines, blocks, offset = [], [], 0
    for name, array in arrays.items():
        kind = next(k for k, dtype in _TYPES.items() if dtype == array.dtype)
        data = np.ascontiguousarray(np.moveaxis(array, (0, 1, 2), (2, 1, 0))).tobytes()
        blocks += [np.uint64(len(data)).tobytes(), data]
        components = f' NumberOfComponents="{array.shape[3]}"' if array.ndim == 4 else ""
        lines.append(
            f'<DataArray type="{kind}" Name="{name}"{components} format="appended" '
            f'offset="{offset}"/>'
        )
        offset += 8 + len(data)
    where = " ".join(repr(float(x)) for x in origin)
    steps = " ".join(repr(float(x)) for x in spacing)
    # XML does not allow two dashes within a comment
    text = json.dumps(note, sort_keys=True).replace("--", "\\u002d\\u002d")
    head = (
        '<?xml version="1.0"?>\n'
        f"<!-- {text} -->\n"
        '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" '
        'header_type="UInt64">\n'
        f'<ImageData WholeExtent="{extent}" Origin="{where}" Spacing="{steps}">\n'
        f'<Piece Extent="{extent}"><PointData>\n' + "\n".join(lines) + "\n</PointData></Piece>\n"
        '</ImageData>\n<AppendedData encoding="raw">\n_'
    )
    data = head.encode() + b"".join(blocks) + b"\n</AppendedData>\n</VTKFile>\n"
    return data + _MARK + hashlib.sha256(data).hexdigest().encode() + b" -->\n"


def read_note(path):
    """Return the note of a ``.vti`` file, after verifying its checksum.

    Raises
    ------
    PandisError
        The file is damaged.
    """
    with open(path, "rb") as stream:
        data, mark, digest = stream.read().rpartition(_MARK)
    if not mark or digest != hashlib.sha256(data).hexdigest().encode() + b" -->\n":
        raise PandisError(f"{path}: truncated or damaged (its checksum does not match)")
    return json.loads(data[data.index(b"<!-- ") + 5 : data.index(b" -->")])


def read_vti(path):
    """Read a file that `write_vti` wrote.

    Returns
    -------
    origin : ndarray, shape (3,)
    spacing : ndarray, shape (3,)
    arrays : dict of str to ndarray, shape (x, y, z) or (x, y, z, components)

    Raises
    ------
    PandisError
        The file was not written by `write_vti`, or is truncated.
    """
    with open(path, "rb") as stream:
        data = stream.read()
    head, mark, rest = data.partition(b'<AppendedData encoding="raw">\n_')
    try:
        if not mark:
            raise ValueError("it has no appended raw data")
        root = ElementTree.fromstring(head + b"</VTKFile>")
        if root.get("byte_order") != "LittleEndian" or root.get("header_type") != "UInt64":
            raise ValueError("its byte order or header type is unexpected")
        image = root.find("ImageData")
        low = [int(n) for n in image.get("WholeExtent").split()]
        shape = [high - first + 1 for first, high in zip(low[::2], low[1::2], strict=True)]
        arrays = {}
        for entry in image.iter("DataArray"):
            dtype, start = _TYPES[entry.get("type")], int(entry.get("offset"))
            length = int(np.frombuffer(rest, np.uint64, 1, start)[0])
            parts = int(entry.get("NumberOfComponents", 1))
            flat = np.frombuffer(rest[start + 8 : start + 8 + length], dtype)
            block = flat.reshape(*shape[::-1], *([parts] if parts > 1 else []))
            arrays[entry.get("Name")] = np.moveaxis(block, (0, 1, 2), (2, 1, 0))
        origin, spacing = (np.array(image.get(k).split(), float) for k in ("Origin", "Spacing"))
    except (ElementTree.ParseError, ValueError, KeyError, AttributeError, IndexError) as error:
        raise PandisError(f"{path}: not a .vti file written by pandis: {error}") from error
    return origin, spacing, arrays


def export_vti(name, artifact, provenance):
    """Return a grid field, sampled at its own nodes, as VTK image data in mesh units.

    Parameters
    ----------
    name : str
    artifact : pandis.pipeline.run.job.artifact.Artifact
        Artifact of kind ``grid``.
    provenance : dict
        Stored in a comment.
    """
    spec = known_field(name)
    field = kind_module(spec.kind, "reference").open_field(spec, artifact)
    grid = GridRecord.of(artifact)
    # a spline has several lattices, so it is sampled on the cube
    axes = getattr(field, "axes", Axes.of_cube(grid.size))
    origin = field.frame.to_mesh(np.array(axes.low))
    note = {"field": name, "provenance": provenance}
    return write_vti(origin, axes.step / field.frame.scale, grid_arrays(field, axes), note=note)


def grid_arrays(field, axes):
    """Return a field's values at the nodes of a grid, for `write_vti`, in mesh units.

    Parameters
    ----------
    field : pandis.pipeline.kinds.field.Field
    axes : pandis.pipeline.kinds.axes.Axes

    Returns
    -------
    dict of str to ndarray
        ``distance`` (n, n, n) and ``normal`` (n, n, n, 3), float32; ``flag`` (n, n, n), uint8:
        0 where the field covers the node, 1 where the distance is an estimate beyond its band.
    """
    size = axes.size
    x_axis, *others = (np.linspace(low, high, size) for low, high in zip(*axes[1:], strict=True))
    arrays = {
        "distance": np.empty((size,) * 3, np.float32),
        "normal": np.empty((size,) * 3 + (3,), np.float32),
        "flag": np.empty((size,) * 3, np.uint8),
    }
    plane = np.stack(np.meshgrid(*others, indexing="ij"), axis=-1).reshape(-1, 2)
    for index, x in enumerate(x_axis):
        answer = field.query(np.column_stack([np.full(len(plane), x), plane]))
        arrays["distance"][index] = (answer.distance / field.frame.scale).reshape(size, size)
        arrays["normal"][index] = answer.normal.reshape(size, size, 3)
        arrays["flag"][index] = answer.flag.reshape(size, size)
    return arrays
