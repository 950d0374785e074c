"""Scenes as MJCF, the format of MuJoCo's models."""

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from pandis.base.errors import ArtifactError, PandisError
from pandis.base.obj import obj_text
from pandis.bridges.mujoco import NAME
from pandis.runtime.field import MESH, NativeField
from pandis.runtime.field.files import read_contents
from pandis.runtime.scene import Placed

#: MuJoCo's own friction while something turns, or rolls: a material says nothing of it.
_TURNING, _ROLLING = 0.005, 0.0001


def write_mjcf(scene, path, meshes=None):
    """Write a scene for MuJoCo: a body with one geom for every object.

    The bodies stand still; with ``<freejoint/>`` in it a body moves. Each geom asks its field for
    distances, and a mesh draws it, and gives its mass and bounds. That mesh is written beside the
    model if the object's field, or ``exact.pandis`` beside it, is an exact mesh. Otherwise MuJoCo
    makes one of the field, which lacks what is thinner than a hundredth of the object.

    Parameters
    ----------
    scene : path-like, or dict of str to pandis.runtime.scene.Placed
        ``results/scenes/{scene}.json``, or fields and where they lie, by the object's name.
    path : path-like
        ``….xml``; meshes are called like it.
    meshes : dict of str to path-like, optional
        By object, files in units of its field, instead.

    Raises
    ------
    PandisError
        A name in ``meshes`` is no object's; the scene, or a file that it names, cannot be read.
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
    path.write_text(mjcf_text(path.stem, placed, meshes, frictions), encoding="utf-8")


def mjcf_text(model, placed, meshes, frictions):
    """Return what `write_mjcf` writes.

    Parameters
    ----------
    model : str
        What it is called.
    placed : dict of str to pandis.runtime.scene.Placed
    meshes : dict of str to path-like
        The file of each object that has one.
    frictions : dict of str to float
        By object; of others MuJoCo has its own.
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
        raise ArtifactError(f"{path}: this is no scene of results/scenes: {error!r}") from error
    return placed, frictions


def _file(name, scene):
    """Return a file that a scene names: from where the workflow ran, which is here, or above it."""
    above = scene.resolve().parents
    places = [Path(name), *(folder / name for folder in above)]
    return next((place for place in places if place.is_file()), Path(name))


def _mesh_file(field, path, written):
    """Write the mesh of a field, or of the exact field beside it, once; None if neither has one."""
    beside = field.path if field.kind == MESH else field.path.with_name("exact.pandis")
    if not beside.is_file():
        return None
    if beside not in written:
        contents = read_contents(beside)
        corners = np.frombuffer(contents.sections["VERT"], "<f8").reshape(-1, 3)
        faces = np.frombuffer(contents.sections["FACE"], "<i4").reshape(-1, 3)
        file = path.with_name(f"{path.stem}-{len(written)}.obj")
        file.write_text(obj_text(contents.field.frame.to_mesh(corners), faces), encoding="ascii")
        written[beside] = file
    return written[beside]


def _under(parent, tags, **attributes):
    """Add an element, or one in another one, and return it."""
    for tag in tags.split("/"):
        parent = ElementTree.SubElement(parent, tag)
    for key, value in attributes.items():
        parent.set(key, value)
    return parent


def _numbers(values):
    return " ".join(repr(float(value)) for value in values)
