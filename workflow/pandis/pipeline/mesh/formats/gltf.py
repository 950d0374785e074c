"""glTF 2.0, as GLB or as JSON with external or embedded buffers."""

import base64
import binascii
import json
import struct
from urllib.parse import unquote

import numpy as np

from pandis.pipeline.mesh.formats.base import AGAIN, MOST, FormatError, joined, placed

#: Supported extensions that affect triangles; then prefixes of extensions that do not.
_QUANTIZATION, _INSTANCING = "KHR_mesh_quantization", "EXT_mesh_gpu_instancing"
_HARMLESS = (
    "KHR_materials_", "KHR_texture_", "KHR_lights_punctual", "KHR_xmp", "KHR_animation_pointer",
    "EXT_texture_", "EXT_lights_", "MSFT_texture_", "MSFT_packing_", "KHR_node_visibility",
)  # fmt: skip
#: Extensions that compress triangles: the first in primitives, the others in buffer views.
_PACKINGS = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")
_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_UNSIGNED = (5121, 5123, 5125)
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
#: Limit on the deviation of a quaternion's length from 1, wide enough for quaternions stored as
#: bytes.
_COARSE = 0.05


def read(path, folder=None):
    """Read the default scene of a glTF file, with nodes, instances and morph weights applied.

    Parameters
    ----------
    path : Path
    folder : Path, optional
        Folder of the buffers that the file references; by default its own folder.

    Returns
    -------
    pandis.pipeline.mesh.formats.base.Reading
        In metres, as the standard requires.

    Raises
    ------
    pandis.pipeline.mesh.formats.base.FormatError
    """
    data = path.read_bytes()
    document, binary = _glb(data) if data[:4] == b"glTF" else (_json(data), None)
    try:
        scene = _Scene(document, binary, folder or path.parent)
        return joined(scene.parts(), scene.notes(), "m")
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        if isinstance(error, FormatError):
            raise
        reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise FormatError(f"its JSON is not a glTF scene ({reason[:100]}); {AGAIN}") from error


def _glb(data):
    if len(data) < 20:
        raise FormatError(f"a GLB of {len(data)} bytes is shorter than its header; {AGAIN}")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise FormatError(f"GLB version {version} is not supported; export it as glTF 2.0")
    if length > len(data):
        raise FormatError(
            f"its header declares {length:,} bytes, but the file has {len(data):,}; "
            f"it is truncated: {AGAIN}"
        )
    chunks, place = [], 12
    while place + 8 <= length:
        size, kind = struct.unpack_from("<I4s", data, place)
        if place + 8 + size > length:
            raise FormatError(f"one of its chunks is truncated; {AGAIN}")
        chunks.append((kind, data[place + 8 : place + 8 + size]))
        place += 8 + size
    if not chunks or chunks[0][0] != b"JSON":
        raise FormatError(f"its first chunk is not JSON; {AGAIN}")
    binary = chunks[1][1] if len(chunks) > 1 and chunks[1][0] == b"BIN\0" else None
    return _json(chunks[0][1]), binary


def _json(data):
    try:
        document = json.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise FormatError(f"its JSON is invalid ({error}); {AGAIN}") from None
    asset = document.get("asset") if isinstance(document, dict) else None
    if not isinstance(asset, dict) or not isinstance(asset.get("version"), str):
        raise FormatError(f"its JSON is not glTF; {AGAIN}")
    if asset["version"].split(".")[0] != "2":
        raise FormatError(
            f"glTF version {asset['version'][:20]} is not supported; export it as glTF 2.0"
        )
    return document


class _Scene:
    """A document with its buffers."""

    def __init__(self, document, binary, folder):
        self.document, self.binary, self.folder = document, binary, folder
        self._buffers, self._notes = {}, []
        required = document.get("extensionsRequired", [])
        for name in required:
            known = (_QUANTIZATION, _INSTANCING)
            if name not in known and not str(name).startswith(_HARMLESS):
                self._refuse(name)

    def _refuse(self, name):
        what = "its triangles are compressed with" if name in _PACKINGS else "it needs"
        raise FormatError(
            f"{what} {name}, which is not supported; export the scene again without it"
        )

    def notes(self):
        """Return the notes on omitted contents, without duplicates."""
        return list(dict.fromkeys(self._notes))

    def item(self, kind, index):
        """Return an entry of one of the document's lists."""
        entries = self.document.get(kind, [])
        if type(index) is not int or not 0 <= index < len(entries):
            raise FormatError(f"it uses {kind}[{index}], but there are {len(entries)}; {AGAIN}")
        return entries[index]

    # --- nodes ------------------------------------------------------------------------------

    def parts(self):
        """Return the parts (vertices, faces, material) of the scene."""
        pieces, total = [], 0
        for node, matrix in self._nodes():
            if "mesh" not in node:
                continue
            instances = self._instances(node)
            meshes = self._mesh(node)
            total += len(instances) * sum(len(faces) for _, faces, _ in meshes)
            if total > MOST:
                raise FormatError(f"it places more than {MOST:,} triangles: leave parts out")
            if "skin" in node:
                self._notes.append("skins are not applied: meshes are in their bind pose")
            for vertices, faces, material in meshes:
                pieces += [
                    (*placed(vertices, faces, matrix @ instance), material)
                    for instance in instances
                ]
        return pieces

    def _nodes(self):
        """Yield each node of the scene with its global matrix (4, 4)."""
        nodes = self.document.get("nodes", [])
        if len(self.document.get("scenes", [])) > 1:
            self._notes.append("it has several scenes; only the default one is read")
        children = {c for node in nodes for c in node.get("children", [])}
        if self.document.get("scenes"):
            roots = self.item("scenes", self.document.get("scene", 0)).get("nodes", [])
        else:
            roots = [index for index in range(len(nodes)) if index not in children]
        if nodes and not roots and not self.document.get("scenes"):
            raise FormatError(f"its nodes form a cycle; {AGAIN}")
        waiting = [(root, np.eye(4), ()) for root in reversed(roots)]
        seen = 0
        while waiting:
            index, above, path = waiting.pop()
            seen += 1
            if index in path or seen > 1_000_000:
                raise FormatError(f"its nodes form a cycle (nodes[{index}]); {AGAIN}")
            node = self.item("nodes", index)
            matrix = above @ _local(node)
            yield node, matrix
            below = reversed(node.get("children", []))
            waiting += [(child, matrix, (*path, index)) for child in below]

    def _instances(self, node):
        """Return the matrices (4, 4) of a node's instances; the identity if it declares none."""
        extension = node.get("extensions", {}).get(_INSTANCING)
        if extension is None:
            return [np.eye(4)]
        attributes = extension.get("attributes", {})
        known = [name for name in ("TRANSLATION", "ROTATION", "SCALE") if name in attributes]
        columns = {name: self.accessor(attributes[name]) for name in known}
        counts = {len(column) for column in columns.values()}
        if len(counts) != 1:
            raise FormatError(
                f"{_INSTANCING}: its attributes must have equal numbers of instances, not "
                f"{sorted(counts)}; {AGAIN}"
            )
        (count,) = counts
        defaults = {"TRANSLATION": (0, 0, 0), "ROTATION": (0, 0, 0, 1), "SCALE": (1, 1, 1)}
        rows = [columns.get(name, np.tile(value, (count, 1))) for name, value in defaults.items()]
        return [_matrix(*row) for row in zip(*rows, strict=True)]

    # --- meshes -----------------------------------------------------------------------------

    def _mesh(self, node):
        mesh = self.item("meshes", node["mesh"])
        weights = node.get("weights", mesh.get("weights"))
        return [part for primitive in mesh["primitives"]
                if (part := self._primitive(primitive, weights))]  # fmt: skip

    def _primitive(self, primitive, weights):
        """Return (vertices, faces, material) of a primitive; None for points and lines."""
        mode, attributes = primitive.get("mode", _TRIANGLES), primitive.get("attributes", {})
        if mode not in (_TRIANGLES, _STRIP, _FAN) or "POSITION" not in attributes:
            self._notes.append("points and lines are left out")
            return None
        accessor = self.item("accessors", attributes["POSITION"])
        packing = next((p for p in _PACKINGS if p in primitive.get("extensions", {})), None)
        if packing and "bufferView" not in accessor:
            self._refuse(packing)
        vertices = self.accessor(attributes["POSITION"])
        targets = primitive.get("targets", [])
        if weights is not None and len(weights) != len(targets):
            raise FormatError(f"{len(weights)} weights for {len(targets)} morph targets; {AGAIN}")
        for weight, target in zip(weights or (), targets, strict=False):
            if weight and "POSITION" in target:
                vertices = vertices + weight * self.accessor(target["POSITION"])
        if "indices" in primitive:
            corners = self._indices(primitive["indices"])
        else:
            corners = np.arange(len(vertices))
        if len(corners) and corners.max() >= len(vertices):
            raise FormatError(
                f"a face uses vertex {corners.max()}, but there are only {len(vertices):,}; {AGAIN}"
            )
        material = primitive.get("material")
        name = None if material is None else self.item("materials", material).get("name")
        return vertices, self._faces(corners, mode), name

    def _indices(self, index):
        """Return the values (count,) of an accessor that contains indices."""
        entry = self.item("accessors", index)
        unsigned = entry["componentType"] in _UNSIGNED and not entry.get("normalized", False)
        if not unsigned or entry["type"] != "SCALAR":
            raise FormatError(f"accessors[{index}] does not contain indices; {AGAIN}")
        return self.accessor(index)[:, 0].astype(np.int64)

    def _faces(self, corners, mode):
        if mode == _TRIANGLES:
            if len(corners) % 3:
                raise FormatError(f"{len(corners)} corners are not a multiple of three; {AGAIN}")
            return corners.reshape(-1, 3)
        if mode == _FAN:
            first = np.full(max(len(corners) - 2, 0), corners[0] if len(corners) else 0)
            return np.stack([corners[1:-1], corners[2:], first], axis=1)
        faces = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
        faces[1::2] = faces[1::2][:, [0, 2, 1]]
        return faces

    # --- numbers ----------------------------------------------------------------------------

    def accessor(self, index):
        """Return an accessor's values (count, width), float64, normalised if so declared."""
        entry = self.item("accessors", index)
        count, width = entry["count"], _WIDTHS[entry["type"]]
        kind = np.dtype(_TYPES[entry["componentType"]])
        where = f"accessors[{index}]"
        if type(count) is not int or not 0 <= count <= MOST:
            raise FormatError(f"{where}: invalid count {count}; {AGAIN}")
        values = np.zeros((count, width), kind)
        if "bufferView" in entry:
            offset = entry.get("byteOffset", 0)
            values = self._view(
                entry["bufferView"], offset, kind, width=width, count=count, where=where
            )
        if "sparse" in entry:
            values = self._sparse(entry["sparse"], values.copy(), where)
        if not np.isfinite(values).all():
            bad = int((~np.isfinite(values)).any(axis=1).sum())
            raise FormatError(f"{where}: {bad} of {count} values are NaN or infinite; {AGAIN}")
        values = values.astype(np.float64)
        if entry.get("normalized", False) and kind.kind in "iu":
            # the lowest signed integer would map to less than -1
            values = np.maximum(values / np.iinfo(kind).max, -1.0)
        return values

    def _sparse(self, sparse, values, where):
        places, news, few = sparse["indices"], sparse["values"], sparse["count"]
        if places["componentType"] not in _UNSIGNED:
            raise FormatError(f"{where}: its sparse indices are not unsigned integers; {AGAIN}")
        kind = np.dtype(_TYPES[places["componentType"]])
        at = self._view(
            places["bufferView"], places.get("byteOffset", 0), kind, width=1, count=few, where=where
        )
        at = at[:, 0].astype(np.int64)
        if len(at) and not 0 <= at.max() < len(values):
            raise FormatError(
                f"{where}: a sparse index is {at.max()}, but there are only {len(values):,} "
                f"values; {AGAIN}"
            )
        offset, width = news.get("byteOffset", 0), values.shape[1]
        values[at] = self._view(
            news["bufferView"], offset, values.dtype, width=width, count=few, where=where
        )
        return values

    def _view(self, index, start, kind, *, width, count, where):
        """Return values (count, width) of a buffer view."""
        view = self.item("bufferViews", index)
        packing = next((p for p in _PACKINGS if p in view.get("extensions", {})), None)
        data = self._buffer(view["buffer"], packing)
        offset, length = view.get("byteOffset", 0), view["byteLength"]
        size = kind.itemsize * width
        stride = view.get("byteStride", size)
        whole = all(type(n) is int and n >= 0 for n in (start, offset, length, stride, count))
        if not whole or stride < size or offset + length > len(data):
            raise FormatError(
                f"{where}: bufferViews[{index}] has {length} bytes from {offset} on, but its "
                f"buffer has {len(data):,}; it is truncated or damaged: {AGAIN}"
            )
        if count and start + stride * (count - 1) + size > length:
            raise FormatError(
                f"{where}: {count:,} values do not fit into the {length:,} bytes of "
                f"bufferViews[{index}]; {AGAIN}"
            )
        raw = np.frombuffer(data, np.uint8, length, offset)[start:]
        rows = np.lib.stride_tricks.as_strided(raw, (count, size), (stride, 1), writeable=False)
        return np.ascontiguousarray(rows).view(kind)

    def _buffer(self, index, packing):
        if index not in self._buffers:
            self._buffers[index] = self._load(self.item("buffers", index), index, packing)
        return self._buffers[index]

    def _load(self, buffer, index, packing):
        uri, length = buffer.get("uri"), buffer["byteLength"]
        if uri is None:
            data = self.binary if index == 0 else None
            if data is None and packing:
                self._refuse(packing)
            if data is None:
                raise FormatError(f"buffers[{index}] has no data; {AGAIN}")
            name = f"buffers[{index}]"
        elif uri.startswith("data:"):
            name = f"buffers[{index}]"
            try:
                data = base64.b64decode(unquote(uri.partition(",")[2]), validate=True)
            except (binascii.Error, ValueError):
                raise FormatError(f"{name} is not valid base64; {AGAIN}") from None
        else:
            name = unquote(uri)
            try:
                data = (self.folder / name).read_bytes()
            except (OSError, ValueError):
                short = name[:80]
                raise FormatError(
                    f"it needs {short}, which is missing; put {short} beside this file"
                ) from None
        if len(data) < length:
            raise FormatError(
                f"{name} is truncated: {len(data):,} bytes instead of the declared {length:,}; "
                f"{AGAIN}"
            )
        return data


def _local(node):
    """Return a node's local matrix (4, 4)."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    return _matrix(
        node.get("translation", (0, 0, 0)),
        node.get("rotation", (0, 0, 0, 1)),
        node.get("scale", (1, 1, 1)),
    )


def _matrix(move, turn, size):
    """Return the matrix (4, 4) of a translation, a quaternion (x, y, z, w), and a scale."""
    turn = np.asarray(turn, np.float64)
    length = np.linalg.norm(turn)
    if not abs(length - 1) < _COARSE:
        raise FormatError(f"a rotation quaternion has length {length:.3g}, not 1; {AGAIN}")
    x, y, z, w = turn / length
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]) * np.asarray(size, np.float64)  # fmt: skip
    matrix[:3, 3] = move
    return matrix
