"""The data sets of a configuration: their options, meshes, shards and outputs."""

import re
from pathlib import Path
from typing import NamedTuple

from pandis.base.errors import PandisError
from pandis.pipeline.run.ask.catalogue import MESH_NAME, known_field
from pandis.pipeline.run.ask.config import MeshEntry, plain
from pandis.pipeline.run.ask.datasets import LABELS, DatasetOptions
from pandis.pipeline.run.ask.faults import faults_of, raise_faults
from pandis.pipeline.run.ask.kinds import KINDS
from pandis.pipeline.run.ask.members import list_digest, members
from pandis.pipeline.run.ask.options import MeshOptions, NativeOptions, SampleOptions
from pandis.pipeline.run.ask.sharding import shard_count, shard_of
from pandis.pipeline.run.ask.tasks import DatasetTask, ShardTask
from pandis.pipeline.run.plan.stages import Output, PlannedJob


class PlannedDataset(NamedTuple):
    """A data set: its options, and its meshes by shard."""

    name: str
    options: object
    shards: list


class Datasets:
    """The data sets of a configuration.

    Parameters
    ----------
    config : dict
        The parsed configuration.
    folder : str
        The results folder.
    digests : pandis.pipeline.run.ask.sourcing.SourceDigests

    Raises
    ------
    ConfigError
        The options have faults, or a source cannot be read; the message lists all.
    """

    def __init__(self, config, folder, *, digests):
        self.folder = folder
        #: Each `PlannedDataset` by name.
        self.planned = plan_datasets(config, digests)

    def outputs(self):
        """Return every `Output`."""
        outputs = []
        for name in self.planned:
            outputs += [Output(path, "shard", {"dataset": name, "shard": Path(path).name[:5]})
                        for path in self._shards(name)]  # fmt: skip
            folder = f"{self.folder}/datasets/{name}"
            outputs += [Output(f"{folder}/{file}", "dataset", {"dataset": name})
                        for file in ("index.zarr.zip", "card.html", "card.json")]  # fmt: skip
        return outputs

    def shards(self, wildcards):
        """Return the paths of the shards of a data set, the inputs of its index."""
        return self._shards(wildcards.dataset)

    def _shards(self, name):
        count = len(self.planned[name].shards)
        return [f"{self.folder}/datasets/{name}/shards/{k:05}.zarr.zip" for k in range(count)]

    def shard(self, dataset, shard):
        """Return the options of a shard."""
        return shard_task(self.planned[dataset], int(shard))

    def dataset(self, dataset):
        """Return the options of the stage that writes the index and the card."""
        return dataset_task(self.planned[dataset])


def plan_datasets(config, digests):
    """Return each `PlannedDataset` of a configuration by name.

    Raises
    ------
    ConfigError
        The options have faults, or a source cannot be read; the message lists all.
    """
    planned, faults = {}, {}
    for name, options in load_datasets(config, faults).items():
        try:
            planned[name] = plan_dataset(name, options, digests)
        except PandisError as error:
            faults[f"datasets.{name}"] = str(error)
    raise_faults(faults)
    return planned


def plan_dataset(name, options, digests=None):
    """Search the meshes of a data set and divide them among shards.

    Raises
    ------
    PandisError
        As from `pandis.pipeline.run.ask.members.members`.
    """
    listed = members(options, digests)
    _check_names(options, listed)
    shards = [[] for _ in range(options.shards or shard_count(len(listed)))]
    for member in listed:
        shards[shard_of(member.name, len(shards))].append(member)
    return PlannedDataset(name, options, shards)


def dataset_task(dataset):
    """Return the `DatasetTask` of a `PlannedDataset`."""
    shards = len(dataset.shards)
    return DatasetTask(dataset=dataset.name, source=dataset.options.source, shards=shards)


def shard_task(dataset, number):
    """Return the `ShardTask` of a shard of a `PlannedDataset`."""
    options, listed = dataset.options, dataset.shards[number]
    common = options.model_dump(include=set(ShardTask.model_fields) - {"override", "shards"})
    overrides = {
        name: options.override[name].model_dump(exclude_defaults=True)
        for name in sorted({member.name for member in listed} & set(options.override))
    }
    entry = MeshEntry(source="", seed=0)  # the seed of a mesh is set where it is built
    return ShardTask(
        **common,
        builds={name: _build_options(known_field(name), entry) for name in options.fields},
        export=NativeOptions(**entry.export.model_dump(include=set(NativeOptions.model_fields))),
        override=overrides,
        shard=number,
        shards=len(dataset.shards),
        members=list_digest(listed),
    )  # fmt: skip


def _build_options(spec, entry):
    """Return the options for building a field of any mesh; none if the mesh is the field."""
    if spec.artifact == "mesh":
        return {}
    return plain(KINDS[spec.kind].options(PlannedJob("bake", "", entry, {}, spec), spec))


def load_datasets(raw, faults):
    """Return the options of the data sets of a configuration that have no fault.

    Parameters
    ----------
    raw : dict
        The parsed YAML.
    faults : dict of str to str
        Receives the faults, by dotted path.

    Returns
    -------
    dict of str to DatasetOptions
    """
    sections, datasets = raw.get("datasets") or {}, {}
    if not isinstance(sections, dict):
        sections, faults["datasets"] = {}, "expected a mapping: {name: {source: FOLDER}}"
    for name, section in sections.items():
        path = f"datasets.{name}"
        if not re.fullmatch(MESH_NAME, str(name)):
            faults[path] = "a data set's name must start with a-z; the rest may be a-z, 0-9, - or _"
            continue
        wrong = faults_of(DatasetOptions, section if isinstance(section, dict) else {})
        if not wrong:
            wrong = option_faults(DatasetOptions.model_validate(section))
        faults |= {f"{path}.{key}": why for key, why in wrong.items()}
        if not wrong:
            options = DatasetOptions.model_validate(section)
            seed = raw.get("seed", 0) if options.seed is None else options.seed
            datasets[name] = options.model_copy(update={"seed": seed})
    return datasets


def option_faults(options):
    """Return the faults that the model of a data set does not see, by key."""
    faults = {}
    counts = {"samples": options.samples.model_dump()}
    for name, override in options.override.items():
        counts[f"override.{name}.samples"] = counts["samples"] | override.samples
    for key, values in counts.items():
        if not any(values[name] for name in LABELS):
            faults[key] = "no points: set surface, near or volume"
    for name, override in options.override.items():
        for part, model in (("mesh", MeshOptions), ("samples", SampleOptions)):
            base = getattr(options, part).model_dump()
            wrong = faults_of(model, base | getattr(override, part))
            faults |= {f"override.{name}.{part}.{key}": why for key, why in wrong.items()}
    for key in ("source", "table"):
        path = getattr(options, key)
        if path and not any(c in path for c in "*?[") and not Path(path).exists():
            faults[key] = f"there is no file or folder '{path}' (looked in {Path.cwd()})"
    return faults


def _check_names(options, listed):
    """Refuse overrides of meshes that are not in the source."""
    unknown = sorted(set(options.override) - {member.name for member in listed})
    if unknown:
        raise PandisError(f"override: there is no mesh {', '.join(unknown)} in {options.source}")
