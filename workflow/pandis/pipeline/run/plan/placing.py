"""Scenes in the configuration: the placement of their objects, and the fields they need.

Like `pandis.pipeline.run.ask.config`, this module imports neither torch nor trimesh.
"""

import re
from functools import partial

from pandis.base.errors import ConfigError
from pandis.pipeline.run.ask.catalogue import MESH_NAME, parse_field
from pandis.pipeline.run.ask.config import SceneOptions
from pandis.pipeline.run.ask.contacts import SurfaceOptions
from pandis.pipeline.run.ask.faults import faults_of, name_faults, raise_faults
from pandis.pipeline.run.ask.kinds import KINDS
from pandis.pipeline.run.ask.reading import last_target, load_config, results_folder
from pandis.pipeline.run.ask.sourcing import source_fault
from pandis.pipeline.run.ask.tasks import PlacedObject, SceneTask
from pandis.pipeline.run.plan.datasets import plan_datasets


def load_scenes(raw, entries):
    """Validate the scenes of a configuration.

    Parameters
    ----------
    raw : dict
        The parsed YAML.
    entries : dict of str to pandis.pipeline.run.ask.config.MeshEntry
        A dict stands for the options of a mesh as they are written.

    Returns
    -------
    dict of str to pandis.pipeline.run.ask.config.SceneOptions

    Raises
    ------
    PandisError
        There are faults; the message lists all, each with its dotted path.
    """
    faults, scenes = {}, {}
    sections = raw.get("scenes") or {}
    if not isinstance(sections, dict):
        faults["scenes"] = "expected a mapping: {name: {objects: {name: {mesh: …, field: …}}}}"
        sections = {}
    for name, scene in sections.items():
        path = f"scenes.{name}"
        if not re.fullmatch(MESH_NAME, str(name)):
            faults[path] = "a scene's name must start with a-z; the rest may be a-z, 0-9, - or _"
            continue
        sections = scene if isinstance(scene, dict) else {"objects": scene}
        wrong = faults_of(SceneOptions, sections)
        faults |= {f"{path}.{key}" if key else path: message for key, message in wrong.items()}
        objects = sections.get("objects")
        for key, placed in objects.items() if isinstance(objects, dict) else ():
            if isinstance(placed, dict) and {"mesh", "field"} <= placed.keys():
                wrong_here = _object_faults(
                    f"{path}.objects.{key}", key, placed, entries=entries, listed=raw.get("meshes")
                )
                faults |= {at: why for at, why in wrong_here.items() if at not in faults}
        if wrong:
            continue
        scenes[name] = SceneOptions.model_validate(scene)
    raise_faults(faults)
    return scenes


def _object_faults(path, key, placed, *, entries, listed):
    if not re.fullmatch(MESH_NAME, str(key)):
        return {path: "an object's name must start with a-z; the rest may be a-z, 0-9, - or _"}
    mesh, field = str(placed["mesh"]), str(placed["field"])
    if mesh not in entries and isinstance(listed, dict) and mesh in listed:
        return {f"{path}.mesh": f"{mesh} cannot be built: correct it under `meshes`"}
    if mesh not in entries:
        return {f"{path}.mesh": f"there is no mesh {mesh} under `meshes`: add it there"}
    entry = entries[mesh]
    # the options of a mesh may be wrong, and reported elsewhere: then its recipes are as written
    values = entry if isinstance(entry, dict) else entry.model_dump()
    faults = name_faults(values | {"fields": [field]})
    fault = next((message for at, message in faults if at == "fields.0"), None)
    if fault is None and not isinstance(entry, dict) and not parse_field(field, entry.train).native:
        fault = f"{field} has no file for pandis.h: use a grid, a spline, a network or exact"
    return {f"{path}.field": fault} if fault else {}


def needed(entries, scenes):
    """Return the meshes that scenes need, each with only the needed fields.

    Without scenes, return everything.
    """
    if not scenes:
        return entries
    fields = {}
    for scene in scenes.values():
        for placed in scene_task(scene, entries).objects:
            names = fields.setdefault(placed.mesh, [])
            names += [n for n in (placed.field, placed.beside) if n and n not in names]
    return {
        mesh: entry.model_copy(update={"fields": fields[mesh]})
        for mesh, entry in entries.items()
        if mesh in fields
    }


def scene_task(scene, entries):
    """Return the options of a scene's stage: its objects with all defaults filled in."""
    objects = []
    for name, placed in scene.objects.items():
        entry = entries[placed.mesh]
        overrides = {key: value for key, value in dict(placed).items() if value is not None}
        contact = scene.contact or SurfaceOptions(
            **{key: getattr(entry.contact, key) for key in SurfaceOptions.model_fields}
        )
        beside = _knows_regions(entry, placed.field) if contact.materials else None
        felt = {"name": name, "contact": contact, "beside": beside}
        objects.append(PlacedObject(**dict(entry.device) | overrides | felt))
    return SceneTask(objects=objects, ticks=scene.ticks, speed=scene.speed, radius=scene.radius)


def _knows_regions(entry, name):
    """Return the name of another field of the mesh whose file contains the materials, or None.

    Return None if the file of ``name`` itself contains them, or if no file does. A compact mesh is
    preferred to the exact one.
    """
    with_regions = [kind for kind, row in KINDS.items() if row.regions]
    if parse_field(name, entry.train).kind in with_regions:
        return None
    specs = (parse_field(each, entry.train) for each in entry.fields)
    known = sorted((s.kind, s.name) for s in specs if s.kind in with_regions)
    return known[0][1] if known else None


def _as_written(config, entry):
    """Return the recipes and targets of a mesh without checks, for the names of its fields."""
    entry = entry if isinstance(entry, dict) else {}
    parts = {key: {} for key in ("train", "budget", "bake")}
    for source in (config, entry):
        for key, part in parts.items():
            value = source.get(key)
            part.update(value if isinstance(value, dict) else {})
    return parts


def all_faults(config, digests):
    """Return every fault of a configuration, including missing files, whichever part reports it."""
    meshes, faults = config.get("meshes"), {}
    meshes = meshes if isinstance(meshes, dict) else {}
    written = {name: _as_written(config, entry) for name, entry in meshes.items()}
    readers = (results_folder, last_target, load_config,
               partial(plan_datasets, digests=digests),
               partial(load_scenes, entries=written))  # fmt: skip
    for reader in readers:
        try:
            reader(config)
        except ConfigError as error:
            faults |= error.faults
    for name, entry in meshes.items():
        source = entry.get("source") if isinstance(entry, dict) else None
        fault = source_fault(source) if isinstance(source, str) else None
        if fault:
            key, _, why = fault.partition(": ")
            faults[f"meshes.{name}.{key}"] = why
    return faults
