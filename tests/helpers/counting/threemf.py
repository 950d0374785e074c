"""Counter of 3MF: core and production; supports and what is not built are left out."""

import io
import posixpath
import zipfile
import zlib
from xml.etree import ElementTree

import numpy as np

from counting.base import MOST_TRIANGLES, Refused, Tally, integer, number

_CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
_PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
_KNOWN = {
    _CORE[1:-1],
    _PRODUCTION,
    # colours, and names of sets of triangles: neither changes a shape
    "http://schemas.microsoft.com/3dmanufacturing/material/2015/02",
    "http://schemas.microsoft.com/3dmanufacturing/trianglesets/2021/07",
}
_START = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
_UNITS = ("micron", "millimeter", "centimeter", "inch", "foot", "meter")
_COUNTED, _LEFT_OUT = ("model", "surface"), ("support", "solidsupport", "other")


class _Model:
    """One model part: its objects by id, and what is built."""

    def __init__(self, name, data):
        self.name = name
        if b"<!DOCTYPE" in data:
            raise Refused(f"{name} holds a DTD")
        prefixes, root = {}, None
        try:
            for event, found in ElementTree.iterparse(io.BytesIO(data), ("start-ns", "start")):
                if event == "start-ns" and root is None:
                    prefixes[found[0]] = found[1]
                elif event == "start" and root is None:
                    root = found
        except (ElementTree.ParseError, LookupError, ValueError) as error:
            raise Refused(f"{name} is no XML: {error}") from None
        if root is None or root.tag != f"{_CORE}model":
            raise Refused(f"{name} is no model")
        for prefix in root.get("requiredextensions", "").split():
            space = prefixes.get(prefix)
            if space not in _KNOWN:
                raise Refused(f"{name} requires {prefix}: {space}")
        self.unit = root.get("unit", "millimeter")
        if self.unit not in _UNITS:
            raise Refused(f"{name}: a unit of {self.unit!r}")
        self.objects = {}
        for entry in root.findall(f"{_CORE}resources/{_CORE}object"):
            key = _id(entry, "id", name)
            if key in self.objects:
                raise Refused(f"{name}: two objects of id {key}")
            self.objects[key] = entry
        self.items = root.findall(f"{_CORE}build/{_CORE}item")


def _id(entry, name, where):
    """Return an attribute that names an object."""
    value = entry.get(name)
    if value is None:
        raise Refused(f"{where}: no {name}")
    value = integer(value, where)
    if value < 1:
        raise Refused(f"{where}: {name} of {value}")
    return value


def _transform(entry, where):
    """Return a placement (4, 3): rows, as the standard multiplies from the left."""
    words = entry.get("transform", "1 0 0 0 1 0 0 0 1 0 0 0").split()
    if len(words) != 12:
        raise Refused(f"{where}: a transform of {len(words)} numbers")
    return np.array([number(word, where) for word in words]).reshape(4, 3)


class _Package:
    """A package: its parts by name, whose case does not count."""

    def __init__(self, data):
        try:
            self.zip = zipfile.ZipFile(io.BytesIO(data))
        except (zipfile.BadZipFile, ValueError, RuntimeError) as error:
            raise Refused(f"no package: {error}") from None
        self.names = {"/" + name.lstrip("/").lower(): name for name in self.zip.namelist()}
        self.models, self.meshes, self.sizes = {}, {}, {}

    def part(self, name):
        """Return the bytes of a part."""
        if name.lower() not in self.names:
            raise Refused(f"no part {name}")
        try:
            return self.zip.read(self.names[name.lower()])
        except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, ValueError,
                OSError) as error:  # fmt: skip
            raise Refused(f"{name} cannot be unpacked: {error}") from None

    def start(self):
        """Return the name of the model that the package begins with."""
        try:
            relations = ElementTree.fromstring(self.part("/_rels/.rels"))
        except (ElementTree.ParseError, ValueError) as error:
            raise Refused(f"/_rels/.rels is no XML: {error}") from None
        targets = [each.get("Target", "") for each in relations if each.get("Type") == _START]
        if len(targets) != 1:
            raise Refused(f"the package begins with {len(targets)} models")
        return posixpath.normpath(posixpath.join("/", targets[0]))

    def model(self, name):
        """Return a model part, read once."""
        if name.lower() not in self.models:
            self.models[name.lower()] = _Model(name, self.part(name))
        return self.models[name.lower()]

    def mesh(self, model, key, mesh):
        """Return an object's points and triangles, read once."""
        if (model.name, key) not in self.meshes:
            where = f"{model.name}, object {key}"
            points, faces = [], []
            for vertex in mesh.findall(f"{_CORE}vertices/{_CORE}vertex"):
                points.append([number(vertex.get(axis, ""), where) for axis in "xyz"])
            for triangle in mesh.findall(f"{_CORE}triangles/{_CORE}triangle"):
                faces.append([integer(triangle.get(corner, ""), where) for corner in
                              ("v1", "v2", "v3")])  # fmt: skip
                if not 0 <= min(faces[-1]) <= max(faces[-1]) < len(points):
                    raise Refused(f"{where}: {faces[-1]} names no vertex of {len(points)}")
            points, faces = np.array(points, float).reshape(-1, 3), np.array(faces, int)
            self.meshes[model.name, key] = points, faces.reshape(-1, 3)
        return self.meshes[model.name, key]

    def place(self, tally, model, key, matrix, within):
        """Add an object, and what it is made of, to the tally."""
        if (model.name, key) in within:
            raise Refused(f"{model.name}: object {key} holds itself")
        entry = model.objects.get(key)
        if entry is None:
            raise Refused(f"{model.name}: no object {key}")
        kind = entry.get("type", "model")
        if kind not in _COUNTED + _LEFT_OUT:
            raise Refused(f"{model.name}: object {key} of type {kind!r}")
        mesh, components = entry.find(f"{_CORE}mesh"), entry.find(f"{_CORE}components")
        if (mesh is None) == (components is None):
            raise Refused(f"{model.name}: object {key} is not one of mesh and components")
        if mesh is not None:
            points, faces = self.mesh(model, key, mesh)
            if kind in _LEFT_OUT:
                return
            # what is mirrored is turned inside out again
            mirrored = np.linalg.det(matrix[:3]) < 0
            tally.add(points @ matrix[:3] + matrix[3], faces[:, ::-1] if mirrored else faces)
            return
        self.sizes["placed"] = self.sizes.get("placed", 0) + len(components)
        if len(within) > 200 or self.sizes["placed"] > MOST_TRIANGLES // 50:
            raise Refused("components of components without an end")
        for component in components.findall(f"{_CORE}component"):
            # a component of what is left out is still looked up: the file may be wrong there
            inner = _transform(component, model.name)
            placed = inner @ matrix[:3]
            placed[3] += matrix[3]
            self.place(
                Tally() if kind in _LEFT_OUT else tally, self.model(self._path(component, model)),
                _id(component, "objectid", model.name), placed, {*within, (model.name, key)},
            )  # fmt: skip

    def _path(self, entry, model):
        """Return the part that a reference goes to."""
        return entry.get(f"{{{_PRODUCTION}}}path", model.name)


def threemf(data):
    """Count what is built, of the types that are the model's."""
    package, tally = _Package(data), Tally()
    root = package.model(package.start())
    for item in root.items:
        model = package.model(package._path(item, root))
        key = _id(item, "objectid", root.name)
        package.place(tally, model, key, _transform(item, root.name), frozenset())
    units = {model.unit for model in package.models.values()}
    if len(units) > 1:
        raise Refused(f"models of several units: {', '.join(sorted(units))}")
    return tally.counted(root.unit)
