"""3MF: the build items of a package, with the production extension.

The 3MF consortium's own reader, lib3mf, stores coordinates in single precision; this reader stores
them in double precision.
"""

import lzma
import posixpath
import zipfile
import zlib

import numpy as np
from lxml import etree

from pandis.pipeline.mesh.formats.base import (
    AGAIN,
    MOST,
    FormatError,
    joined,
    number,
    placed,
    whole,
)

_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
#: Type of the relationship from a package to its root model.
_START = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
#: Extensions that a file may require: they are supported, or do not affect triangles.
_READ = (_CORE, _PRODUCTION, "http://schemas.microsoft.com/3dmanufacturing/material/2015/02",
         "http://schemas.microsoft.com/3dmanufacturing/trianglesets/2021/07")  # fmt: skip
#: Names of other extensions, for messages.
_CALLED = {
    "beamlattice": "beam lattices", "slice": "slices", "volumetric": "volumetric data",
    "implicit": "implicit functions", "securecontent": "encrypted parts", "displacement":
    "displacement maps", "boolean": "boolean shapes",
}  # fmt: skip
#: Types of objects that are not part of the built product.
_LEFT_OUT = ("support", "solidsupport", "other")
_UNITS = {
    "micron": "micron", "millimeter": "mm", "centimeter": "cm", "inch": "in", "foot": "ft",
    "meter": "m",
}  # fmt: skip
_LARGEST = 1 << 30
#: Exceptions that reading a damaged package may raise. zipfile raises RuntimeError
#: for compression and encryption methods that it does not support.
DAMAGED = (
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, OSError, ValueError, RuntimeError,
)  # fmt: skip


def read(path, folder=None):
    """Read the build items of a 3MF package with their components, transformed into place.

    Parameters
    ----------
    path, folder
        As in `pandis.pipeline.mesh.formats.obj.read`.

    Returns
    -------
    pandis.pipeline.mesh.formats.base.Reading
        Supports are left out and listed in the notes.

    Raises
    ------
    pandis.pipeline.mesh.formats.base.FormatError
    """
    del folder
    try:
        with zipfile.ZipFile(path) as package:
            return _Package(package).reading()
    except FormatError:
        raise
    except DAMAGED as error:
        raise FormatError(f"it is not a complete 3MF package ({error}); {AGAIN}") from None


class _Package:
    """A package; each of its model files is parsed once."""

    def __init__(self, package):
        self.package, self._models, self.notes = package, {}, []
        self._places = 0
        names = {name.lower(): name for name in package.namelist()}
        self._names = names
        self.root = self._start()

    def _start(self):
        """Return the absolute name of the package's root model."""
        rels = self._names.get("_rels/.rels")
        if rels is not None:
            for entry in self._parse(rels):
                if entry.get("Type") == _START:
                    return _absolute(entry.get("Target", ""), "/")
        models = sorted(name for name in self._names if name.endswith(".model"))
        if not models:
            raise FormatError(f"the package contains no model; {AGAIN}")
        return "/" + models[0]

    def _parse(self, name):
        if self.package.getinfo(name).file_size > _LARGEST:
            raise FormatError(f"{name} is larger than a gigabyte; leave parts out")
        parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True)
        try:
            return etree.fromstring(self.package.read(name), parser)
        except etree.XMLSyntaxError as error:
            raise FormatError(f"{name}: invalid XML ({error}); {AGAIN}") from None

    def model(self, part):
        """Return the `_Model` of a part, by its absolute name."""
        if part not in self._models:
            name = self._names.get(part.lstrip("/").lower())
            if name is None:
                raise FormatError(f"it references {part}, which is not in the package; {AGAIN}")
            self._models[part] = _Model(part, self._parse(name))
        return self._models[part]

    def reading(self):
        """Return all build items as one `Reading`."""
        root = self.model(self.root)
        build = root.tree.find(_tag("build"))
        items = [] if build is None else build.findall(_tag("item"))
        if not items:
            raise FormatError(f"the build element of the package has no items; {AGAIN}")
        parts = []
        for item in items:
            part = _absolute(item.get(f"{{{_PRODUCTION}}}path"), root.part)
            parts += self._built(part, item.get("objectid"), _transform(item, root.part), above=())
        if not parts and self.notes:
            raise FormatError(f"all objects of the package are left out: {'; '.join(self.notes)}")
        unit = root.tree.get("unit", "millimeter")
        if unit not in _UNITS:
            raise FormatError(f"its unit '{unit[:40]}' is not one of {', '.join(_UNITS)}; {AGAIN}")
        return joined(parts, self.notes, _UNITS[unit])

    def _built(self, part, identity, matrix, *, above):
        """Return the meshes of an object and of its components, transformed by ``matrix``."""
        model = self.model(part)
        element = model.objects.get(identity)
        if element is None:
            raise FormatError(f"{part} has no object {identity}; {AGAIN}")
        if (part, identity) in above:
            raise FormatError(f"{part}: the components of object {identity} form a cycle; {AGAIN}")
        self._places += 1
        if self._places > 1_000_000:
            raise FormatError("it places more than a million parts: leave parts out")
        kind = element.get("type", "model")
        if kind in _LEFT_OUT:
            name = element.get("name") or f"object {identity}"
            self.notes.append(f"left out: {name}, of type '{kind}'")
            return []
        parts = []
        for component in element.iterfind(f"{_tag('components')}/{_tag('component')}"):
            other = _absolute(component.get(f"{{{_PRODUCTION}}}path"), part)
            inner = matrix @ _transform(component, part)
            named = component.get("objectid")
            parts += self._built(other, named, inner, above=(*above, (part, identity)))
        mesh = element.find(_tag("mesh"))
        if mesh is not None:
            vertices, faces, materials = model.mesh(element, mesh)
            if len(faces):
                parts.append((*placed(vertices, faces, matrix), materials))
        if sum(len(faces) for _, faces, _ in parts) > MOST:
            raise FormatError(f"it places more than {MOST:,} triangles: leave parts out")
        return parts


class _Model:
    """One model file: its objects and materials."""

    def __init__(self, part, tree):
        self.part, self.tree, self._meshes = part, tree, {}
        for prefix in tree.get("requiredextensions", "").split():
            space = tree.nsmap.get(prefix)
            if space is None:
                raise FormatError(f"{part} requires '{prefix}', which it does not declare; {AGAIN}")
            if space not in _READ:
                called = next((name for word, name in _CALLED.items() if f"/{word}" in space), None)
                title = f"{called} ({space})" if called else space
                raise FormatError(
                    f"it uses an unsupported extension, {title}; export the object as triangles"
                )
        resources = tree.find(_tag("resources"))
        resources = [] if resources is None else resources
        objects = [o for o in resources if o.tag == _tag("object")]
        self.objects = {o.get("id"): o for o in objects}
        if len(self.objects) < len(objects):
            names = [o.get("id") for o in objects]
            twice = next(name for name in names if names.count(name) > 1)
            raise FormatError(f"{part} has more than one object {twice}; {AGAIN}")
        self.bases = {b.get("id"): [base.get("name") for base in b.iterfind(_tag("base"))]
                      for b in resources if b.tag == _tag("basematerials")}  # fmt: skip

    def mesh(self, resource, mesh):
        """Return vertices, faces and material names of an object's own mesh."""
        identity = resource.get("id")
        if identity not in self._meshes:
            self._meshes[identity] = self._read(resource, mesh)
        return self._meshes[identity]

    def _read(self, resource, mesh):
        rows = [[v.get(axis) or "" for axis in "xyz"] for v in mesh.iterfind(
            f"{_tag('vertices')}/{_tag('vertex')}")]  # fmt: skip
        where = f"{self.part}: object {resource.get('id')}"
        vertices = np.array(
            [[number(token, f"{where}: vertex {i}") for token in row] for i, row in enumerate(rows)]
        ).reshape(-1, 3)
        triangles = mesh.findall(f"{_tag('triangles')}/{_tag('triangle')}")
        faces = np.array(
            [[whole(t.get(key) or "", f"{where}: triangle {i}") for key in ("v1", "v2", "v3")]
             for i, t in enumerate(triangles)], np.int64,
        ).reshape(-1, 3)  # fmt: skip
        if len(faces) and not 0 <= faces.min() <= faces.max() < len(vertices):
            raise FormatError(
                f"{where}: triangles use vertices from {faces.min()} to {faces.max()}, but there "
                f"are {len(vertices):,}; {AGAIN}"
            )
        names = [self._material(t, resource) for t in triangles] if self.bases else None
        return vertices, faces, names

    def _material(self, triangle, resource):
        """Return a material's name; None for colours and textures, which have no names."""
        group, first = triangle.get("pid"), triangle.get("p1")
        if group is None:
            group = resource.get("pid")
            first = first or resource.get("pindex")
        names = self.bases.get(group)
        index = whole(first or "0", f"{self.part}: a material's index")
        if names is not None and not 0 <= index < len(names):
            raise FormatError(f"{self.part}: no material {index} in group {group}; {AGAIN}")
        return names[index] if names else None


def _tag(name):
    return f"{{{_CORE}}}{name}"


def _absolute(target, base):
    """Return the absolute name of a part; the base itself if ``target`` is empty."""
    return posixpath.normpath(posixpath.join(posixpath.dirname(base), target)) if target else base


def _transform(element, part):
    """Return an element's matrix (4, 4)."""
    text = element.get("transform")
    matrix = np.eye(4)
    if text is not None:
        values = [number(token, f"{part}: a transform") for token in text.split()]
        if len(values) != 12:
            raise FormatError(f"{part}: a transform has {len(values)} numbers, not 12; {AGAIN}")
        matrix[:3] = np.array(values).reshape(4, 3).T
    return matrix
