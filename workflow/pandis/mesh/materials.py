"""The names of materials in OBJ, glTF and 3MF files, face by face."""

import re
import struct
import zipfile
from xml.etree import ElementTree

import numpy as np

from pandis.mesh.declared import gltf_scene
from pandis.mesh.polygons import read_obj

#: What faces without a material are made of.
UNNAMED = "none"


def names_several(path, form):
    """Return whether a file seems to name several materials, so that it is worth another reading.

    Parameters
    ----------
    path : Path
        Not compressed.
    form : str
        Of `pandis.run.sourcing.FORMATS`.
    """
    try:
        if form == "obj":
            named = re.findall(rb"^[ \t]*usemtl[ \t]+(\S[^\r\n]*)", path.read_bytes(), re.M)
            return len(set(named)) > 1
        if form in ("glb", "gltf"):
            return len(gltf_scene(path.read_bytes(), form).get("materials", [])) > 1
        if form == "3mf":
            with zipfile.ZipFile(path) as package:
                return sum(len(re.findall(rb"<(?:\w+:)?base\s", package.read(name)))
                           for name in _models(package)) > 1  # fmt: skip
    except (OSError, ValueError, TypeError, AttributeError, struct.error, zipfile.BadZipFile):
        return False  # malformed: the readers will say how
    return False


def materials_of(path, form):
    """Read a mesh file with the materials that it names.

    Parameters
    ----------
    path, form
        As of `names_several`.

    Returns
    -------
    vertices : ndarray, shape (V, 3), float64
    faces : ndarray, shape (F, 3), int64
    names : ndarray, shape (F,), of text
        Of each face's material; `UNNAMED` where there is none.
    """
    reader = {"obj": read_obj, "glb": _gltf, "gltf": _gltf, "3mf": _3mf}[form]
    vertices, faces, names = reader(path)
    return vertices, faces, np.array([name or UNNAMED for name in names])


def _gltf(path):
    import trimesh

    scene, parts = trimesh.load_scene(path, process=False), []
    for node in scene.graph.nodes_geometry:
        place, name = scene.graph[node]
        mesh = scene.geometry[name]
        if not isinstance(mesh, trimesh.Trimesh):
            continue
        material = getattr(mesh.visual, "material", None)
        called = getattr(material, "name", None)
        parts.append((trimesh.transform_points(mesh.vertices, place), mesh.faces, called))
    return _joined([(v, f, [called] * len(f)) for v, f, called in parts])


def _joined(parts):
    """Return meshes with the names of their faces as one."""
    starts = np.cumsum([0, *(len(v) for v, _, _ in parts)])
    vertices = np.concatenate([v for v, _, _ in parts])
    faces = np.concatenate([f + start for (_, f, _), start in zip(parts, starts, strict=False)])
    return vertices, faces, [name for _, _, names in parts for name in names]


def _models(package):
    return [name for name in package.namelist() if name.lower().endswith(".model")]


def _3mf(path):
    """Read a 3MF package: its objects, their components, and what is built."""
    parts = []
    with zipfile.ZipFile(path) as package:
        for name in _models(package):
            root = ElementTree.fromstring(package.read(name))
            for element in root.iter():
                element.tag = element.tag.rsplit("}", 1)[-1]
            bases = {b.get("id"): [base.get("name") for base in b.iter("base")]
                     for b in root.iter("basematerials")}  # fmt: skip
            objects = {o.get("id"): o for o in root.iter("object")}
            for item in root.iter("item"):
                place = _transform(item.get("transform"))
                parts += _built(objects[item.get("objectid")], objects, bases, place)
    return _joined(parts)


def _transform(text):
    """Return the matrix (4, 3) by which rows (x, y, z, 1) are multiplied."""
    if not text:
        return np.eye(4)[:, :3]
    return np.array(text.split(), float).reshape(4, 3)


def _built(given, objects, bases, place, depth=0):
    """Return the meshes of an object and of its components, each placed."""
    if depth > 100:
        raise ValueError("the components form a circle")
    parts = []
    for component in given.iter("component"):
        inner = np.column_stack([_transform(component.get("transform")), [0, 0, 0, 1]])
        other = objects[component.get("objectid")]
        parts += _built(other, objects, bases, inner @ place, depth + 1)
    for mesh in given.iter("mesh"):
        rows = [[float(v.get(k)) for k in "xyz"] for v in mesh.iter("vertex")]
        triangles = list(mesh.iter("triangle"))
        faces = [[int(t.get(k)) for k in ("v1", "v2", "v3")] for t in triangles]
        names = [_base(bases, t.get("pid") or given.get("pid"),
                       t.get("p1") if t.get("pid") or t.get("p1") else given.get("pindex"))
                 for t in triangles]  # fmt: skip
        vertices = np.column_stack([np.array(rows), np.ones(len(rows))]) @ place
        parts.append((vertices, np.array(faces), names))
    return parts


def _base(bases, group, index):
    """Return a material's name; None for colours and textures, which name none."""
    names = bases.get(group)
    return names[int(index or 0)] if names else None
