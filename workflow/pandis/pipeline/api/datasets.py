"""Labels many meshes into one store, with the workflow's own stages."""

import fcntl
import json
import os
from contextlib import contextmanager
from os import PathLike
from pathlib import Path

from pandis.base.errors import ArtifactError, ConfigError, PandisError
from pandis.base.files import write_atomically
from pandis.base.progress import Log
from pandis.base.workflow import workflow_folder
from pandis.pipeline.api.options import sections
from pandis.pipeline.api.running import Script, run
from pandis.pipeline.dataset.reading import Shard, read_provenance
from pandis.pipeline.dataset.store import LabelStore
from pandis.pipeline.run.ask.config import plain
from pandis.pipeline.run.ask.datasets import DatasetOptions
from pandis.pipeline.run.ask.faults import faults_of, raise_faults
from pandis.pipeline.run.job.artifact import check_seal
from pandis.pipeline.run.job.provenance import CodeDigests, needs
from pandis.pipeline.run.plan.datasets import dataset_task, option_faults, plan_dataset, shard_task

#: Options of a data set that can be passed by their names, beside those of `mesh` and `samples`.
PLAIN = ("table", "fields", "override", "shards", "chunk", "seconds", "memory_gb")
#: Options with which a store was begun; another set of them is refused.
_OPTIONS = "options.json"
#: Locked while a process writes the store.
_LOCK = ".lock"
#: Files that cover the whole store.
_WHOLE = ("index.zarr.zip", "card.html", "card.json")


def label_meshes(
    source: str | PathLike[str],
    store: str | PathLike[str],
    *,
    workers: int | None = None,
    force: bool = False,
    log: Log | None = None,
    **options: object,
) -> LabelStore:
    """Repair and label every mesh of a folder, list, table or archive, and store the rows.

    A call that was stopped goes on where it was. A mesh that fails is listed in the store with the
    reason, and is tried again only if its file, the options or the code change.

    Parameters
    ----------
    source : path-like
        See `datasets` in config/README.md.
    store : path-like
        The folder to write, such as ``parts.zarr``.
    workers : int, optional
        Meshes at a time; by default one per core.
    force : bool
        Whether to go on in a store that was made with other options, and to replace the rows that
        they change.
    log : callable, optional
        Receives lines about the progress.
    **options
        Options of a data set (`table`, `fields`, `override`, `shards`, `chunk`, `seconds`,
        `memory_gb`), of `mesh` and `samples`, and ``seed``.

    Raises
    ------
    PandisError
        The source cannot be read, an option is wrong, or the store was made with other options.
    """
    if workers is not None and not (type(workers) is int and workers >= 1):
        why = f"expected a whole number from 1, not {workers!r}"
        raise ConfigError(f"workers: {why}", {"workers": why})
    config = {key: options.pop(key) for key in PLAIN if key in options}
    config |= sections(options, ("mesh", "samples")) | {"source": os.fspath(source)}
    raise_faults(faults_of(DatasetOptions, config))
    dataset = DatasetOptions.model_validate({"seed": 0} | config)
    raise_faults(option_faults(dataset))
    folder, log = Path(store), log or (lambda text: None)
    name = folder.stem
    planned = plan_dataset(name, dataset)
    _make_folder(folder)
    with _alone(folder):
        _begin(folder, dataset, force=force)
        return _label(planned, folder, workers=workers, log=log)


def _label(planned, folder, *, workers, log):
    name = planned.name
    tasks = [shard_task(planned, number) for number in range(len(planned.shards))]
    count = sum(map(len, planned.shards))
    log(f"{count} meshes in {len(tasks)} {'shards' if len(tasks) > 1 else 'shard'}")
    paths = [folder / f"shards/{number:05}.zarr.zip" for number in range(len(tasks))]
    for number, (path, task) in enumerate(zip(paths, tasks, strict=True)):
        wildcards = {"dataset": name, "shard": f"{number:05}"}
        script = Script("shard", wildcards, [path], folder=folder, options=plain(task))
        script.threads = workers or len(os.sched_getaffinity(0))
        _build(script, log, always=_may_succeed(path))
    outputs = [folder / file for file in _WHOLE]
    script = Script("dataset", {"dataset": name}, outputs, folder=folder,
                    options=plain(dataset_task(planned)))  # fmt: skip
    script.input.update(enumerate(map(str, paths)))
    _build(script, log, always=True)
    return LabelStore(folder)


@contextmanager
def _alone(folder):
    """Hold the store while it is written.

    Raises
    ------
    PandisError
        Another process holds it.
    """
    with (folder / _LOCK).open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            why = f"{folder}: another process is writing this store; wait for it"
            raise PandisError(why) from None
        yield


def _make_folder(folder):
    """Make the folder of a store; refuse a folder that contains something else."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        others = {path.name for path in folder.iterdir()} - {_LOCK}
    except OSError as error:
        raise PandisError(f"{folder}: cannot be written: {error.strerror}") from error
    if others and _OPTIONS not in others:
        raise PandisError(f"{folder} contains other files than a store; name a new folder")


def _begin(folder, dataset, *, force):
    """Refuse a store of other options, further fields apart; note the options of a new one."""
    begun = folder / _OPTIONS
    values = plain(dataset.model_dump(exclude={"seconds", "memory_gb", "shards"}))
    place, before = os.path.realpath(dataset.source), _options_of(begun)
    if before is not None and before.pop("place", None) == place:
        before["source"] = values["source"]  # the same, however it is spelled
    if before and set(before.get("fields") or ()) <= set(values["fields"]):
        before["fields"] = values["fields"]  # further fields replace nothing
    if before not in (None, values):
        if not force:
            raise PandisError(
                f"{folder} was made with other options ({_differences(before, values)}); name "
                "another folder, or go on with --force (force=True), which replaces the rows that "
                "these options change"
            )
        for name in _WHOLE:
            (folder / name).unlink(missing_ok=True)
    text = json.dumps(values | {"place": place}, indent=1) + "\n"
    write_atomically(begun, text.encode())


def _options_of(path):
    """Return the options in a file; None if there is no file, and none if it is damaged."""
    try:
        options = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None
    except ValueError:
        return {}
    return options if options is None or isinstance(options, dict) else {}


def _differences(before, now):
    if not before:
        return _OPTIONS
    names = []
    for key in now:
        if isinstance(now[key], dict) and isinstance(before.get(key), dict):
            names += [f"{key}.{k}" for k in now[key] if now[key][k] != before[key].get(k)]
        elif now[key] != before.get(key):
            names.append(key)
    return ", ".join(names)


def _build(script, log, *, always=False):
    """Run a script unless its output is there, of the same options and code."""
    options = json.loads(json.dumps(script.params["options"]))
    digests = CodeDigests(workflow_folder())
    script.params["code"] = digests.stage(script.script, needs(options))
    output = Path(script.output[0])
    stored = read_provenance(output)
    same = stored is not None and stored["options"] == options
    same = same and stored["code"]["digest"] == script.params["code"] and _is_whole(output)
    if always or not same:
        output.parent.mkdir(parents=True, exist_ok=True)
        run(script, log)


def _may_succeed(path):
    """Return whether a mesh of a shard failed for a reason that may have passed."""
    try:
        return any(mesh.again for mesh in Shard(path).meshes)
    except ArtifactError:
        return True


def _is_whole(path):
    try:
        check_seal(path)
    except ArtifactError:
        return False
    return True
