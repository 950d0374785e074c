"""The rows of one mesh: reads and repairs it, draws points, labels them, and shuffles them."""

import json
import lzma
import tarfile
import tempfile
import zipfile
import zlib
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pandis.base.errors import PandisError
from pandis.base.files import file_digest
from pandis.base.streams import generator
from pandis.pipeline.dataset.reading import ROWS
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.strata import STRATA, Strata
from pandis.pipeline.geometry.thickness import are_walls, inscribed_radius
from pandis.pipeline.mesh.build import build
from pandis.pipeline.mesh.diagnosis import FAULTS
from pandis.pipeline.mesh.fetch import fetch
from pandis.pipeline.run.ask.members import LARGEST, Member
from pandis.pipeline.run.ask.options import SampleOptions
from pandis.pipeline.run.ask.sourcing import (
    format_of,
    source_digest,
    source_files,
    url_extension,
)
from pandis.pipeline.run.ask.tasks import MeshTask
from pandis.pipeline.run.job.artifact import Artifact
from pandis.pipeline.run.job.stage import silent_progress
from pandis.pipeline.run.plan.stages import stage_seed
from pandis.pipeline.run.records.dataset import MeshFacts
from pandis.pipeline.run.records.mesh import MeshRecord

#: Bits of ``doubt``: two points of the surface are closest, so the normal is arbitrary; and the
#: wall below is thinner than the noise that moved the point, so it may be beyond the wall.
TIED, THIN = 1, 2
#: What the readers of archives raise for damage, passwords and unknown compression.
_DAMAGED = (EOFError, KeyError, RuntimeError, zipfile.BadZipFile, tarfile.TarError, zlib.error,
            lzma.LZMAError)  # fmt: skip
#: Stream of the order of the rows.
_ORDER = 32


class PassingError(PandisError):
    """A mesh cannot be read for a reason that may have passed by the next run."""


def _changed():
    return PassingError(
        "its file was changed after this run was planned; run the same command again"
    )


class Work(NamedTuple):
    """A mesh to label: its options (as of the stages `mesh` and `sample`), and where it goes.

    ``seed`` is the root of the data set's random numbers, ``builds`` and ``export`` are the options
    of fields (as in `ShardTask`), ``key`` is the digest of everything that the rows depend on,
    ``field_keys`` are those of the fields, and ``limits`` seconds and memory (GiB). ``before`` is
    an older shard that contains the mesh, and its place there.
    """

    member: Member
    mesh: dict
    samples: dict
    seed: int
    builds: dict | None = None
    export: dict | None = None
    key: str = ""
    field_keys: dict | None = None
    before: tuple | None = None
    output: str = ""
    limits: tuple = (300.0, 4.0)

    def to_json(self):
        """Return the work as a line of JSON."""
        return json.dumps(self._asdict())

    @classmethod
    def of_json(cls, line):
        """Return the work of a line of JSON."""
        values = json.loads(line)
        return cls(**values | {"member": Member(*values["member"])})


def mesh_rows(work, note):
    """Read, repair and label one mesh of a data set.

    Parameters
    ----------
    work : Work
    note : callable
        Receives the name of each stage that begins.

    Returns
    -------
    arrays : dict
        `pandis.pipeline.dataset.reading.ROWS`: points in the unit frame, exactly labelled as they
        are stored, in random order; ``MESH`` and empty ``FILES``.
    facts : pandis.pipeline.run.records.dataset.MeshFacts
    repaired : pandis.pipeline.run.job.artifact.Artifact
        The repaired mesh.

    Raises
    ------
    PandisError
        The mesh cannot be read or repaired.
    """
    note("read")
    member, seed = work.member, work.seed
    options = work.mesh | ({"unit": member.unit} if member.unit else {})
    with local_file(member) as path:
        task = MeshTask(**options, source=member.inside or member.source, sha256=None,
                        seed=stage_seed(seed, member.name, "mesh"))  # fmt: skip
        arrays, attributes = build(task, path, lambda text: note("repair"))
    repaired = Artifact("mesh", arrays, attributes)
    note("label")
    body = Body.open(repaired)
    samples = SampleOptions(**work.samples)
    drawn = stage_seed(seed, member.name, "sample")
    strata = Strata(body, samples, drawn, as_stored=True)
    rows = _labelled(body, strata, generator(stage_seed(seed, member.name, "rows"), _ORDER))
    facts = _facts(MeshRecord.of(repaired), body, strata.count)
    shape = {"vertices": body.vertices, "faces": body.faces, "files": np.empty(0, np.uint8)}
    return rows | shape, facts.model_copy(update={"key": work.key}), repaired


def _labelled(body, strata, rng):
    columns = strata.arrays(silent_progress)
    doubt = TIED * (columns["tied"] > 0) + THIN * _beyond_walls(body, columns)
    columns["doubt"] = doubt.astype(np.uint8)
    order = rng.permutation(strata.count)
    return {name: columns[name][order] for name in ROWS}


def _beyond_walls(body, columns):
    """Return a mask of the points that were moved farther than the wall below them is thick.

    The thickness is measured once for each face, below its middle.
    """
    moved = np.flatnonzero((columns["stratum"] == STRATA.index("near")) & (columns["face"] >= 0))
    beyond = np.zeros(len(columns["face"]), bool)
    if not len(moved):
        return beyond
    face = columns["face"][moved]
    base, _ = body.surface.at(face, columns["barycentrics"][moved])
    way = np.linalg.norm(columns["points"][moved] - base, axis=1)
    used, index = np.unique(face, return_inverse=True)
    middle, normal = body.surface.at(used, np.full((len(used), 2), 1 / 3, np.float32))
    farthest = np.zeros(len(used))  # a thicker wall cannot matter
    np.maximum.at(farthest, index, way / 2)
    radius = inscribed_radius(body.distance, middle, normal, largest=farthest)
    thin = radius < farthest
    wall = np.zeros(len(used), bool)
    wall[thin] = are_walls(body.distance, middle[thin], normal[thin], radius=radius[thin])
    beyond[moved] = (wall & thin)[index] & (2 * radius[index] < way)
    return beyond


def _facts(record, body, rows):
    """Return what the index says of a mesh."""
    source, solid = record.source, record.solid
    before, after = record.before, record.after
    invention = {"invented": record.caps}
    if solid:
        invention = {"kinds": solid.kinds, "invented": solid.invented, "sheets": solid.sheets,
                "openings": len(solid.doors) + len(solid.caps)}  # fmt: skip
    return MeshFacts(
        rows=rows,
        vertices=len(body.vertices),
        unit=source["unit"],
        format=source.get("format", ""),
        notes=source.get("notes", []),
        faults={words: before[kind] for kind, words in FAULTS.items() if before[kind]},
        repair=[rung.operation for rung in record.rungs if rung.kept],
        moved_percent=0.0 if record.shape else 100 * record.moved / after["diagonal"],
        faces_read=before["faces"],
        materials=len(body.regions.names) if body.regions else 0,
        centre=tuple(map(float, body.frame.centre)),
        scale=float(body.frame.scale),
        **{key: after[key] for key in ("faces", "components", "genus", "volume", "area")},
        **invention,
    )  # fmt: skip


@contextmanager
def local_file(member):
    """Yield the path of a member's file, fetched or unpacked into a temporary folder if need be.

    Raises
    ------
    PandisError
        The file is not the one of the plan.
    """
    if not member.inside and not url_extension(member.source):
        path = Path(member.source)
        if source_digest(source_files(path)) != member.digest:
            raise _changed()
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="pandis-") as folder:
        if member.inside:
            path = Path(folder) / f"mesh.{_ending(member.inside)}"
            _unpack(member, path)
        else:
            path = Path(folder) / f"mesh.{url_extension(member.source)}"
            path.write_bytes(_fetched(member))
        yield path


def _fetched(member):
    try:
        return fetch(member.source, member.digest, silent_progress)
    except PandisError as error:
        if error.__cause__ is None:  # it was fetched, and is another file
            raise
        raise PassingError(str(error)) from error


def _ending(name):
    return format_of(name) + (".gz" if name.lower().endswith(".gz") else "")


def _unpack(member, path):
    """Copy one file of an archive; its path in the archive is not used."""
    try:
        if member.source.lower().endswith(".zip"):
            with zipfile.ZipFile(member.source) as archive:
                info = archive.getinfo(member.inside)
                if member.digest != f"crc32 {info.CRC:08x} {info.file_size}":
                    raise _changed()
                with archive.open(info) as stream, path.open("wb") as target:
                    _copy(stream, target)
        else:
            stat = Path(member.source).stat()
            archive = _archive_digest(member.source, stat.st_size, stat.st_mtime_ns)
            if member.digest != f"{archive} {member.inside}":
                raise _changed()
            with tarfile.open(member.source) as archive:
                stream = archive.extractfile(member.inside)
                with stream, path.open("wb") as target:
                    _copy(stream, target)
    except _DAMAGED as error:
        raise PandisError(f"{member.source}: {member.inside} cannot be read ({error})") from error
    if member.sha256 and file_digest(path) != member.sha256:
        raise PandisError(f"its sha256 is {file_digest(path)}, but the table says {member.sha256}")


@lru_cache(4)
def _archive_digest(path, size, time):
    """Return the digest of an archive, once for all its meshes while it is unchanged."""
    del size, time  # only parts of the key
    return file_digest(path)


def _copy(stream, target):
    while block := stream.read(1 << 20):
        if target.tell() + len(block) > LARGEST:
            raise PandisError(f"it unpacks to more than {LARGEST >> 30} GiB")
        target.write(block)
