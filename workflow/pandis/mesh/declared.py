"""How many triangles a mesh file itself says it holds: what a reader's result is held against."""

import gzip
import io
import json
import re
import struct
import zipfile
from dataclasses import dataclass

#: Vertices of one strip or fan make this many fewer triangles (glTF primitive modes 5 and 6).
_STRIPS = (5, 6)


@dataclass(frozen=True)
class Declared:
    """A number of triangles: exact, or the least that there can be."""

    triangles: int
    exact: bool
    polygons: bool = False  # some faces have more than three corners

    def agrees(self, count):
        """Tell whether a reader that found ``count`` triangles can have read everything."""
        return count == self.triangles if self.exact else count >= self.triangles

    def __str__(self):
        return f"{'' if self.exact else 'at least '}{self.triangles:,}"


def declared(path, form):
    """Return what a file declares, or None where the format, or this file, does not say.

    Parameters
    ----------
    path : Path
        Not compressed.
    form : str
        ``obj``, ``ply``, ``stl``, ``off``, ``glb``, ``gltf`` or ``3mf``.

    Returns
    -------
    Declared or None
    """
    ask = {"obj": _obj, "ply": _ply, "stl": _stl, "off": _off, "glb": _glb, "gltf": _gltf}
    try:
        says = ask[form](path.read_bytes()) if form in ask else None
    except (ValueError, KeyError, IndexError, TypeError, struct.error):
        return None  # malformed: the readers will say how
    return says if says is None or says.triangles > 0 else None


def _obj(data):
    text = re.sub(rb"\\\r?\n", b" ", data)
    corners = [len(line.split()) - 1 for line in re.findall(rb"^[ \t]*f[ \t][^\r\n#]*", text, re.M)]
    polygons = any(n > 3 for n in corners)
    return Declared(sum(max(n - 2, 0) for n in corners), exact=True, polygons=polygons)


def _ply(data):
    header = data[: data.index(b"end_header")]
    match = re.search(rb"^element face (\d+)", header, re.M)
    # polygons: each is one triangle or more
    return Declared(int(match[1]), exact=False) if match else None


def _stl(data):
    if len(data) >= 84 and len(data) == 84 + 50 * struct.unpack_from("<I", data, 80)[0]:
        return Declared((len(data) - 84) // 50, exact=True)
    if data[:200].lstrip()[:5].lower() != b"solid":
        return None
    return Declared(len(re.findall(rb"\bendfacet\b", data, re.I)), exact=True)


def _off(data):
    words = re.sub(rb"#[^\n]*", b"", data[:2000]).split()
    numbers = [int(word) for word in words[:4] if word.isdigit()]
    return Declared(numbers[1], exact=False)


def gltf_scene(data, form):
    """Return the JSON of a scene, of the bytes of a ``glb`` or ``gltf`` file."""
    if form == "glb":
        data = data[20 : 20 + struct.unpack_from("<I", data, 12)[0]]
    return json.loads(data)


def _glb(data):
    return _triangles(gltf_scene(data, "glb"))


def _gltf(data):
    return _triangles(gltf_scene(data, "gltf"))


def _triangles(scene):
    nodes, total = scene["nodes"], 0
    shown = scene.get("scenes", [{}])[scene.get("scene", 0)].get("nodes", range(len(nodes)))
    waiting = list(shown)
    while waiting:
        node = nodes[waiting.pop()]
        waiting += node.get("children", [])
        if "mesh" in node:
            for part in scene["meshes"][node["mesh"]]["primitives"]:
                total += _primitive(part, scene["accessors"])
        if len(waiting) > 1_000_000:
            raise ValueError("the nodes form a circle")
    return Declared(total, exact=True)


#: Extensions that pack the triangles of a glTF scene: a reader that does not know them finds none.
_PACKINGS = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")


def compression(path, form):
    """Return the name of the extension that a glTF scene's triangles are compressed by, or None.

    Parameters
    ----------
    path : Path
        Not compressed as a file.
    form : str
        Its format.
    """
    if form not in ("glb", "gltf"):
        return None
    try:
        scene = gltf_scene(path.read_bytes(), form)
        needed = [*scene.get("extensionsRequired", []), *scene.get("extensionsUsed", [])]
    except (ValueError, TypeError, AttributeError, struct.error):
        return None  # malformed: the readers will say how
    return next((name for name in needed if name in _PACKINGS), None)


def _primitive(part, accessors):
    mode = part.get("mode", 4)
    which = part["indices"] if "indices" in part else part["attributes"]["POSITION"]
    count = accessors[which]["count"]
    if mode in _STRIPS:
        return max(count - 2, 0)
    return count // 3 if mode == 4 else 0


#: The units of 3MF as others write them.
_UNITS = {"millimeter": "mm", "meter": "m", "centimeter": "cm", "inch": "in", "foot": "ft"}


def declared_unit(path):
    """Return the unit that a 3MF file declares, ``unknown`` if none can be read."""
    data = path.read_bytes()
    try:
        data = gzip.decompress(data) if path.suffix == ".gz" else data
        with zipfile.ZipFile(io.BytesIO(data)) as package:
            model = next(name for name in package.namelist() if name.lower().endswith(".model"))
            match = re.search(rb'<model[^>]*\bunit="(\w+)"', package.read(model))
    except (OSError, zipfile.BadZipFile, StopIteration):
        return "unknown"
    unit = match[1].decode() if match else "millimeter"  # the standard's default
    return _UNITS.get(unit, unit)
