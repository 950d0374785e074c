"""The chain check: verifies that all results belong to this configuration and this code.

The check uses only the artifacts themselves, not modification times or Snakemake's
records.
"""

import csv
import json
from pathlib import Path

from pandis.base.errors import PandisError
from pandis.base.files import file_digest
from pandis.bridges.newton.cache import read as read_kept
from pandis.pipeline.check.crate import remove_crate, write_crate
from pandis.pipeline.export.vti import read_note
from pandis.pipeline.kinds.session import read_export, read_program_metadata
from pandis.pipeline.report.seal import SEALED, read_seal
from pandis.pipeline.report.tables import summarise, to_csv
from pandis.pipeline.run.ask.catalogue import RESERVED_NAMES
from pandis.pipeline.run.ask.sourcing import source_digest, source_files, source_path, url_extension
from pandis.pipeline.run.host.ending import read_partial_note
from pandis.pipeline.run.job.artifact import check_seal, read_artifact
from pandis.pipeline.run.job.provenance import needs
from pandis.pipeline.run.job.stored import RESULTS
from pandis.pipeline.run.plan.plan import DEFAULT_CONFIG
from pandis.runtime.field.files import read_provenance


def demand_files(store):
    """Raise if the results are in an object store, because only local files can be checked."""
    if store:
        raise PandisError(
            f"verify reads files, but these results are in {store}: fetch its results folder, "
            "for example with `aws s3 sync`, and run verify without the storage options"
        )


def verify(plan, log):
    """Check a plan's outputs. If only some targets were run, check only the outputs of those.

    Parameters
    ----------
    plan : pandis.pipeline.run.plan.plan.Plan
    log : pandis.base.progress.Log

    Raises
    ------
    PandisError
        A result is missing, damaged or stale. The log lists the faults; the message
        contains the commands that repair them.
    """
    remove_crate(plan.folder)
    checker = Checker(plan)
    outputs, later = asked_for(plan)
    for mesh in left_over(plan):
        log(
            f"{plan.folder}/{mesh} belongs to no mesh of the configuration: remove the folder, or "
            "restore the mesh"
        )
    faults = [(output, fault) for output in outputs if (fault := checker.fault(output))]
    total = len(outputs)
    width = max((len(output.path) for output, _ in faults), default=0)
    for output, fault in faults:
        log(f"{output.path:{width}}  {fault}")
    if faults:
        raise PandisError(
            f"{len(faults)} of {total} results do not match the configuration (listed above). "
            f"{remedy(plan, faults)}"
        )
    if later:
        stages = ", ".join(dict.fromkeys(output.stage for output in later))
        log(f"not built so far, and not checked: {len(later)} results ({stages})")
    log(f"all {total} results are whole and belong to this configuration and code")
    log(f"the results are described in {write_crate(plan.folder, outputs, checker.provenance)}")


def asked_for(plan):
    """Return the outputs that a run should have built, and those that were not requested.

    If a final output exists, the whole workflow was requested, so all outputs should exist.
    Otherwise, stages without any output are assumed not to have been requested.

    Returns
    -------
    asked, later : list of pandis.pipeline.run.plan.plan.Output
    """
    outputs = plan.everything()
    paths = {output.path for output in outputs}
    last = [output.path for output in plan.final if output.path in paths] or [outputs[-1].path]
    stages = {output.stage for output in outputs if Path(output.path).exists()}
    if any(Path(path).exists() for path in last) or not stages:
        return outputs, []
    stages.add("refuse")
    due = [output for output in outputs if output.stage in stages]
    return due, [output for output in outputs if output.stage not in stages]


def left_over(plan):
    """Return the names of mesh folders that belong to no mesh of the configuration."""
    known = {*plan.entries, *plan.refused, *RESERVED_NAMES}
    return sorted(
        path.parent.name
        for path in Path(plan.folder).glob("*/mesh.zarr.zip")
        if path.parent.name not in known
    )


def remedy(plan, faults):
    """Return the commands that repair results, given pairs (output, fault).

    A lost or damaged file is rebuilt alone. Unless it contains durations, the new file is identical
    to the old one, so results that depend on it do not have to be rebuilt.
    """
    common = f"-j2{_configfiles(plan)}"
    stale = [output for output, fault in faults if fault.startswith(_STALE)]
    # results whose only fault is a bad input become valid again once that input is restored
    apart = (*_STALE, _WAITS, _REFUSED, _PARTIAL)
    outputs = [output.path for output, fault in faults if not fault.startswith(apart)]
    commands = []
    if outputs:
        commands.append(
            f"To restore what is lost or damaged without rebuilding what depends on it: "
            f"snakemake {common} -f {' '.join(outputs)} && snakemake {common} -- all"
        )
    if stale:
        paths = " ".join(output.path for output in stale)
        commands.append(f"To rebuild what is stale: snakemake {common} -R {paths} -- all")
    if any(fault.startswith((_REFUSED, _PARTIAL)) for _, fault in faults):
        commands.append(
            "Meshes that are refused must be repaired, or removed from the configuration."
        )
    return "\n".join(commands)


#: Prefixes of fault messages: of results with a faulty input, and of intact but outdated results.
_WAITS = "its input"
_STALE = ("stale", "is another result", "differs")
_REFUSED, _PARTIAL = "refused", "leaves out the meshes that a run could not build"


def _configfiles(plan):
    installed = plan.digests.root != plan.digests.folder
    snakefile = ' -s "$(pandis snakefile)"' if installed else ""
    if plan.files == [DEFAULT_CONFIG]:
        return snakefile
    return f"{snakefile} --configfile {' '.join(plan.files)}"


class Checker:
    """Finds the faults of a plan's outputs."""

    def __init__(self, plan):
        self.plan = plan
        #: Stored provenance, by output path.
        self.provenance = {}
        self._digests = {}
        #: Reasons by mesh, of the last run in which some could not be built.
        self.refused = read_partial_note(plan)

    def fault(self, output):
        """Return a description of an output's fault, or None."""
        path = Path(output.path)
        if output.stage == "refuse":
            return f"{_REFUSED}: {self.plan.refused[output.wildcards['mesh']]}"
        if not path.is_file():
            why = self.refused.get(output.wildcards.get("mesh"))
            return "missing" if why is None else f"{_REFUSED}: {why}"
        if output.stage == "fetch":
            expected = self.plan.entries[output.wildcards["mesh"]].sha256.lower()
            return None if file_digest(path) == expected else "damaged: its sha256 differs"
        try:
            stored = self.provenance[output.path] = self._provenance(path)
        except PandisError as error:
            return str(error).removeprefix(f"{path}: ").split(";")[0]
        if output.stage == "summary":
            return self._summary(path)
        if output.stage == "collection" and path.suffix == ".csv":
            return self._collection(path)
        if stored is None:
            return self._companion(path)
        return self._stale(output, stored)

    def _stale(self, output, stored):
        options = self.plan.options(output.stage)(output.wildcards)
        if stored["stage"] == "partial":
            return _PARTIAL
        stored_stage = (stored["stage"], stored["wildcards"])
        if stored_stage != (output.stage, output.wildcards):
            return f"is another result, of {stored_stage[0]} {' '.join(stored_stage[1].values())}"
        if json.loads(json.dumps(options)) != stored["options"]:
            changed = _differences(options, stored["options"])
            return f"stale: options changed ({', '.join(changed)})"
        modules = self.plan.digests.modules(output.stage, needs(options))
        if modules != stored["code"]["modules"]:
            before = stored["code"]["modules"]
            changed = [m for m in sorted(modules | before) if modules.get(m) != before.get(m)]
            return f"stale: code changed ({', '.join(changed)})"
        if output.stage == "mesh":
            source = self._source(output.wildcards["mesh"])
            if source != stored.get("source", ""):
                return "stale: its source changed, or a file that the source references"
        for stored_name, digest in stored["inputs"].items():
            name = stored_name.replace(RESULTS, self.plan.folder, 1)
            now = self._digest(name)
            if now is None:
                return f"its input {name} is missing or damaged"
            if now != digest:
                return f"stale: its input {name} changed"
        return None

    def _source(self, mesh):
        """Return the current digest of a source's files, ignoring the plan's cached digests."""
        entry = self.plan.entries[mesh]
        if url_extension(entry.source):
            return entry.sha256.lower()
        path = source_path(entry.source)
        return "" if path is None else source_digest(source_files(path))

    def _summary(self, path):
        """Return the fault of summary.csv, which must match the current artifacts, or None."""
        try:
            read = (
                [read_artifact(name) for name in self.plan.results(f"{stem}.zarr.zip")]
                for stem in ("evaluation", "timing", "stress", "hardware")
            )
            text = to_csv(summarise(read))
        except PandisError:
            return "its input, an artifact that it summarises, is missing or damaged"
        same = _without_builds(path.read_bytes()) == _without_builds(text.encode())
        return None if same else "differs from the artifacts it summarises"

    def _collection(self, path):
        """Compare collection.csv with its digest in collection.html; return its fault, or None."""
        try:
            seal = read_seal(path.with_suffix(".html"))
        except (PandisError, OSError):
            return "its input, the page beside it, is missing or damaged"
        if seal["stage"] == "partial":
            return _PARTIAL
        same = file_digest(path) == seal.get("table")
        return None if same else "differs from the page beside it"

    def _companion(self, path):
        """Return the fault of a human-readable copy of an artifact's attributes, or None."""
        try:
            name = "index.zarr.zip" if path.name == "card.json" else f"{path.stem}.zarr.zip"
            attributes = read_artifact(path.with_name(name)).attributes
            text = path.read_text(encoding="utf-8")
            if path.suffix == ".h":
                return None if text == attributes["header"] else "differs from its artifact"
            companion = json.loads(text)
        except (PandisError, ValueError, KeyError):
            return "damaged, or without its artifact"
        companion.pop("mesh", None)
        expected = {key: value for key, value in attributes.items() if key != "header"}
        return None if companion == expected else "differs from its artifact"

    def _provenance(self, path):
        """Return an output's provenance; None for a plain companion file."""
        if path.name.endswith(".zarr.zip"):
            artifact = read_artifact(path)
            self._digests[str(path)] = artifact.digest
            return artifact.provenance
        if path.suffix == ".onnx":
            return json.loads(read_export(path).metadata["provenance"])
        if path.suffix == ".pt2":
            return read_program_metadata(path)["provenance"]
        if path.suffix == ".vti":
            return read_note(path)["provenance"]
        if path.suffix == ".pandis":
            return read_provenance(path)
        if path.suffix == ".npz":
            check_seal(path)
            return read_kept(path).provenance
        if path.suffix in SEALED:
            return read_seal(path)
        return None

    def _digest(self, name):
        if name not in self._digests:
            path = Path(name)
            # a source has no provenance, even if its suffix is that of an export
            is_result = Path(self.plan.folder) in path.parents
            try:
                # open exports first, so that a damaged export is not reported as changed
                if not is_result or self._provenance(path) is None or path.suffix != ".zip":
                    self._digests[name] = file_digest(path)
            except (PandisError, OSError):
                self._digests[name] = None
        return self._digests[name]


def _without_builds(data):
    """Return a summary's rows without build times, which cannot be checked against artifacts."""
    rows = list(csv.DictReader(data.decode("utf-8", "replace").splitlines()))
    return [{k: v for k, v in row.items() if k != "build_s"} for row in rows]


def _differences(one, other):
    """Return the names of the options that differ; nested ones are dotted, like `recipe.steps`."""
    names = []
    for key in sorted(set(one) | set(other)):
        before, after = one.get(key), other.get(key)
        if isinstance(before, dict) and isinstance(after, dict):
            names += [f"{key}.{name}" for name in _differences(before, after)]
        elif before != after:
            names.append(key)
    return names
