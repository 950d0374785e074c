"""Scenes as MJCF, MuJoCo's model format."""

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from pandis.base.errors import ArtifactError, PandisError
from pandis.base.files import write_atomically
from pandis.base.obj import obj_text
from pandis.bridges.mujoco import NAME
from pandis.runtime.field import NativeField
from pandis.runtime.field.constants import MESH
from pandis.runtime.field.files import read_contents
from pandis.runtime.scene import Placed

#: MuJoCo's default torsional and rolling friction, which materials do not define.
_TURNING, _ROLLING = 0.005, 0.0001


def write_mjcf(scene, path, meshes=None):
    """Write a scene for MuJoCo: a body with one geom for every object.

    The bodies are static; add ``<freejoint/>`` to a body to let it move. Each geom takes distances
    from its field, and appearance, mass and bounds from a mesh. That mesh is written beside the
    model if the object's field, or ``exact.pandis`` beside it, is an exact mesh. Otherwise MuJoCo
    makes a mesh from the field, and parts thinner than a hundredth of the object are lost.

    Parameters
    ----------
    scene : path-like, or dict of str to pandis.runtime.scene.Placed
        ``results/scenes/{scene}.json``, or placed fields by object name.
    path : path-like
        ``….xml``; mesh files are named after it.
    meshes : dict of str to path-like, optional
        Mesh files to use instead, by object name, in the units of the object's field.

    Raises
    ------
    PandisError
        ``meshes`` names an unknown object; the scene, or a file that it names, cannot be read.
    """
    path = Path(path)
    placed, frictions = (dict(scene), {}) if isinstance(scene, dict) else _read(Path(scene))
    meshes = {name: Path(file) for name, file in (meshes or {}).items()}
    if unknown := sorted(set(meshes) - set(placed)):
        raise PandisError(
            f"meshes: no object is named {', '.join(unknown)}; the objects are {', '.join(placed)}"
        )
    written = {}
    for name, each in placed.items():
        if name not in meshes and (file := _mesh_file(each.field, path, written)):
            meshes[name] = file
    write_atomically(path, mjcf_text(path.stem, placed, meshes, frictions=frictions).encode())


def mjcf_text(model, placed, meshes, *, frictions):
    """Return the text that `write_mjcf` writes.

    Parameters
    ----------
    model : str
        Name of the model.
    placed : dict of str to pandis.runtime.scene.Placed
    meshes : dict of str to path-like
        Mesh files, by object name; an object may have none.
    frictions : dict of str to float
        Friction coefficients by object name; other objects have MuJoCo's default.
    """
    root = ElementTree.Element("mujoco", model=model)
    plugin = _under(root, "extension/plugin", plugin=NAME)
    assets, world = _under(root, "asset"), _under(root, "worldbody")
    numbers, drawn = {}, {}
    for name, each in placed.items():
        file = meshes.get(name)
        shape = each.field.path.resolve(), each.scale, file
        if shape not in numbers:
            numbers[shape] = name
            instance = _under(plugin, "instance", name=name)
            _under(instance, "config", key="file", value=str(shape[0]))
            _under(instance, "config", key="scale", value=repr(float(each.scale)))
            if file is None:
                _under(_under(assets, "mesh", name=name), "plugin", instance=name)
            elif (file, each.scale) not in drawn:
                scale = _numbers([each.scale] * 3)
                _under(assets, "mesh", name=name, file=str(file.resolve()), scale=scale)
            drawn.setdefault((file or shape, each.scale), name)
        axes = np.asarray(each.rotation, float)[:, :2].T.ravel()
        pose = {"pos": _numbers(each.translation), "xyaxes": _numbers(axes)}
        body = _under(world, "body", name=name, **pose)
        shown = drawn[file or shape, each.scale]
        geom = _under(body, "geom", name=name, type="sdf", mesh=shown)
        if name in frictions:
            geom.set("friction", _numbers([frictions[name], _TURNING, _ROLLING]))
        _under(geom, "plugin", instance=numbers[shape])
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _read(path):
    """Return the objects of a scene's JSON, and the friction of those with a single material."""
    try:
        objects = json.loads(path.read_text(encoding="utf-8"))["objects"]
        placed = {
            each["name"]: Placed(
                NativeField(_file(each["file"], path)),
                np.array(each["rotation_matrix"], float).reshape(3, 3),
                np.array(each["translation"], float).reshape(3),
                float(each["scale"]),
                float(each["stiffness"]),
            )
            for each in objects
        }
        materials = {each["name"]: list(each["materials"].values()) for each in objects}
        frictions = {name: float(one["sticking"]) for name, (one, *more) in materials.items()
                     if not more}  # fmt: skip
    except OSError as error:
        raise ArtifactError(f"{path}: it cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ArtifactError(f"{path}: not a scene from results/scenes: {error!r}") from error
    return placed, frictions


def _file(name, scene):
    """Return the path of a file that a scene names, in the working folder or above the scene."""
    above = scene.resolve().parents
    places = [Path(name), *(folder / name for folder in above)]
    return next((place for place in places if place.is_file()), Path(name))


def _mesh_file(field, path, written):
    """Return the mesh file of a field, or of the exact field beside it, or None; write it once."""
    beside = field.path if field.kind == MESH else field.path.with_name("exact.pandis")
    if not beside.is_file():
        return None
    if beside not in written:
        contents = read_contents(beside)
        if "VERT" not in contents.sections:  # a closed form
            return None
        corners = np.frombuffer(contents.sections["VERT"], "<f8").reshape(-1, 3)
        faces = np.frombuffer(contents.sections["FACE"], "<i4").reshape(-1, 3)
        file = path.with_name(f"{path.stem}-{len(written)}.obj")
        write_atomically(file, obj_text(contents.field.frame.to_mesh(corners), faces).encode())
        written[beside] = file
    return written[beside]


def _under(parent, tags, **attributes):
    """Add an element, or a path of nested ones, and return the innermost."""
    for tag in tags.split("/"):
        parent = ElementTree.SubElement(parent, tag)
    for key, value in attributes.items():
        parent.set(key, value)
    return parent


def _numbers(values):
    return " ".join(repr(float(value)) for value in values)
