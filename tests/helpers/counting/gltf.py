"""Counter of glTF 2.0, as GLB and as JSON with buffers beside it or within.

Checked is what bears on geometry. Not looked at: minima and maxima of accessors, materials,
animations. A skin is not applied: its mesh is counted as if the node had none.
"""

import base64
import binascii
import json
import struct
from urllib.parse import unquote

import numpy as np

from counting.base import Refused, Tally

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_UNSIGNED = (5121, 5123, 5125)
_QUANTIZATION, _INSTANCING = "KHR_mesh_quantization", "EXT_mesh_gpu_instancing"
_KNOWN = (_QUANTIZATION, _INSTANCING, "KHR_texture_transform", "KHR_lights_punctual")
_DRACO = "KHR_draco_mesh_compression"
#: How far a quaternion's length may be from one: those of bytes are as coarse.
_UNIT = 0.02


def _unique(pairs):
    found = dict(pairs)
    if len(found) < len(pairs):
        raise Refused("a JSON object names one thing twice")
    return found


def _constant(word):
    raise Refused(f"{word} in the JSON")


def _json(data):
    try:
        document = json.loads(
            data.decode("utf-8"), object_pairs_hook=_unique, parse_constant=_constant
        )
    except (ValueError, RecursionError) as error:
        raise Refused(f"no JSON: {error}") from None
    if not isinstance(document, dict):
        raise Refused("the JSON is no object")
    return document


def glb(data, folder):
    """Count a GLB: its header, the JSON, the binary chunk, and chunks that nobody knows."""
    if len(data) < 20 or data[:4] != b"glTF":
        raise Refused("no header of GLB")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2 or length != len(data):
        raise Refused(f"GLB of version {version}, {length} bytes declared, {len(data)} there")
    chunks, place = [], 12
    while place < length:
        if place + 8 > length:
            raise Refused("the header of a chunk is cut")
        size, kind = struct.unpack_from("<I4s", data, place)
        place += 8 + size
        if size % 4 or place > length:
            raise Refused(f"a chunk of {size} bytes")
        chunks.append((kind, data[place - size : place]))
    if chunks[0][0] != b"JSON":
        raise Refused("the first chunk is not JSON")
    binary = chunks[1][1] if len(chunks) > 1 and chunks[1][0] == b"BIN\0" else None
    if b"JSON" in [kind for kind, _ in chunks[1:]] or b"BIN\0" in [kind for kind, _ in chunks[2:]]:
        raise Refused("a chunk out of its place")
    return _Document(_json(chunks[0][1]), folder, binary).counted()


def gltf(data, folder):
    """Count a glTF as JSON."""
    return _Document(_json(data), folder, None).counted()


class _Document:
    """A glTF: its JSON, where its files lie, and the binary chunk of a GLB."""

    def __init__(self, document, folder, binary):
        self.json, self.folder, self.binary, self.loaded = document, folder, binary, {}
        version = _get(document, "asset", dict, {}).get("version")
        if not isinstance(version, str) or version.split(".")[0] != "2":
            raise Refused(f"glTF of version {version!r}")
        self.used = _get(document, "extensionsUsed", list, [])
        for name in _get(document, "extensionsRequired", list, []):
            if name not in _KNOWN and not str(name).startswith("KHR_materials_"):
                raise Refused(f"it requires {name}")
            if name not in self.used:
                raise Refused(f"it requires {name} without using it")

    def item(self, kind, index):
        """Return an entry of one of the document's lists."""
        entries = _get(self.json, kind, list, [])
        if type(index) is not int or not 0 <= index < len(entries):
            raise Refused(f"no {kind}[{index}]")
        if not isinstance(entries[index], dict):
            raise Refused(f"{kind}[{index}] is no object")
        return entries[index]

    def extension(self, holder, name):
        """Return an extension's object, or None."""
        found = _get(holder, "extensions", dict, {}).get(name)
        if found is not None and (name not in self.used or not isinstance(found, dict)):
            raise Refused(f"{name} is used and not declared, or is no object")
        return found

    # buffers and accessors

    def buffer(self, index):
        """Return a buffer's bytes, of the declared length at least."""
        entry = self.item("buffers", index)
        if index in self.loaded:
            return self.loaded[index]
        uri, length = _get(entry, "uri", str), _whole(entry, "byteLength", least=1)
        if uri is None:
            if index or self.binary is None:
                raise Refused(f"buffers[{index}] has no data")
            data = self.binary
        elif uri.startswith("data:"):
            head, _, body = uri.partition(",")
            if not head.endswith(";base64"):
                raise Refused("a data URI that is not base64")
            try:
                data = base64.b64decode(unquote(body), validate=True)
            except (binascii.Error, ValueError):
                raise Refused("a data URI that is no base64") from None
        else:
            name = unquote(uri)
            if ":" in name.split("/")[0] or name.startswith("/"):
                raise Refused(f"{name} is not beside the file")
            try:
                data = (self.folder / name).read_bytes()
            except (OSError, ValueError):
                raise Refused(f"{name} is not there") from None
        if len(data) < length:
            raise Refused(f"buffers[{index}]: {length} bytes declared, {len(data)} there")
        self.loaded[index] = data[:length]
        return self.loaded[index]

    def view(self, index, start, kind, width, count, attribute=False):
        """Return values (count, width) from a buffer view."""
        view, item = self.item("bufferViews", index), np.dtype(kind).itemsize
        if any("meshopt" in name for name in _get(view, "extensions", dict, {})):
            base = self.item("buffers", view.get("buffer"))
            if "uri" not in base and self.binary is None:
                raise Refused("EXT_meshopt_compression without what else to read")
        data = self.buffer(view.get("buffer"))
        offset, length = _whole(view, "byteOffset", 0), _whole(view, "byteLength", least=1)
        stride = _whole(view, "byteStride", item * width)
        if "byteStride" in view and not (4 <= stride <= 252 and stride % 4 == 0):
            raise Refused(f"bufferViews[{index}]: a stride of {stride}")
        if stride < item * width or (offset + start) % item or start % item:
            raise Refused(f"bufferViews[{index}]: a stride of {stride}, an offset of {start}")
        if attribute and (stride % 4 or start % 4):
            raise Refused(f"bufferViews[{index}]: vertices that are not aligned to four bytes")
        if offset + length > len(data) or start + stride * (count - 1) + item * width > length:
            raise Refused(f"bufferViews[{index}] is too short for {count} elements")
        raw = np.frombuffer(data, np.uint8, length, offset)[start:]
        rows = np.lib.stride_tricks.as_strided(raw, (count, item * width), (stride, 1))
        return np.ascontiguousarray(rows).view(kind)

    def accessor(self, index, shape, allowed, attribute=False):
        """Return an accessor's values (count, width), floats if they are normalised.

        Parameters
        ----------
        index : int
        shape : str
            The type that it must have.
        allowed : callable
            Says whether a component type, and being normalised, is allowed.
        attribute : bool
            Whether it is of vertices, which are aligned.
        """
        entry = self.item("accessors", index)
        component, normalized = entry.get("componentType"), entry.get("normalized", False)
        if entry.get("type") != shape or type(component) is not int:
            raise Refused(f"accessors[{index}] is no {shape}")
        if component not in _TYPES or type(normalized) is not bool:
            raise Refused(f"accessors[{index}] of components {component}, {normalized}")
        if not allowed(component, normalized):
            raise Refused(f"accessors[{index}] of {component}, normalized {normalized}")
        count, kind, width = _whole(entry, "count", least=1), _TYPES[component], _WIDTHS[shape]
        start = _whole(entry, "byteOffset", 0)
        if "bufferView" in entry:
            values = self.view(entry["bufferView"], start, kind, width, count, attribute)
        elif "byteOffset" in entry or count > 1 << 24:
            raise Refused(f"accessors[{index}] has an offset into nothing, or is too large")
        else:
            values = np.zeros((count, width), kind)
        sparse = _get(entry, "sparse", dict)
        if sparse is not None:
            values = values.copy()
            few = _whole(sparse, "count", least=1)
            places, news = _get(sparse, "indices", dict, {}), _get(sparse, "values", dict, {})
            if places.get("componentType") not in _UNSIGNED:
                raise Refused(f"accessors[{index}]: sparse indices of no unsigned type")
            at = self.view(
                places.get("bufferView"), _whole(places, "byteOffset", 0),
                _TYPES[places["componentType"]], 1, few,
            )[:, 0].astype(np.int64)  # fmt: skip
            if at[-1] >= count or (np.diff(at) <= 0).any():
                raise Refused(f"accessors[{index}]: sparse indices do not grow, or are too large")
            values[at] = self.view(
                news.get("bufferView"), _whole(news, "byteOffset", 0), kind, width, few
            )
        if not np.isfinite(values).all():
            raise Refused(f"accessors[{index}] is not finite")
        if not normalized:
            return values
        most = np.iinfo(values.dtype).max
        # the lowest signed integer is −1 too
        return np.maximum(values.astype(float) / most, -1.0)

    # meshes

    def positions(self, index, target=False):
        """Return the positions of a primitive, or how a morph target moves them."""

        def allowed(component, normalized):
            if component == 5126:
                return not normalized
            whole = (5120, 5122) if target else (5120, 5121, 5122, 5123)
            return _QUANTIZATION in self.used and component in whole

        return self.accessor(index, "VEC3", allowed, attribute=True).astype(float)

    def primitive(self, primitive, weights):
        """Return points and triangles, or None where a primitive has none."""
        mode = primitive.get("mode", 4)
        if type(mode) is not int or not 0 <= mode <= 6:
            raise Refused(f"a primitive of mode {mode}")
        attributes = _get(primitive, "attributes", dict, {})
        index = attributes.get("POSITION")
        draco = self.extension(primitive, _DRACO)
        if draco and "bufferView" not in self.item("accessors", index):
            raise Refused(f"{_DRACO} without what else to read")
        targets = _get(primitive, "targets", list, [])
        if weights is not None and len(weights) != len(targets):
            raise Refused(f"{len(weights)} weights of {len(targets)} morph targets")
        if mode < 4 or index is None:
            return None
        points = self.positions(index)
        for weight, target in zip(weights or [0.0] * len(targets), targets, strict=True):
            if not isinstance(target, dict):
                raise Refused("a morph target that is no object")
            if "POSITION" in target:
                moves = self.positions(target["POSITION"], target=True)
                if len(moves) != len(points):
                    raise Refused("a morph target of another length")
                points = points + weight * moves
        if "indices" in primitive:
            corners = self.accessor(
                primitive["indices"], "SCALAR", lambda kind, norm: kind in _UNSIGNED and not norm
            )[:, 0].astype(np.int64)
            if corners.max() >= len(points):
                raise Refused(f"no vertex {corners.max()}, there are {len(points)}")
        else:
            corners = np.arange(len(points))
        if len(corners) < 3 or (mode == 4 and len(corners) % 3):
            raise Refused(f"{len(corners)} corners in mode {mode}")
        if mode == 4:
            return points, corners.reshape(-1, 3)
        if mode == 5:
            faces = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
            faces[1::2] = faces[1::2][:, [0, 2, 1]]
            return points, faces
        first = np.full(len(corners) - 2, corners[0])
        return points, np.stack([corners[1:-1], corners[2:], first], axis=1)

    def mesh(self, index, node):
        """Return the parts (points, triangles) of a node's mesh, morphed."""
        mesh = self.item("meshes", index)
        weights = _floats(node, "weights") or _floats(mesh, "weights")
        primitives = _get(mesh, "primitives", list, [])
        if not primitives or not all(isinstance(each, dict) for each in primitives):
            raise Refused(f"meshes[{index}] without primitives")
        parts = [self.primitive(primitive, weights) for primitive in primitives]
        return [part for part in parts if part is not None]

    # nodes

    def instances(self, node):
        """Return the matrices of a node's instances: of one that has none, the identity."""
        found = self.extension(node, _INSTANCING)
        if found is None:
            return [np.eye(4)]
        attributes = _get(found, "attributes", dict, {})
        counts = {_whole(self.item("accessors", index), "count") for index in attributes.values()}
        if len(counts) != 1:
            raise Refused(f"{_INSTANCING} of {sorted(counts)} instances")

        def read(name, shape, allowed, default):
            if name not in attributes:
                return np.tile(default, (min(counts), 1))
            return self.accessor(attributes[name], shape, allowed).astype(float)

        moves = read("TRANSLATION", "VEC3", lambda kind, _: kind == 5126, (0.0, 0, 0))
        sizes = read("SCALE", "VEC3", lambda kind, _: kind == 5126, (1.0, 1, 1))
        turns = read(
            "ROTATION", "VEC4",
            lambda kind, norm: norm if kind in (5120, 5122) else kind == 5126, (0.0, 0, 0, 1),
        )  # fmt: skip
        return [_placed(*each) for each in zip(moves, turns, sizes, strict=True)]

    def forest(self):
        """Return each node's parent, having refused two parents and cycles."""
        nodes = _get(self.json, "nodes", list, [])
        parents = {}
        for at in range(len(nodes)):
            for child in _get(self.item("nodes", at), "children", list, []):
                self.item("nodes", child)
                if child in parents:
                    raise Refused(f"nodes[{child}] has two parents")
                parents[child] = at
        for at in range(len(nodes)):
            above, steps = at, 0
            while above in parents:
                above, steps = parents[above], steps + 1
                if steps > len(nodes):
                    raise Refused(f"nodes[{at}] is in a cycle")
        return parents

    def counted(self):
        """Count the scene that is shown: the first, where the file names none.

        A file without scenes is a library: its nodes are counted.
        """
        parents = self.forest()
        if "scene" in self.json or _get(self.json, "scenes", list, []):
            scene = self.item("scenes", self.json.get("scene", 0))
            roots = _get(scene, "nodes", list, [])
            if len(set(map(str, roots))) < len(roots):
                raise Refused("a scene names a node twice")
            for root in roots:
                self.item("nodes", root)
                if root in parents:
                    raise Refused(f"nodes[{root}] of the scene is no root")
        else:
            roots = [at for at in range(len(self.json.get("nodes", []))) if at not in parents]
        tally, places = Tally(), 0
        waiting = [(root, np.eye(4)) for root in roots]
        while waiting:
            at, above = waiting.pop()
            node = self.item("nodes", at)
            here = above @ _local(node, at)
            waiting += [(child, here) for child in node.get("children", [])]
            if "mesh" not in node:
                continue
            parts = self.mesh(node["mesh"], node)
            for instance in self.instances(node):
                matrix = here @ instance
                # what is mirrored is turned inside out again
                mirrored = np.linalg.det(matrix[:3, :3]) < 0
                for points, faces in parts:
                    moved = points @ matrix[:3, :3].T + matrix[:3, 3]
                    tally.add(moved, faces[:, ::-1] if mirrored else faces)
                places += bool(parts)
        return tally.counted()._replace(instances=places)


def _get(holder, name, kind, default=None):
    """Return a value of a JSON object, of one type."""
    found = holder.get(name, default)
    if found is not default and not isinstance(found, kind):
        raise Refused(f"{name} is no {kind.__name__}")
    return found


def _whole(holder, name, default=None, least=0):
    """Return an integer that is not too small."""
    value = holder.get(name, default)
    if type(value) is not int or not least <= value < 1 << 53:
        raise Refused(f"{name} of {value}")
    return value


def _floats(holder, name, count=None):
    """Return a list of numbers, or None."""
    values = holder.get(name)
    if values is None:
        return None
    if not isinstance(values, list) or (len(values) != count if count else not values):
        raise Refused(f"{name} is no list of its length")
    if not all(type(value) in (int, float) and abs(value) < 1e300 for value in values):
        raise Refused(f"{name} holds what is no number")
    return [float(value) for value in values]


def _local(node, at):
    """Return a node's own matrix (4, 4)."""
    matrix = _floats(node, "matrix", 16)
    move, turn = _floats(node, "translation", 3), _floats(node, "rotation", 4)
    size = _floats(node, "scale", 3)
    if matrix is None:
        return _placed(move or (0, 0, 0), turn or (0, 0, 0, 1), size or (1, 1, 1))
    if move or turn or size:
        raise Refused(f"nodes[{at}] has a matrix, and more beside it")
    matrix = np.array(matrix).reshape(4, 4).T
    if not np.array_equal(matrix[3], (0, 0, 0, 1)):
        raise Refused(f"nodes[{at}] has a matrix that is not affine")
    return matrix


def _placed(move, turn, size):
    """Return the matrix of a translation, a unit quaternion (x, y, z, w), and a scale."""
    length = float(np.linalg.norm(turn))
    if abs(length - 1) > _UNIT:
        raise Refused(f"a rotation of length {length:g}")
    x, y, z, w = np.asarray(turn, float) / length
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= np.asarray(size, float)
    matrix[:3, 3] = move
    return matrix
