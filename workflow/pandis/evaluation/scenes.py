"""Scenes: several objects under one probe, tried before anybody holds the device.

A probe goes through the scene, from a place in one object to a place in another. Every force is
compared with that of asking every object, and the ticks are timed. For C there is a header with the
objects and where they lie.
"""

import json

import numpy as np
from scipy.spatial.transform import Rotation

from pandis.errors import PandisError
from pandis.geometry.frame import UNIT_SIDE
from pandis.native.runtime import NativeField
from pandis.native.scene import NativeScene, Placed
from pandis.run.machine import describe
from pandis.run.records.scene import PlacedRecord, SceneRecord

#: Ticks that are compared with asking every object, at most so many questions at a time.
_PIECE = 200_000


def try_scene(name, files, options, progress, log):
    """Go through a scene.

    Parameters
    ----------
    name : str
    files : list of Path
        ``results/{mesh}/export/{field}.pandis`` of all objects.
    options : pandis.run.tasks.SceneTask
    progress, log : callable
        Of a `pandis.run.stage.Job`.

    Returns
    -------
    arrays, attributes : dict
        As stored in the scene's artifact: the walk, forces, flags, how many fields were asked and
        the seconds of each tick.
    text : str
        ``{scene}.json``: the attributes.
    header : str
        ``{scene}.h``.

    Raises
    ------
    PandisError
        A force is not that of asking every object.
    """
    opened = {(path.parent.parent.name, path.stem): NativeField(path) for path in files}
    objects = [_place(own, opened[own.mesh, own.field]) for own in options.objects]
    points = walk(objects, options)
    scene = NativeScene(objects)
    found = scene.answer(points, timed=True)
    different = _compare(scene, points, found.force, progress)
    touched = found.force.any(axis=1)
    record = SceneRecord(
        objects=[
            _describe(own, placed) for own, placed in zip(options.objects, objects, strict=True)
        ],
        ticks=len(points),
        speed=options.speed,
        asked_mean=float(found.asked.mean()),
        asked_max=int(found.asked.max()),
        touched_share=float(touched.mean()),
        different=int(different),
        median_us=float(np.median(found.seconds) * 1e6),
        p999_us=float(np.percentile(found.seconds, 99.9) * 1e6),
        machine=describe(),
    )
    record = record.model_copy(update={"sentence": _sentence(record)})
    log(record.sentence)
    if different:
        raise PandisError(f"scene {name}: {record.sentence}")
    arrays = {
        "points": points,
        "force": found.force,
        "flag": found.flag,
        "asked": found.asked.astype(np.int32),
        "seconds": found.seconds,
    }
    text = json.dumps(record.attributes(), indent=2) + "\n"
    return arrays, record.attributes(), text, header(name, record.objects)


def _place(own, field):
    """Return an object of the configuration with its field, metres and newtons."""
    rotation = Rotation.from_rotvec(own.rotation, degrees=True).as_matrix()
    return Placed.at(field, own.size, own.stiffness, own.position, rotation)


def _describe(own, placed):
    return PlacedRecord(
        **dict(own),
        file=placed.field.path.as_posix(),
        rotation_matrix=placed.rotation.tolist(),
        translation=placed.translation.tolist(),
        scale=placed.scale,
    )


def walk(objects, options, period=1e-3):
    """Return the way (ticks, 3) of a probe from object to object, at a constant speed.

    Parameters
    ----------
    objects : list of pandis.native.scene.Placed
    options : pandis.run.tasks.SceneTask
    period : float
        Of a tick, s.
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


def _compare(scene, points, force, progress):
    """Return at how many points the scene's force is not that of asking every object."""
    piece = max(1, _PIECE // len(scene.objects))
    report, different = progress("compared", len(points), "ticks"), 0
    for start in range(0, len(points), piece):
        part = slice(start, start + piece)
        every = scene.ask_all(points[part])
        different += (force[part] != every).any(axis=1).sum()
        report.update(min(start + piece, len(points)))
    return different


def _sentence(found):
    count = len(found.objects)
    same = (
        f"{found.different:,} forces are not those of asking every object: a field's clearance "
        "was measured too small; export it again, or take another field"
        if found.different
        else "every force is that of asking every object"
    )
    return (
        f"{found.ticks:,} ticks at {found.speed:g} m/s, {100 * found.touched_share:.0f} % "
        f"in contact: {found.asked_mean:.2f} of {count} fields asked per tick, at most "
        f"{found.asked_max}; {found.median_us:.2g} µs a tick, p99.9 {found.p999_us:.2g}; "
        f"{same}"
    )


def header(name, objects):
    """Return the C header of a scene: the files to open, and where their objects lie."""
    own = name.replace("-", "_")
    files = list(dict.fromkeys(found.file for found in objects))
    rows = []
    for found in objects:
        numbers = ", ".join(repr(v) for row in found.rotation_matrix for v in row)
        place = ", ".join(map(repr, found.translation))
        tail = f"{found.scale!r}, {float(found.stiffness)!r}"
        comment = f"/* {found.name} */"
        rows.append(
            f"    {{{own}_fields + {files.index(found.file)}, {{{numbers}}}, {{{place}}}, "
            f"{tail}}}, {comment}"
        )
    listed = ",\n".join(f'    "{path}"' for path in files)
    return (
        f"/* The scene {name}, made by pandis: metres and newtons. Open its files in this order\n"
        f" * into {own}_fields, then pandis_scene_open({own}_objects, {own.upper()}_OBJECTS). */\n"
        '#include "pandis.h"\n\n'
        f"#define {own.upper()}_FILES {len(files)}\n"
        f"#define {own.upper()}_OBJECTS {len(objects)}\n\n"
        f"static const char *const {own}_files[] = {{\n{listed}\n}};\n"
        f"static pandis_field {own}_fields[{len(files)}];\n"
        f"static pandis_object {own}_objects[] = {{\n" + "\n".join(rows) + "\n};\n"
    )
