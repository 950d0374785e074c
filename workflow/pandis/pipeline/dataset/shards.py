"""Shards: which mesh belongs to which, and how a shard is built from new and old meshes.

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
from pandis.pipeline.dataset.pool import Lost, Pool
from pandis.pipeline.dataset.reading import Shard
from pandis.pipeline.dataset.rows import MESH, ROWS
from pandis.pipeline.dataset.worker import failure, write_rows
from pandis.pipeline.run.ask.members import list_digest, members
from pandis.pipeline.run.ask.sharding import shard_of

#: Start, count of each mesh's rows, vertices and faces, in this order, in the array ``ranges``.
PARTS = ("rows", "vertices", "faces")
#: Facts of the plan, which may change without the rows.
_PLANNED = ("name", "source", "inside", "licence", "tags")


def member_key(task, code):
    """Return the digest of everything that the rows of a mesh depend on."""
    member = task["member"]
    parts = [member["name"], member["digest"], member["unit"], member["fault"],
             task["mesh"], task["samples"], task["seed"], code]  # fmt: skip
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


class ShardBuilder:
    """Builds one shard of a data set.

    Parameters
    ----------
    options : pandis.pipeline.run.ask.tasks.ShardTask
    path : path-like
        The shard's artifact.
    code : str
        Digest of the code.
    log : pandis.base.progress.Log
    """

    def __init__(self, options, path, *, code, log):
        self.options, self.path, self.log = options, Path(path), log
        self.before = self.path.parent / ".resume"
        self.folder = self.before / f"{options.shard:05}-of-{options.shards:05}"
        self.tasks = [self._task(member, code) for member in self._members()]
        self.facts = {}  # by key
        self.old = {}  # shards with rows of a mesh, by key

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

    def _task(self, member, code):
        override = self.options.override.get(member.name, {})
        task = {
            "member": member._asdict(),
            "mesh": self.options.mesh.model_dump() | override.get("mesh", {}),
            "samples": self.options.samples.model_dump() | override.get("samples", {}),
            "seed": self.options.seed,
        }
        key = member_key(task, code)
        return task | {"key": key, "output": str(self.folder / f"{key[:32]}.npz")}

    def compute(self, workers, progress):
        """Compute the meshes that neither an older shard nor an interrupted job has."""
        self.folder.mkdir(parents=True, exist_ok=True)
        self._look_back()
        todo = []
        for task in self.tasks:
            member, key = task["member"], task["key"]
            if member["fault"]:
                self.facts[key] = failure("plan", member["fault"])
            elif key not in self.facts and not self._resume(task):
                todo.append(task)
        self._sweep()
        finished = len(self.tasks) - len(todo)
        self.log(f"{len(self.tasks)} meshes, {len(todo)} of them to compute")
        report, start = progress("meshes", len(self.tasks), "meshes"), time.monotonic()
        report.resume(finished)
        pool = Pool(workers, seconds=self.options.seconds, memory_gb=self.options.memory_gb)
        for done, (task, answer) in enumerate(pool.answers(todo), finished + 1):
            self._take(task, answer)
            report.update(done)
        if todo:
            seconds = time.monotonic() - start
            self.log(f"{len(todo)} meshes in {seconds:.0f} s")

    def _take(self, task, answer):
        if isinstance(answer, Lost):
            facts = failure(answer.stage, str(answer)) | {"limits": self._limits}
            write_rows(task["output"], {}, facts | {"key": task["key"]})
        elif "facts" in answer:
            self.facts[task["key"]] = answer["facts"] | {"again": True}
            return
        if not self._resume(task):
            raise PandisError(f"{task['output']}: a worker's result is damaged; run again")
        failed = self.facts[task["key"]].get("failed")
        if failed:
            self.log(f"{task['member']['name']}: {failed['stage']}: {failed['reason']}")

    def _resume(self, task):
        """Read the facts of a mesh that was computed already; return whether there are any."""
        try:
            with np.load(task["output"]) as stored:
                facts = json.loads(str(stored["facts"]))
        except (OSError, ValueError, KeyError, EOFError):
            return False
        if not self._is_current(facts, task["key"]):
            return False
        self.facts[task["key"]] = facts
        return True

    @property
    def _limits(self):
        return [self.options.seconds, self.options.memory_gb]

    def _is_current(self, facts, key):
        """Return whether facts are those of a key, and would not change with these limits."""
        if facts.get("key") != key or facts.get("again"):
            return False
        return facts.get("limits", self._limits) == self._limits

    def _look_back(self):
        """Note which meshes the last versions of shards contain, whatever their number was."""
        names = {task["member"]["name"]: task["key"] for task in self.tasks}
        for path in sorted(self.before.glob("*.zarr.zip")):
            shard, _, shards = path.name.partition(".")[0].partition("-of-")
            shares = {shard_of(name, int(shards)) for name in names}
            if int(shard) not in shares:
                continue
            try:
                old = Shard(path, check=True)
            except PandisError:
                continue
            for index, facts in enumerate(old.meshes):
                key = names.get(facts["name"])
                if self._is_current(facts, key):
                    self.facts[key], self.old[key] = facts, (old, index)

    def _sweep(self):
        """Remove work of earlier plans."""
        current = {Path(task["output"]).name for task in self.tasks}
        for path in self.folder.iterdir():
            if path.name not in current:
                path.unlink()

    # --- the artifact ---------------------------------------------------------------------

    def columns(self):
        """Return the arrays' shapes, types and chunks, for `ArtifactWriter`."""
        self._ranges = np.array([self._range(task) for task in self.tasks], np.int64)
        ends = self._ranges.reshape(-1, len(PARTS), 2)
        chunk = self.options.chunk
        padded = -(-ends[:, 0, 1] // chunk) * chunk
        counts = {"rows": padded, "vertices": ends[:, 1, 1], "faces": ends[:, 2, 1]}
        self._padding = padded - ends[:, 0, 1]
        for k, name in enumerate(PARTS):
            ends[:, k, 0] = np.cumsum(counts[name]) - counts[name]
        columns = {"ranges": {"shape": self._ranges.shape, "dtype": np.int64}}
        for name, (shape, kind) in ROWS.items():
            size = int(padded.sum())
            columns[name] = {"shape": (size, *shape), "dtype": kind, "chunks": (chunk, *shape)}
        for name, (shape, kind) in MESH.items():
            columns[name] = {"shape": (int(counts[name].sum()), *shape), "dtype": kind}
        return columns

    def _range(self, task):
        facts = self.facts[task["key"]]
        counts = [facts.get(name, 0) for name in ("rows", "vertices", "faces")]
        return [value for count in counts for value in (0, count)]

    def pieces(self):
        """Yield the arrays of each mesh."""
        ranges = self._ranges
        for number, task in enumerate(self.tasks):
            arrays = self._arrays(task)
            piece = {name: np.concatenate([
                arrays[name],
                np.zeros((self._padding[number], *ROWS[name][0]), ROWS[name][1]),
            ]) for name in ROWS}  # fmt: skip
            piece |= {name: arrays[name] for name in MESH}
            yield piece | {"ranges": ranges[number : number + 1]}

    def _arrays(self, task):
        key = task["key"]
        if not self.facts[key].get("rows"):
            return {name: np.empty((0, *shape), kind)
                    for name, (shape, kind) in (ROWS | MESH).items()}  # fmt: skip
        if key in self.old:
            shard, index = self.old[key]
            return shard.arrays(index)
        with np.load(task["output"]) as stored:
            return {name: stored[name] for name in ROWS | MESH}

    def attributes(self):
        """Return the attributes: facts about every mesh, in the order of their names."""
        meshes = []
        for task in self.tasks:
            member = task["member"]
            facts = self.facts[task["key"]] | {"key": task["key"]}
            facts = {key: value for key, value in facts.items() if key not in _PLANNED}
            meshes.append({key: member[key] for key in _PLANNED} | facts)
        return {"meshes": meshes, "chunk": self.options.chunk}

    def remember(self):
        """Keep the new version for the next job, as another name of the same file."""
        name = f"{self.options.shard:05}-of-{self.options.shards:05}.zarr.zip"
        with suppress(OSError):  # a file system without hard links computes a shard anew
            (self.before / name).unlink(missing_ok=True)
            os.link(self.path, self.before / name)
        shutil.rmtree(self.folder)
