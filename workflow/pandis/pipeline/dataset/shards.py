"""Builds a shard of a data set from new meshes and from those of its last version.

Work in progress and the last version of every shard lie in ``.resume`` beside the shards, so that a
stopped job goes on, and a mesh is computed again only if it, its options or the code changed.
"""

import hashlib
import json
import os
import shutil
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

from pandis.base.errors import PandisError
from pandis.pipeline.dataset.fields import join_fields, missing_fields, only_fields
from pandis.pipeline.dataset.pool import Lost, Pool
from pandis.pipeline.dataset.reading import FILES, MESH, PARTS, ROWS, Shard, split_files
from pandis.pipeline.dataset.rows import Work
from pandis.pipeline.dataset.worker import failure, read_rows, write_rows
from pandis.pipeline.run.ask.members import list_digest, members
from pandis.pipeline.run.ask.sharding import shard_of
from pandis.pipeline.run.ask.sourcing import format_of
from pandis.pipeline.run.records.dataset import ShardRecord

#: Facts of the plan, which may change without the rows.
_PLANNED = ("name", "source", "inside", "licence", "tags")


def key_of(work, code):
    """Return the digest of everything that the rows of a mesh depend on."""
    form = format_of(work.member.inside or work.member.source)
    member = work.member._replace(source="", inside="", licence="", tags="")
    return _digest(member, form, work.mesh, work.samples, work.seed, code)


def field_key(work, name, code):
    """Return the digest of everything that the file of a field of a mesh depends on."""
    return _digest(work.key, name, work.builds[name], work.export, code)


def _digest(*parts):
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


#: Level of zstd for rows: random numbers are 4 % larger than at 5, and written in 0.4 of the time.
_LEVEL = 3
#: Why a field was not built whose turn did not come.
_LATER = {"reason": "not tried, because another field ended the process", "again": True}


class ShardBuilder:
    """Builds one shard of a data set.

    Parameters
    ----------
    options : pandis.pipeline.run.ask.tasks.ShardTask
    path : path-like
        The shard's artifact.
    code : callable
        Returns the digest of the code that rows and these fields, by name, depend on.
    log : pandis.base.progress.Log
    """

    def __init__(self, options, path, *, code, log):
        self.options, self.path, self.log = options, Path(path), log
        self.before = self.path.parent / ".resume"
        self.folder = self.before / f"{options.shard:05}-of-{options.shards:05}"
        codes = {name: code((name,)) for name in options.builds}
        self.works = [self._work(member, code(()), codes) for member in self._members()]
        self.facts = {}  # by key
        self.old = {}  # shards with rows of a mesh, and its place there, by key
        self._outdated = set()  # keys of meshes that older shards have by another key

    def _members(self):
        """Return the meshes of this shard; refuse others than those of the plan."""
        options = self.options
        listed = [member for member in members(options)
                  if shard_of(member.name, options.shards) == options.shard]  # fmt: skip
        if list_digest(listed) != options.members:
            raise PandisError(
                f"{options.source}: meshes were changed after this run was planned; run the same "
                "command again"
            )
        return listed

    def _work(self, member, code, codes):
        options, override = self.options, self.options.override.get(member.name, {})
        mesh = options.mesh.model_dump() | override.get("mesh", {})
        samples = options.samples.model_dump() | override.get("samples", {})
        work = Work(
            member, mesh, samples, options.seed, options.builds, options.export.model_dump()
        )
        work = work._replace(key=key_of(work, code), limits=tuple(self._limits))
        keys = {name: field_key(work, name, codes[name]) for name in work.builds}
        output = str(self.folder / f"{work.key[:32]}.npz")
        return work._replace(field_keys=keys, output=output)

    def compute(self, workers, progress):
        """Compute the meshes that neither an older shard nor an interrupted job has."""
        self.folder.mkdir(parents=True, exist_ok=True)
        self._look_back()
        todo, lacking = [], []
        for work in self.works:
            if work.member.fault:
                self.facts[work.key] = failure("plan", work.member.fault, key=work.key)
            elif not self._resume(work) and work.key not in self.facts:
                todo.append(work)
            elif missing_fields(work, self.facts[work.key]):
                anew = self.facts[work.key].materials  # only the source knows them
                (todo if anew else lacking).append(work._replace(before=self._place(work)))
        self._sweep()
        outdated = sum(work.key in self._outdated for work in todo)
        self.log(
            f"{len(self.works)} meshes, {len(todo)} of them to compute"
            + f" ({outdated} because the file, an option, the code or a package that it uses "
            "changed)" * (outdated > 0) + f"; {len(lacking)} lack fields" * (len(lacking) > 0)
        )
        todo += lacking
        finished = len(self.works) - len(todo)
        report, start = progress("meshes", len(self.works), "meshes"), time.monotonic()
        report.resume(finished)
        pool = Pool(workers, seconds=self.options.seconds, memory_gb=self.options.memory_gb)
        for done, (work, answer) in enumerate(pool.answers(todo), finished + 1):
            self._take(work, answer)
            report.update(done)
        if todo:
            self.log(f"{len(todo)} meshes in {time.monotonic() - start:.0f} s")

    def _take(self, work, answer):
        if isinstance(answer, Lost):
            why = {"again": True} if answer.killed else {"limits": self._limits}
            self._fail(work, answer.stage, {"reason": str(answer)} | why)
        elif answer:
            self._fail(work, *answer)
        if not self._resume(work, current=False):
            raise PandisError(f"{work.output}: a worker's result is damaged; run again")
        failed = self.facts[work.key].failed
        if failed:
            self.log(f"{work.member.name}: {failed.stage}: {failed.reason}")

    def _fail(self, work, stage, cause):
        """Write why a mesh came to nothing, or its rows with why a field did.

        Fields after the one at fault are left for the next run.
        """
        facts, arrays = self._rows(work)
        if facts is None:
            facts = failure(stage, **cause, key=work.key)
        else:
            missing, later = missing_fields(work, facts), _LATER
            at_fault = [name for name in missing if stage == f"field {name}"] or missing
            unbuilt = {name: cause if name in at_fault else later for name in missing}
            arrays, facts = join_fields(work, arrays, facts, files={}, unbuilt=unbuilt)
        write_rows(work.output, facts, arrays)

    def _rows(self, work):
        """Return facts and arrays of a mesh whose rows are known, else None twice."""
        facts, arrays = read_rows(work.output) or (None, None)
        if facts and not facts.failed and facts.key == work.key:
            return facts, arrays
        if work.key in self.old:
            shard, place = self.old[work.key]
            return shard.meshes[place], shard.arrays(place)
        return None, None

    def _resume(self, work, *, current=True):
        """Read the facts of a mesh that was computed already; return whether there are any.

        With ``current``, facts that another try may change do not count.
        """
        facts, _ = read_rows(work.output) or (None, None)
        if facts is None or (current and not self._is_current(facts, work.key)):
            return False
        if current and facts.failed and work.key in self.old:  # which may have its rows
            return False
        self.facts[work.key] = facts
        self.old.pop(work.key, None)
        return True

    def _place(self, work):
        """Return the older shard that contains the rows of a mesh, and its place there, or None."""
        shard, place = self.old.get(work.key, (None, 0))
        return shard and (str(shard.path), place)

    @property
    def _limits(self):
        return [self.options.seconds, self.options.memory_gb]

    def _is_current(self, facts, key):
        """Return whether the rows, or their lack, are those of a key and of these limits."""
        lasts = not facts.again and facts.limits in (None, self._limits)
        return facts.key == key and (lasts or not facts.failed)

    def _look_back(self):
        """Note which meshes the last versions of shards contain, whatever their number was."""
        names = {work.member.name: work.key for work in self.works}
        for path in sorted(self.before.glob("*.zarr.zip")):
            shard, _, shards = path.name.partition(".")[0].partition("-of-")
            if int(shard) not in {shard_of(name, int(shards)) for name in names}:
                continue
            try:
                old = Shard(path, check=True)
            except PandisError:
                continue
            for index, facts in enumerate(old.meshes):
                key = names.get(facts.name)
                if self._is_current(facts, key) and not (facts.failed and key in self.old):
                    self.facts[key], self.old[key] = facts, (old, index)
                elif key is not None and facts.key != key:
                    self._outdated.add(key)

    def _sweep(self):
        """Remove work of earlier plans."""
        current = {Path(work.output).name for work in self.works}
        for path in self.folder.iterdir():
            if path.name not in current:
                path.unlink()

    # --- the artifact ---------------------------------------------------------------------

    def columns(self):
        """Return the arrays' shapes, types and chunks, for `ArtifactWriter`."""
        self._ranges = np.array([self._range(work) for work in self.works], np.int64)
        ends = self._ranges.reshape(-1, len(PARTS), 2)
        chunk = self.options.chunk
        padded = -(-ends[:, 0, 1] // chunk) * chunk
        counts = {"rows": padded} | {name: ends[:, k, 1] for k, name in enumerate(PARTS) if k}
        self._padding = padded - ends[:, 0, 1]
        for k, name in enumerate(PARTS):
            ends[:, k, 0] = np.cumsum(counts[name]) - counts[name]
        columns = {"ranges": {"shape": self._ranges.shape, "dtype": np.int64}}
        for name, (shape, kind) in ROWS.items():
            size = int(padded.sum())
            columns[name] = {"shape": (size, *shape), "dtype": kind, "chunks": (chunk, *shape),
                             "level": _LEVEL}  # fmt: skip
        for name, (shape, kind) in (MESH | FILES).items():
            columns[name] = {"shape": (int(counts[name].sum()), *shape), "dtype": kind}
        return columns

    def _facts(self, work):
        return only_fields(work, self.facts[work.key])

    def _range(self, work):
        facts = self._facts(work)
        counts = facts.rows, facts.vertices, facts.faces, sum(facts.files.values())
        return [value for count in counts for value in (0, 0 if facts.failed else count)]

    def pieces(self):
        """Yield the arrays of each mesh."""
        for number, work in enumerate(self.works):
            arrays = self._arrays(work)
            for name, (shape, kind) in ROWS.items():
                rest = np.zeros((self._padding[number], *shape), kind)
                arrays[name] = np.concatenate([arrays[name], rest])
            yield arrays | {"ranges": self._ranges[number : number + 1]}

    def _arrays(self, work):
        if self.facts[work.key].failed:
            return {name: np.empty((0, *shape), kind)
                    for name, (shape, kind) in (ROWS | MESH | FILES).items()}  # fmt: skip
        facts, arrays = self._rows(work)
        files = split_files(facts.files, arrays["files"])
        chosen = [files[name] for name in self._facts(work).files]
        return arrays | {"files": np.concatenate([np.empty(0, np.uint8), *chosen])}

    def attributes(self):
        """Return the attributes: facts about every mesh, in the order of their names."""
        meshes = [
            self._facts(work).model_copy(
                update={key: getattr(work.member, key) for key in _PLANNED}
            )
            for work in self.works
        ]
        return ShardRecord(meshes=meshes, chunk=self.options.chunk).attributes()

    def remember(self):
        """Keep the new version for the next job, as another name of the same file."""
        name = f"{self.options.shard:05}-of-{self.options.shards:05}.zarr.zip"
        part = self.before / f"{name}.part"
        part.unlink(missing_ok=True)
        with suppress(OSError):  # a file system without hard links computes a shard anew
            os.link(self.path, part)
            part.replace(self.before / name)
        shutil.rmtree(self.folder)
