"""Cases of glTF, and its writer."""

import base64
import copy
import json
import struct

import numpy as np

from casework import base
from casework.base import Refuses, box, reads_box

_COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
_SHAPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
_INSTANCING = "EXT_mesh_gpu_instancing"


class Scene:
    """A glTF that grows: its JSON, and the bytes of its one buffer."""

    def __init__(self, nodes=None):
        self.blob = b""
        self.json = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
            "nodes": nodes or [{"mesh": 0}], "meshes": [], "accessors": [], "bufferViews": [],
            "buffers": [],
        }  # fmt: skip

    def view(self, data, **more):
        """Append bytes, and return the view's index."""
        self.blob += bytes(-len(self.blob) % 4)
        entry = {"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(data), **more}
        self.json["bufferViews"].append(entry)
        self.blob += data
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values, kind="f4", stride=None, **more):
        """Append an array, each row padded to a stride, and return the accessor's index."""
        values = np.asarray(values).astype("<" + kind)
        values = values.reshape(len(values), -1)
        rows = values.view(np.uint8).reshape(len(values), -1)
        apart = {}
        if stride:
            rows = np.pad(rows, ((0, 0), (0, stride - rows.shape[1])), constant_values=77)
            apart = {"byteStride": stride}
        entry = {
            "bufferView": self.view(rows.tobytes(), **apart), "componentType": _COMPONENTS[kind],
            "count": len(values), "type": _SHAPES[values.shape[1]], **more,
        }  # fmt: skip
        if values.shape[1] == 3:
            entry |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        self.json["accessors"].append(entry)
        return len(self.json["accessors"]) - 1

    def mesh(self, points, faces, kind="f4", stride=None, indices="u2", mode=None, **more):
        """Append a mesh of one primitive, and return the primitive."""
        primitive = {"attributes": {"POSITION": self.accessor(points, kind, stride, **more)}}
        if faces is not None:
            primitive["indices"] = self.accessor(np.ravel(faces), indices)
        if mode is not None:
            primitive["mode"] = mode
        self.json["meshes"].append({"primitives": [primitive]})
        return primitive

    def uses(self, *names, required=True):
        """Declare extensions."""
        self.json["extensionsUsed"] = list(names)
        if required:
            self.json["extensionsRequired"] = list(names)

    def text(self, **buffer):
        """Return the JSON with one buffer."""
        whole = copy.deepcopy(self.json)
        whole["buffers"].insert(0, {"byteLength": len(self.blob), **buffer})
        return json.dumps(whole).encode()

    def glb(self):
        """Return a GLB."""
        text, blob = self.text(), self.blob
        text += b" " * (-len(text) % 4)
        blob += bytes(-len(blob) % 4)
        body = struct.pack("<I4s", len(text), b"JSON") + text
        body += struct.pack("<I4s", len(blob), b"BIN\0") + blob
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body

    def embedded(self):
        """Return a glTF that holds its buffer."""
        body = base64.b64encode(self.blob).decode()
        return self.text(uri=f"data:application/octet-stream;base64,{body}")


def _boxed(low=base.LOW, high=base.HIGH, nodes=None, **more):
    """Return a scene of one box."""
    scene = Scene(nodes)
    scene.mesh(*box(low, high), **more)
    return scene


def _files():
    """Where a glTF's bytes lie, and where they do not."""
    scene, whole = _boxed(), reads_box()
    glb, blob = scene.glb(), scene.blob
    yield "glb-box", {"a.glb": glb}, whole
    yield "glb-packed", {"a.glb.gz": base.packed(glb)}, whole
    yield "glb-packed-cut", {"a.glb.gz": base.packed(glb)[:-30]}, Refuses()
    yield "gltf-embedded", {"a.gltf": scene.embedded()}, whole
    beside = scene.text(uri="part.bin")
    yield "gltf-beside", {"a.gltf": beside, "part.bin": blob}, whole
    yield "gltf-beside-packed", {"a.gltf.gz": base.packed(beside), "part.bin": blob}, whole
    below = scene.text(uri="sub/my%20part.bin")
    yield "gltf-beside-escaped", {"a.gltf": below, "sub/my part.bin": blob}, whole
    yield "gltf-missing", {"a.gltf": beside}, Refuses(("part.bin",))
    yield "gltf-missing-packed", {"a.gltf.gz": base.packed(beside)}, Refuses(("part.bin",))
    short = {"a.gltf": beside, "part.bin": blob[:-20]}
    yield "gltf-short", short, Refuses(("part.bin", str(len(blob)), str(len(blob) - 20)))
    yield "gltf-no-uri", {"a.gltf": scene.text()}, Refuses()
    yield "gltf-far", {"a.gltf": scene.text(uri="https://example.org/part.bin")}, Refuses()
    other = _boxed()
    other.json["buffers"].append({"byteLength": 9, "uri": "sound.bin"})
    yield "gltf-missing-unused", {"a.gltf": other.embedded()}, whole, Refuses(("sound.bin",))
    yield "glb-cut", {"a.glb": glb[:-40]}, Refuses()
    yield "glb-trailing", {"a.glb": glb + b"more"}, Refuses(), whole
    yield "glb-version-1", {"a.glb": glb[:4] + b"\1\0\0\0" + glb[8:]}, Refuses(("1",))
    short = Scene()
    short.mesh(*box())
    short.json["accessors"][0]["count"] = 900
    yield "glb-accessor-too-long", {"a.glb": short.glb()}, Refuses()
    far = Scene()
    far.mesh(box()[0], [*box()[1][:-1], (3, 7, 8)])
    yield "glb-index-beyond", {"a.glb": far.glb()}, Refuses(("8",))
    bad = Scene()
    points = box()[0].copy()
    bad.mesh(points, box()[1])
    bad.blob = bad.blob[:16] + np.float32(np.nan).tobytes() + bad.blob[20:]
    yield "glb-nan", {"a.glb": bad.glb()}, Refuses()
    yield "gltf-json-cut", {"a.gltf": scene.embedded()[:-60]}, Refuses()


def _accessors():
    """Sparse, quantised and interleaved positions; strips and fans."""
    points, faces = box()
    whole = reads_box()
    scene = Scene()
    moved = points.copy()
    moved[[1, 6]] = (0, 0, 0)
    scene.mesh(moved, faces)
    few, news = np.array([1, 6], "<u2"), points[[1, 6]].astype("<f4")
    scene.json["accessors"][0]["sparse"] = sparse = {
        "count": 2, "indices": {"bufferView": scene.view(few.tobytes()), "componentType": 5123},
        "values": {"bufferView": scene.view(news.tobytes())},
    }  # fmt: skip
    yield "glb-sparse", {"a.glb": scene.glb()}, whole
    sparse["indices"]["bufferView"] = scene.view(few[::-1].tobytes())
    sparse["values"]["bufferView"] = scene.view(news[::-1].tobytes())
    yield "glb-sparse-falling", {"a.glb": scene.glb()}, Refuses(), whole
    sparse["indices"]["bufferView"] = scene.view(np.array([1, 8], "<u2").tobytes())
    yield "glb-sparse-beyond", {"a.glb": scene.glb()}, Refuses()
    scene, unit = Scene(), box((0.0, 0, 0), (1.0, 2, 3))
    scene.mesh(*unit)
    del scene.json["accessors"][0]["bufferView"]
    scene.json["accessors"][0]["sparse"] = {
        "count": 7,
        "indices": {"bufferView": scene.view(bytes(range(1, 8))), "componentType": 5121},
        "values": {"bufferView": scene.view(unit[0][1:].astype("<f4").tobytes())},
    }
    yield "glb-sparse-alone", {"a.glb": scene.glb()}, reads_box((0, 0, 0), (1, 2, 3))
    for kind, low, high in (
        ("i1", (-10, -20, -30), (10, 20, 31)), ("u1", (10, 20, 30), (20, 40, 250)),
        ("i2", (-1000, -2000, -30000), (1000, 2000, 30001)),
        ("u2", (1000, 2000, 3000), (2000, 4000, 60000)),
    ):  # fmt: skip
        stride = 4 if kind.endswith("1") else 8
        for normalized in (False, True):
            size = float(np.iinfo(kind).max) if normalized else 1.0
            place = {"mesh": 0, "scale": [2.0, 2, 2], "translation": [1.0, 2, 3]}
            scene = _boxed(low, high, [place], kind=kind, stride=stride, normalized=normalized)
            scene.uses("KHR_mesh_quantization")
            ends = [tuple(np.array(end) / size * 2 + (1, 2, 3)) for end in (low, high)]
            name = f"glb-{kind}{'-normalised' if normalized else ''}"
            yield name, {"a.glb": scene.glb()}, reads_box(*ends)
    scene = _boxed((-128, -127, -128), (127, 127, 127), kind="i1", stride=4, normalized=True)
    scene.uses("KHR_mesh_quantization")
    yield "glb-i1-lowest", {"a.glb": scene.glb()}, reads_box((-1, -1, -1), (1, 1, 1))
    scene = _boxed((1, 2, 3), (2, 4, 6), kind="i2", stride=8)
    yield "glb-quantised-undeclared", {"a.glb": scene.glb()}, Refuses(), whole
    scene = _boxed((1, 2, 3), (2, 4, 6), kind="i2")
    scene.uses("KHR_mesh_quantization")
    yield "glb-quantised-unaligned", {"a.glb": scene.glb()}, Refuses(), whole
    yield "glb-stride", {"a.glb": _boxed(stride=20).glb()}, whole
    scene = Scene()
    both = np.concatenate([np.full((8, 3), 9.0), points], axis=1)
    scene.mesh(points, faces)
    view = scene.view(both.astype("<f4").tobytes(), byteStride=24)
    scene.json["accessors"][0] |= {"bufferView": view, "byteOffset": 12}
    yield "glb-interleaved", {"a.glb": scene.glb()}, whole
    for indices in ("u1", "u4"):
        yield f"glb-indices-{indices}", {"a.glb": _boxed(indices=indices).glb()}, whole
    scene = Scene()
    scene.mesh(points[faces].reshape(-1, 3), None)
    yield "glb-no-indices", {"a.glb": scene.glb()}, whole
    scene = Scene()
    scene.mesh(points, [2, 6, 3, 7, 1, 5, 0, 4, 2, 6], mode=5)
    for strip in ([0, 2, 1, 3], [4, 5, 6, 7]):
        end = {"attributes": {"POSITION": 0}, "mode": 5, "indices": scene.accessor(strip, "u2")}
        scene.json["meshes"][0]["primitives"].append(end)
    yield "glb-strips", {"a.glb": scene.glb()}, whole
    scene = Scene()
    scene.mesh(points, [0, 4, 6, 2, 3, 1, 5, 4], mode=6)
    fan = scene.accessor([7, 3, 2, 6, 4, 5, 1, 3], "u2")
    entry = {"attributes": {"POSITION": 0}, "mode": 6, "indices": fan}
    scene.json["meshes"][0]["primitives"].append(entry)
    yield "glb-fans", {"a.glb": scene.glb()}, whole
    scene = _boxed()
    for mode in range(4):
        other = {"attributes": {"POSITION": 0}, "mode": mode}
        scene.json["meshes"][0]["primitives"].append(other)
    yield "glb-lines-too", {"a.glb": scene.glb()}, whole
    scene.json["meshes"][0]["primitives"] = scene.json["meshes"][0]["primitives"][1:]
    yield "glb-lines-alone", {"a.glb": scene.glb()}, Refuses()
    odd = Scene()
    odd.mesh(points, [*np.ravel(faces), 0, 1])
    yield "glb-odd-corners", {"a.glb": odd.glb()}, Refuses(), whole


def _morphed(mesh=None, node=None):
    """Return a box whose two targets move its upper end, with weights of mesh and node."""
    scene = _boxed()
    up = np.zeros((8, 3))
    up[4:, 2] = 1
    targets = [{"POSITION": scene.accessor(up * size)} for size in (2.0, -1.0)]
    scene.json["meshes"][0]["primitives"][0]["targets"] = targets
    if mesh:
        scene.json["meshes"][0]["weights"] = mesh
    if node:
        scene.json["nodes"][0]["weights"] = node
    return {"a.glb": scene.glb()}


def _instanced(nodes=None, required=False, **attributes):
    """Return a unit box in instances."""
    scene = _boxed((0.0, 0, 0), (1.0, 1, 1), nodes)
    found = {name: scene.accessor(*value) if isinstance(value, tuple) else scene.accessor(value)
             for name, value in attributes.items()}  # fmt: skip
    if "ROTATION" in attributes and isinstance(attributes["ROTATION"], tuple):
        scene.json["accessors"][found["ROTATION"]]["normalized"] = True
    scene.json["nodes"][-1]["extensions"] = {_INSTANCING: {"attributes": found}}
    scene.uses(_INSTANCING, required=required)
    return {"a.glb": scene.glb()}


def _nodes():
    """Morph targets, instances, transforms, scenes, cycles and extensions."""
    whole, half = reads_box(), 0.5**0.5
    yield "glb-morph-none", _morphed(), whole
    yield "glb-morph-mesh", _morphed([0.5, 0.0]), reads_box(base.LOW, (2, 4, 7))
    yield "glb-morph-node", _morphed([1.0, 0.0], [1.0, 1.0]), reads_box(base.LOW, (2, 4, 7))
    yield "glb-morph-weights-short", _morphed([0.5]), Refuses()
    unit = (0, 0, 0), (1, 1, 1)
    moves = [(0, 0, 0), (3, 0, 0), (0, 3, 0)]
    three = base.both(*(reads_box(*(np.add(end, move) for end in unit)) for move in moves))
    for required in (False, True):
        name = f"glb-instances{'-required' if required else ''}"
        yield name, _instanced(required=required, TRANSLATION=moves), three
    # a quarter about z takes x to y, and y to −x
    turned = base.both(reads_box((0, 0, 0), (2, 1, 1)), reads_box((2, 0, 0), (5, 3, 3)))
    turn = [(0, 0, 0, 1), (0, 0, half, half)]
    sizes, places = [(2, 1, 1), (3, 3, 3)], [(0, 0, 0), (5, 0, 0)]
    files = _instanced(TRANSLATION=places, ROTATION=turn, SCALE=sizes)
    yield "glb-instances-all", files, turned
    quantised = np.rint(np.array(turn) * 32767)
    files = _instanced(TRANSLATION=places, ROTATION=(quantised, "i2"), SCALE=sizes)
    yield "glb-instances-quantised", files, turned
    turn, sizes = [(0, 0, 0, 1), (0, 0, 1, 0)], [(1, 1, 1), (2, 2, 2)]
    files = _instanced(ROTATION=(np.array(turn) * 127, "i1"), SCALE=sizes)
    yield "glb-instances-turned", files, base.both(
        reads_box(*unit), reads_box((-2, -2, 0), (0, 0, 2)))  # fmt: skip
    files = _instanced(SCALE=[(1, 1, 1), (-2, 2, 2)])
    yield "glb-instances-mirrored", files, base.both(
        reads_box(*unit), reads_box((-2, 0, 0), (0, 2, 2)))  # fmt: skip
    parent = [{"children": [1], "scale": [2, 2, 2]}, {"mesh": 0, "translation": [1, 1, 1]}]
    files = _instanced(parent, TRANSLATION=[(0, 0, 0), (3, 0, 0)])
    answer = base.both(reads_box((2, 2, 2), (4, 4, 4)), reads_box((8, 2, 2), (10, 4, 4)))
    yield "glb-instances-nested", files, answer
    yield "glb-instances-uneven", _instanced(TRANSLATION=moves, SCALE=sizes), Refuses()
    mirror = {"mesh": 0, "scale": [-1, 1, 1]}
    yield "glb-mirrored", {"a.glb": _boxed(nodes=[mirror]).glb()}, reads_box((-2, 2, 3), (-1, 4, 6))
    nested = [
        {"children": [1], "scale": [-1, 2, 1], "translation": [10, 0, 0]},
        {"children": [2], "rotation": [0, 0, half, half]},
        {"mesh": 0, "scale": [1, 1, -1], "translation": [1, 0, 0]},
    ]
    # inwards out: (2..3, 2..4, −6..−3), turned (−4..−2, 2..3), mirrored (2..4, 4..6) + 10
    answer = reads_box((12, 4, -6), (14, 6, -3))
    yield "glb-nested", {"a.glb": _boxed(nodes=nested).glb()}, answer
    matrix = [0, 2, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1]
    files = {"a.glb": _boxed(nodes=[{"mesh": 0, "matrix": matrix}]).glb()}
    # x to 2 y, y to −x
    yield "glb-matrix", files, reads_box((1, 8, 10), (3, 10, 13))
    twice = [{"children": [1, 2]}, {"mesh": 0}, {"mesh": 0, "translation": [10, 0, 0]}]
    answer = base.both(whole, reads_box((11, 2, 3), (12, 4, 6)))
    yield "glb-mesh-twice", {"a.glb": _boxed(nodes=twice).glb()}, answer
    scenes = [{"mesh": 0, "translation": [50, 0, 0]}, {"mesh": 0}]
    scene = _boxed(nodes=scenes)
    scene.json |= {"scene": 1, "scenes": [{"nodes": [0]}, {"nodes": [1]}]}
    yield "glb-second-scene", {"a.glb": scene.glb()}, whole
    far = reads_box((51, 2, 3), (52, 4, 6))
    del scene.json["scene"]
    yield "glb-no-scene-named", {"a.glb": scene.glb()}, far, Refuses()
    scene.json["scene"] = 2
    yield "glb-scene-beyond", {"a.glb": scene.glb()}, Refuses(), far
    scene = _boxed(nodes=[{"mesh": 0}, {"mesh": 0, "translation": [50, 0, 0]}])
    yield "glb-node-outside", {"a.glb": scene.glb()}, whole
    del scene.json["scene"], scene.json["scenes"]
    yield "glb-no-scenes", {"a.glb": scene.glb()}, base.both(whole, far), Refuses()
    for size in (1, 2, 3):
        nodes = [{"mesh": 0, "children": [(at + 1) % size]} for at in range(size)]
        files = {"a.glb": _boxed(nodes=nodes).glb()}
        yield f"glb-cycle-{size}", files, Refuses()
        files = {"a.glb": _boxed(nodes=[{"mesh": 0}, *nodes]).glb()}
        for node in nodes:
            node["children"] = [child + 1 for child in node["children"]]
        files = {"a.glb": _boxed(nodes=[{"mesh": 0}, *nodes]).glb()}
        yield f"glb-cycle-outside-{size}", files, Refuses(), whole
    nodes = [{"children": [1, 2]}, {"children": [3]}, {"children": [3]}, {"mesh": 0}]
    answer = reads_box(triangles=24)._replace(volume=12.0)
    yield "glb-two-parents", {"a.glb": _boxed(nodes=nodes).glb()}, Refuses(), answer
    yield (
        "glb-child-beyond",
        {"a.glb": _boxed(nodes=[{"mesh": 0, "children": [7]}]).glb()},
        Refuses(),
    )
    yield "glb-mesh-beyond", {"a.glb": _boxed(nodes=[{"mesh": 7}]).glb()}, Refuses()
    rigged = _boxed(nodes=[{"mesh": 0, "skin": 0}, {}])
    rigged.json |= {"skins": [{"joints": [1]}]}
    rigged.json["scenes"][0]["nodes"] = [0, 1]
    yield "glb-skin", {"a.glb": rigged.glb()}, whole, Refuses()
    yield from _extensions()


def _extensions():
    """Extensions that a file requires."""
    whole = reads_box()
    for name in ("VENDOR_unheard_of", "MSFT_lod", "KHR_draco_mesh_compression",
                 "EXT_meshopt_compression", "KHR_meshopt_compression"):  # fmt: skip
        scene = _boxed()
        scene.uses(name)
        yield f"glb-requires-{name}", {"a.glb": scene.glb()}, Refuses((name,))
    for name in ("KHR_materials_unlit", "KHR_texture_transform", "KHR_lights_punctual"):
        scene = _boxed()
        scene.uses(name)
        yield f"glb-requires-{name}", {"a.glb": scene.glb()}, whole
    scene = _boxed()
    scene.uses("VENDOR_unheard_of", required=False)
    yield "glb-uses-unknown", {"a.glb": scene.glb()}, whole
    draco = "KHR_draco_mesh_compression"
    scene = _boxed()
    packed = {"bufferView": 0, "attributes": {"POSITION": 0}}
    scene.json["meshes"][0]["primitives"][0]["extensions"] = {draco: packed}
    scene.uses(draco, required=False)
    yield "glb-draco-or-plain", {"a.glb": scene.glb()}, whole, Refuses((draco,))
    for entry in scene.json["accessors"]:
        del entry["bufferView"]
    yield "glb-draco-alone", {"a.glb": scene.glb()}, Refuses((draco,))
    scene.uses(draco)
    yield "glb-draco", {"a.glb": scene.glb()}, Refuses((draco,))
    meshopt = "EXT_meshopt_compression"
    scene = _boxed()
    for view in scene.json["bufferViews"]:
        view["extensions"] = {meshopt: {"buffer": 1, "byteLength": 8, "count": 8, "byteStride": 12,
                                        "mode": "ATTRIBUTES"}}  # fmt: skip
    scene.json["buffers"].append({"byteLength": 8, "uri": "data:a/b;base64,AAAAAAAAAAA="})
    fallback = {"extensions": {meshopt: {"fallback": True}}}
    scene.uses(meshopt, required=False)
    yield "gltf-meshopt-or-plain", {"a.gltf": scene.embedded()}, whole, Refuses((meshopt,))
    yield "gltf-meshopt-alone", {"a.gltf": scene.text(**fallback)}, Refuses((meshopt,))
    scene.uses(meshopt)
    yield "gltf-meshopt", {"a.gltf": scene.text(**fallback)}, Refuses((meshopt,))


def entries():
    """Yield name, files and what is right."""
    for part in (_files, _accessors, _nodes):
        yield from part()
