"""Tests scenes, in which one probe feels several objects, before anybody holds the device.

A probe moves through the scene, from a point in one object to a point in another. Every force is
compared with the one that results when all objects are queried, and the ticks are timed. A C
header lists the objects and their poses.
"""

import json

import numpy as np
from scipy.spatial.transform import Rotation

from pandis.base.errors import PandisError
from pandis.base.frame import UNIT_SIDE
from pandis.pipeline.judge.scene_header import scene_header
from pandis.pipeline.run.job.machine import describe
from pandis.pipeline.run.records.scene import PlacedRecord, SceneRecord, TouchedRecord
from pandis.runtime.contact import Material, NativeContact, TouchedScene
from pandis.runtime.contact.surfaces import (
    WHOLE,
    materials_for,
    texture_for,
    textures_for,
    unknown_materials,
)
from pandis.runtime.field import NativeField
from pandis.runtime.scene import NativeScene, Placed

#: Largest number of queries per call when all objects are queried for the comparison.
_PIECE = 200_000
#: Period of a tick, s.
_PERIOD = 1e-3


def try_scene(name, files, options, *, progress, log):
    """Move a probe through a scene, and check every force.

    Parameters
    ----------
    name : str
    files : list of Path
        ``results/{mesh}/export/{field}.pandis`` of all objects.
    options : pandis.pipeline.run.ask.tasks.SceneTask
    progress : pandis.base.progress.Progress
    log : pandis.base.progress.Log

    Returns
    -------
    arrays, attributes : dict
        As stored in the scene's artifact: the path, and the force, flag, number of
        fields queried and seconds of each tick.
    text : str
        Content of ``{scene}.json``: the attributes without the header ``{scene}.h``.

    Raises
    ------
    PandisError
        A force differs from the one that results when all objects are queried.
    """
    opened = {(path.parent.parent.name, path.stem): NativeField(path) for path in files}
    objects = [_place(option, opened[option.mesh, option.field]) for option in options.objects]
    points = walk(objects, options)
    scene = NativeScene(objects)
    answer = scene.answer(points, timed=True)
    different = _compare(scene, points, answer.force, progress=progress)
    touched = answer.force.any(axis=1)
    beside = [opened.get((option.mesh, option.beside)) for option in options.objects]
    described = list(map(_describe, options.objects, objects, beside))
    _check_names(options.objects, described, log)
    felt, proxies, no_proxies = _touch(
        objects, described, beside, points=points, radius=options.radius
    )
    record = SceneRecord(
        objects=described,
        ticks=len(points),
        speed=options.speed,
        asked_mean=float(answer.queries.mean()),
        asked_max=int(answer.queries.max()),
        touched_share=float(touched.mean()),
        different=int(different),
        median_us=float(np.median(answer.seconds) * 1e6),
        p999_us=float(np.percentile(answer.seconds, 99.9) * 1e6),
        proxies=proxies,
        no_proxies=no_proxies,
        machine=describe(),
    )
    record = record.model_copy(update={"sentence": _sentence(record)})
    log(record.sentence)
    if different or (proxies and proxies.different):
        raise PandisError(f"scene {name}: {record.sentence}")
    arrays = {
        "points": points,
        "force": answer.force,
        "flag": answer.flag,
        "asked": answer.queries.astype(np.int32),
        "seconds": answer.seconds,
    } | felt
    text = json.dumps(record.attributes(), indent=2) + "\n"
    header = scene_header(name, record.objects, options.radius)
    return arrays, record.attributes() | {"header": header}, text


def _place(option, field):
    """Return a configured object with its field, in metres and newtons."""
    rotation = Rotation.from_rotvec(option.rotation, degrees=True).as_matrix()
    return Placed.at(
        field, option.size, option.stiffness, position=option.position, rotation=rotation
    )


def _describe(option, placed, beside):
    names = placed.field.region_names or (beside.region_names if beside else ())
    return PlacedRecord(
        **dict(option),
        file=placed.field.path.as_posix(),
        beside_file=beside.path.as_posix() if beside else None,
        rotation_matrix=placed.rotation.tolist(),
        translation=placed.translation.tolist(),
        scale=placed.scale,
        materials=materials_for(option.contact, names),
        textures=textures_for(option.contact, names),
    )


def _check_names(objects, described, log):
    """Log configured materials that no object of the scene is made of."""
    known = {name for placed in described for name in placed.materials} - {WHOLE}
    unknown = {name for option in objects for name in unknown_materials(option.contact, known)}
    there = f"they name {', '.join(sorted(known))}" if known else "their files name no materials"
    for name in sorted(unknown):
        log(f"contact.materials.{name}: no object of the scene is made of it: {there}")


def _touch(objects, described, beside, *, points, radius):
    """Follow the path with proxies; return arrays, a `TouchedRecord` or None, and why None."""
    for option, placed in zip(described, objects, strict=True):
        if option.contact.kind == "penalty":
            return {}, None, f"{option.name}: contact.kind asks for penalty forces"
        try:
            NativeContact(placed, radius)
        except PandisError as error:
            return {}, None, f"{option.name}: {error}"
    materials = [
        [Material(**values) for values in option.materials.values()] for option in described
    ]
    textures = [texture_for(option.textures, option.scale) for option in described]
    scene = TouchedScene(objects, radius, materials, regions=beside, textures=textures)
    answer = scene.follow(points, _PERIOD, timed=True)
    every = scene.step_all(points, _PERIOD)
    record = TouchedRecord(
        radius=radius,
        queries_mean=float(answer.queries.mean()),
        queries_max=int(answer.queries.max()),
        touched_share=float((answer.touched > 0).mean()),
        different=int((answer.force != every).any(axis=1).sum()),
        median_us=float(np.median(answer.seconds) * 1e6),
        p999_us=float(np.percentile(answer.seconds, 99.9) * 1e6),
    )
    felt = {
        "proxy_force": answer.force,
        "proxy_asked": answer.queries.astype(np.int32),
        "proxy_seconds": answer.seconds,
    }
    return felt, record, ""


def walk(objects, options, period=_PERIOD):
    """Return a probe's path (ticks, 3), m, from object to object at a constant speed.

    Parameters
    ----------
    objects : list of pandis.runtime.scene.Placed
    options : pandis.pipeline.run.ask.tasks.SceneTask
    period : float
        Period of a tick, s.
    """
    rng, step = np.random.default_rng(0), options.speed * period
    stations, length = [], [0.0]
    while length[-1] <= step * options.ticks:
        placed = objects[rng.integers(len(objects))]
        inside = placed.field.frame.to_mesh(rng.uniform(-1, 1, 3) * UNIT_SIDE / 2)
        stations.append(placed.scale * placed.rotation @ inside + placed.translation)
        if len(stations) > 1:
            length.append(length[-1] + np.linalg.norm(stations[-1] - stations[-2]))
    at = step * np.arange(options.ticks)
    return np.stack([np.interp(at, length, axis) for axis in np.transpose(stations)], axis=1)


def _compare(scene, points, force, *, progress):
    """Count the points where the scene's force differs from that of querying all objects."""
    piece = max(1, _PIECE // len(scene.objects))
    report, different = progress("compared", len(points), "ticks"), 0
    for start in range(0, len(points), piece):
        part = slice(start, start + piece)
        every = scene.ask_all(points[part])
        different += (force[part] != every).any(axis=1).sum()
        report.update(min(start + piece, len(points)))
    return different


def _sentence(record):
    count = len(record.objects)
    different = record.different + (record.proxies.different if record.proxies else 0)
    same = (
        f"{different:,} forces differ from those of asking every object, because the measured "
        "clearance of a field is too small; export it again, or use another field"
        if different
        else "every force equals that of asking every object"
    )
    return (
        f"{record.ticks:,} ticks at {record.speed:g} m/s, {100 * record.touched_share:.0f} % "
        f"in contact: {record.asked_mean:.2f} of {count} fields asked per tick, at most "
        f"{record.asked_max}; {record.median_us:.2g} µs a tick, p99.9 {record.p999_us:.2g}; "
        f"{_proxies(record)}; {same}"
    )


def _proxies(record):
    proxies = record.proxies
    if proxies is None:
        return f"no proxies ({record.no_proxies})"
    return (
        f"through proxies {proxies.queries_mean:.2f} queries per tick, at most "
        f"{proxies.queries_max}, {proxies.median_us:.2g} µs, p99.9 {proxies.p999_us:.2g}"
    )
