"""Tests fields through a proxy: query times, passes through walls, and safe stiffnesses."""

from functools import partial
from typing import NamedTuple

import numpy as np

from pandis.base.errors import PandisError
from pandis.base.frame import UNIT_SIDE
from pandis.base.streams import PRESSES, generator
from pandis.pipeline.judge.servo.devices import DEVICES
from pandis.pipeline.judge.servo.passes import ABOVE, draw, free_starts, judge, run
from pandis.pipeline.judge.servo.pressing import Contact, Setup, press
from pandis.pipeline.judge.servo.verdict import proxy_sentence, proxy_verdict
from pandis.pipeline.run.ask.catalogue import known_field
from pandis.pipeline.run.ask.kinds import KINDS
from pandis.pipeline.run.records.hardware import ProxyVerdict, TouchVerdict, WallVerdict
from pandis.runtime.contact import BEHIND, TOUCHING, Feel, Material, NativeContact
from pandis.runtime.contact.surfaces import materials_for, texture_for, textures_for
from pandis.runtime.field import NativeField
from pandis.runtime.scene import Placed

#: LEAST and MOST bound the budget of queries per tick, which may take the share SHARE of the
#: deadline.
LEAST, MOST, SHARE = 8, 24, 0.5
#: Largest angle between a press and the normal, rad.
_SLANT = 0.3


class Surfaces(NamedTuple):
    """Properties of an object's materials, and its textures, by name, as stored in a report."""

    materials: dict
    textures: dict


class Truth(NamedTuple):
    """Reference by which a field's proxy on a mesh is judged.

    Attributes
    ----------
    oracle : pandis.pipeline.judge.servo.passes.Oracle
        Oracle of the mesh in the device's workspace.
    feet : ndarray, shape (n, 3), m
        Surface points where the field's error is measured. Points at which the field has no force
        are left out, so that a hole in the field does not excuse a pass through it.
    surface : pandis.pipeline.judge.servo.pressing.Contact
        Where devices press.
    walls : pandis.pipeline.run.records.hardware.WallVerdict
    """

    oracle: object
    feet: np.ndarray
    surface: Contact
    walls: WallVerdict

    def error(self, field, size):
        """Return the largest error of a field at the surface, m.

        If the object is a closed form, the error of its mesh is included.
        """
        if not len(self.feet):
            return 0.0
        metres = size / UNIT_SIDE
        answer = field.query(field.frame.to_mesh(self.feet / metres))
        off = (
            np.abs(answer.distance) * field.frame.scale * metres,
            np.abs(self.oracle.look(self.feet)[0]),
        )
        return float(off[0].max() + off[1].max())


def feel_for(field, beside, contact, *, size, seconds, deadline):
    """Return the proxy settings with which a field is tested.

    Parameters
    ----------
    field : pandis.runtime.field.NativeField
    beside : pandis.runtime.field.NativeField or None
        Mesh of the same object, whose regions are used if the field has none.
    contact : pandis.pipeline.run.ask.contacts.ContactOptions
    size : float
        Longest side, m.
    seconds, deadline : float
        Time of a query on this machine, and the deadline of a tick, s.

    Returns
    -------
    feel : pandis.runtime.contact.Feel or None
        None if there is no proxy.
    surfaces : Surfaces or None
        None if there is no proxy.
    lacks : str
        Why there is no proxy; empty if there is one.
    """
    if contact.kind == "penalty":
        return None, None, "contact.kind asks for penalty forces"
    try:
        NativeContact(Placed.at(field, 1.0, 1.0))
    except PandisError as error:
        return None, None, str(error)
    regions = None if field.region_names else beside
    names = field.region_names or (regions and regions.region_names)
    materials, textures = materials_for(contact, names), textures_for(contact, names)
    fit = int(SHARE * deadline / seconds) if seconds > 0 else MOST
    queries = contact.queries or min(max(fit, LEAST), MOST)
    surfaces = tuple(Material(**values) for values in materials.values())
    texture = texture_for(textures, Placed.at(field, size, 1.0).scale)
    return (
        Feel(contact.radius, surfaces, regions, queries, texture),
        Surfaces(materials, textures),
        "",
    )


def regions_among(exports):
    """Return an exported mesh that names the materials of its faces, or None.

    Parameters
    ----------
    exports : iterable of Path
    """
    knowing = [name for name, kind in KINDS.items() if kind.regions]
    meshes = [path for path in exports if known_field(path.stem).kind in knowing]
    for path in sorted(meshes, key=lambda path: path.stem):  # compact meshes first
        field = NativeField(path)
        if field.region_names:
            return field
    return None


def felt_again(field, verdict, size, *, folder):
    """Return the probe and surface with which a field was validated.

    Parameters
    ----------
    field : pandis.runtime.field.NativeField
    verdict : pandis.pipeline.run.records.hardware.ProxyVerdict
    size : float
        Longest side, m.
    folder : Path
        Folder of exported files, one of which may name the materials of faces.

    Raises
    ------
    pandis.base.errors.PandisError
        There are several materials, and no file in the folder names the materials of faces.
    """
    materials = tuple(Material(**values) for values in verdict.materials.values())
    beside = None
    if len(materials) > 1 and not field.region_names:
        beside = regions_among(folder.glob("*.pandis"))
        if beside is None:
            raise PandisError(
                f"{folder}: the proxy was validated with the materials "
                f"{', '.join(verdict.materials)}, and no file here names the materials of "
                "faces; put exact.pandis or the compact file of the same run beside the field"
            )
    texture = texture_for(verdict.textures, Placed.at(field, size, 1.0).scale)
    return Feel(verdict.radius, materials, beside, verdict.budget, texture)


def time_proxy(field, feel, surfaces, *, path, options):
    """Time a field's proxy along a path. The verdict's ``devices`` are left empty.

    Parameters
    ----------
    field : pandis.runtime.field.NativeField
    feel, surfaces
        From `feel_for`.
    path : ndarray, shape (n, 3), m
        Path of the probe, one point per tick, starting outside.
    options : pandis.pipeline.run.ask.tasks.ValidateTask

    Returns
    -------
    pandis.pipeline.run.records.hardware.ProxyVerdict
    """
    placed = Placed.at(field, options.size, options.stiffness)
    followed = []
    for _ in range(2):
        contact = NativeContact(
            placed, feel.radius, feel.materials, regions=feel.regions, texture=feel.texture
        )
        contact.set(budget=feel.queries)
        followed.append(contact.follow(path, 1 / options.rate, timed=True))
    touches = followed[0]
    # the shorter time of two equal runs: other programs may have delayed one
    seconds = np.minimum(*(each.seconds for each in followed))
    missed = float((seconds > options.deadline).mean())
    touching = float(((touches.state & TOUCHING) > 0).mean())
    return ProxyVerdict(
        radius=feel.radius,
        **surfaces._asdict(),
        budget=feel.queries,
        queries=_levels(touches.queries),
        compute_us=_levels(1e6 * seconds),
        miss_share=missed,
        in_time=bool(touching and missed <= options.misses),
        touching_share=touching,
        behind_share=float(((touches.state & BEHIND) > 0).mean()),
        devices={},
    )


def touch_devices(field, feel, truth, *, options, safe=None):
    """Press every configured device through a proxy; return verdicts by its name.

    ``safe`` has the last argument of `touch_device` by device, if it is known.
    """
    safe = safe or {}
    return {
        name: touch_device(name, field, feel, truth=truth, options=options, safe=safe.get(name))
        for name in options.devices
    }


def touch_device(name, field, feel, *, truth, options, safe=None):
    """Press a simulated device onto a field through a proxy, gently and with full force.

    ``safe`` is as in `pandis.pipeline.judge.servo.pressing.press`.
    """
    spec, surface = DEVICES[name], truth.surface
    pressed = press(field, spec, surface, setup=Setup.of(options), feel=feel, safe=safe)
    error = truth.error(field, options.size)
    rng = generator(options.seed, PRESSES)
    above = ABOVE + feel.radius
    places = surface.hard_feet, surface.hard_outward
    presses = draw(places, spec, pressed.stiffness, slant=_SLANT, rng=rng, above=above)
    presses = free_starts(presses, truth.oracle, above)
    run_presses = partial(
        run, field, spec, options.size, stiffness=pressed.stiffness, presses=presses
    )
    judged = judge(run_presses(feel=feel), truth.oracle, error, radius=feel.radius)
    other = judge(run_presses(), truth.oracle, error, detours=False)
    touched = TouchVerdict(
        **dict(pressed),
        device=name,
        presses=judged.presses,
        passes=judged.passed,
        penalty_passes=other.passed,
        deepest_m=judged.deepest,
        holds=truth.walls.holds,
    )
    words = {"verdict": proxy_verdict(touched), "sentence": proxy_sentence(touched)}
    return touched.model_copy(update=words)


def _levels(values):
    return {f"p{q:g}": float(np.percentile(values, q)) for q in (50, 99, 99.9)} | {
        "max": float(np.max(values))
    }
