"""Checks whether a mesh has an inside, and says what is wrong with it if not."""

import json
from dataclasses import asdict, dataclass
from importlib.util import find_spec

import numpy as np

from pandis.base.errors import PandisError
from pandis.pipeline.api.options import sections
from pandis.pipeline.api.sources import source_of
from pandis.pipeline.geometry.shapes import find_shape
from pandis.pipeline.mesh.diagnosis import FAULTS, diagnose
from pandis.pipeline.mesh.forecast import forecast
from pandis.pipeline.mesh.formats import FormatError, Reading
from pandis.pipeline.mesh.intake import check_arrays, find_file, read_mesh
from pandis.pipeline.mesh.places import fault_places
from pandis.pipeline.mesh.topology import compact, same_place, used_vertices
from pandis.pipeline.run.ask.faults import faults_of, raise_faults
from pandis.pipeline.run.ask.options import MeshOptions
from pandis.pipeline.run.ask.sourcing import ANALYTIC, format_of

#: Rough costs on one core: seconds of a process and its imports, and per million faces of reading
#: and diagnosing a mesh, of its lossless repair, of its slow repair, and of `compact-auto`.
_START, _READ, _LOSSLESS, _SLOW, _FIELD = 1.5, 20.0, 60.0, 100.0, 100.0
#: Typical seconds of the rungs that a forecast does not run. A ladder that is stuck from its first
#: rung on usually climbs far.
_RUNGS, _FAR = 3.0, 20.0


@dataclass(frozen=True)
class Report:
    """What `check` found.

    Attributes
    ----------
    source : str
    vertices, faces, components : int
    unit : str
        As the file says it, or ``unknown``.
    size : list of float
        Extents of the bounding box, mesh units.
    area : float
    volume : float or None
        None unless the mesh is valid.
    wall : dict or None
        Smallest and first percentile of the thickness (``min``, ``p1``) along inward rays, mesh
        units; None unless the mesh is valid.
    faults : dict of str to int
        Counts by kind; empty if the mesh is valid.
    places : dict of str to list
        Some places of these faults, mesh units.
    holes : list of dict
        Edges and length of each open rim, the longest first.
    repair : str
        ``nothing`` to do; ``lossless``: faults go away without moving the surface; ``repair``:
        `begins_with` and later rungs of the ladder will be tried; ``refusal``: `message` says why.
    begins_with, message : str
    option : dict
        Options with which a refused mesh would be repaired, such as ``{"open": "cap"}``.
    seconds : dict of str to float
        Rough estimates on one core for ``repair`` and ``field`` (`compact-auto`).
    notes : list of str
        Remarks of the reader.
    """

    source: str
    vertices: int
    faces: int
    components: int
    unit: str
    size: list
    area: float
    volume: float | None
    wall: dict | None
    faults: dict
    places: dict
    holes: list
    repair: str
    begins_with: str
    message: str
    option: dict
    seconds: dict
    notes: list

    @property
    def ok(self) -> bool:
        """Whether the mesh is valid as it is."""
        return not self.faults

    @property
    def fit(self) -> bool:
        """Whether a field can be made of it with these options, as far as is known."""
        return self.repair != "refusal"

    def to_json(self) -> str:
        """Return the report as JSON."""
        return json.dumps(asdict(self) | {"ok": self.ok, "fit": self.fit}, indent=2)

    def __str__(self) -> str:
        size = " x ".join(f"{side:.4g}" for side in self.size)
        unit = "" if self.unit == "unknown" else f" {self.unit}"
        sizes = {"face": self.faces, "component": self.components}
        counts = [f"{count:,} {name}{'s' * (count != 1)}" for name, count in sizes.items()]
        verdict = "valid" if self.ok else "not valid"
        lines = [f"{self.source}: {verdict}; {', '.join(counts)}, {size}{unit}"]
        if self.unit == "unknown":
            lines.append("  unit unknown: say what a length of 1 means to whoever uses it")
        if self.wall:
            lines.append(
                f"  thickness: at least {self.wall['p1']:.3g}{unit} below 99 % of the surface; "
                f"{self.wall['min']:.3g}{unit} at the thinnest of 2,000 rays"
            )
        for kind, count in self.faults.items():
            near = ", ".join("(" + ", ".join(f"{x:.4g}" for x in p) + ")"
                             for p in self.places.get(kind, [])[:2])  # fmt: skip
            lines.append(f"  {count:,} {FAULTS[kind]}" + (f", as at {near}" if near else ""))
        lines += [f"  {note}" for note in self.notes]
        says = {
            "nothing": "nothing to repair",
            "lossless": "repair: without moving the surface",
            "repair": f"repair: by the ladder from `{self.begins_with}` on, if the result stays "
            "near the source",
            "refusal": f"repair: refused: {self.message}",
        }
        lines.append("  " + says[self.repair])
        if self.fit:
            most = ", if no rung is slow" if self.repair == "repair" else ""
            lines.append(
                "  about {repair:.0f} s to repair, {field:.0f} s for a field".format(**self.seconds)
                + most
            )
        return "\n".join(lines)


def check(mesh: object, /, **options: object) -> Report:
    """Find everything about a mesh that a signed distance cannot have, and what repair would do.

    Nothing is changed or written.

    Parameters
    ----------
    mesh : path-like, pair of arrays, or object
        See `pandis.pipeline.api.sources.source_of`.
    **options
        Options of `mesh` in a configuration, with which a repair is forecast, and ``seed``.

    Raises
    ------
    PandisError
        The mesh cannot be read.
    """
    source = source_of(mesh)
    config = sections(options, ("mesh",))
    values = config.get("mesh", {})
    raise_faults({f"mesh.{key}": why for key, why in faults_of(MeshOptions, values).items()})
    wishes = MeshOptions.model_validate(values)
    if source.text.startswith(ANALYTIC):
        reading = Reading(*find_shape(source.text.removeprefix(ANALYTIC)).tessellation())
    elif source.arrays is None:
        limits = {"seconds": wishes.reader_seconds, "memory_gb": wishes.reader_memory_gb}
        reading, _ = read_mesh(source.text, find_file(source.text), **limits)
    else:
        try:
            check_arrays(*source.arrays)
        except FormatError as error:
            raise PandisError(f"{source.text}: {error}") from None
        reading = Reading(*source.arrays)
    vertices, faces, notes = reading.vertices, reading.faces, list(reading.notes)
    if format_of(source.text) == "stl":  # it has no other way to share a vertex
        vertices, faces = compact(vertices, same_place(vertices)[faces])
    diagnosis = diagnose(vertices, faces)
    ahead = forecast(vertices, faces, wishes, diagnosis=diagnosis, seed=config.get("seed", 0))
    millions = len(faces) / 1e6
    missing = [name for name in ("pymeshlab", "pymeshfix") if find_spec(name) is None]
    if missing and ahead.outcome in ("repair", "refusal"):
        notes.append(
            f"{' and '.join(missing)}: not installed, so the rungs meshfix and wrap cannot run: "
            "pip install 'pandis-fields[make,repair]'"
        )
    repair = {"nothing": 0.0, "lossless": _LOSSLESS, "repair": _SLOW, "refusal": 0.0}
    seconds = _START + (_READ + repair[ahead.outcome]) * millions
    if ahead.outcome == "repair":
        seconds += _FAR if ahead.begins_with == "clean" else _RUNGS
    places = fault_places(vertices, faces, diagnosis)
    return Report(
        source=source.text,
        vertices=len(vertices),
        faces=len(faces),
        components=diagnosis.components,
        unit=reading.unit if wishes.unit == "unknown" else wishes.unit,
        size=np.ptp(vertices[used_vertices(faces)], axis=0).tolist(),
        area=diagnosis.area,
        volume=diagnosis.volume if diagnosis.valid else None,
        wall=diagnosis.wall,
        faults={name: getattr(diagnosis, name) for name in FAULTS
                if getattr(diagnosis, name)},
        places={name: where.tolist() for name, where in places.items()},
        holes=diagnosis.holes,
        repair=ahead.outcome,
        begins_with=ahead.begins_with,
        message=ahead.message,
        option=ahead.option,
        seconds={"repair": seconds, "field": seconds + _START + _FIELD * millions},
        notes=notes,
    )  # fmt: skip
