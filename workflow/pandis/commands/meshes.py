"""Commands that make files from meshes: check, repair, field, labels, compare."""

import json
import sys
from pathlib import Path

import pandis
from pandis.base.errors import ConfigError, PandisError, RepairError
from pandis.base.files import check_output
from pandis.commands import FINE, REFUSED, UNFIT, USAGE
from pandis.commands.options import add_model, add_set, as_flags, options_of
from pandis.pipeline.api.writing import mesh_format
from pandis.pipeline.run.ask.datasets import LABELS
from pandis.pipeline.run.ask.sourcing import stem_of

_EXAMPLES = {
    "check": "pandis check part.stl\n  pandis check --json parts/*.stl",
    "repair": "pandis repair part.stl -o closed.ply\n  pandis repair --open cap *.ply -o out/",
    "field": 'pandis field part.stl\n  pandis field part.stl --budget "20 mN, 500 kB"',
    "labels": "pandis labels part.stl -o part.npz\n  pandis labels parts/ -o parts.zarr",
    "compare": "pandis compare part.pandis part.stl",
}
#: Sections of the configuration whose options a command has.
_SECTIONS = {
    "check": ("mesh",),
    "repair": ("mesh",),
    "field": ("mesh", "device", "samples", "bake", "export"),
    "labels": ("samples", "mesh"),
    "compare": ("device", "mesh"),
}
#: Ending of the file that a command writes for each mesh, if no name is given.
_ENDINGS = {"repair": ".repaired.ply", "field": ".pandis", "labels": ".npz"}


def add_options(name, parser):
    """Add the options of a command to its parser, and the function that runs it."""
    parser.epilog = (
        f"examples:\n  {_EXAMPLES[name]}\n\nexit status: 0 fine, 1 not fit for use, 2 wrong "
        "arguments, 3 refused"
    )
    if name == "compare":
        parser.add_argument("field", metavar="FIELD", help="a .pandis file")
        parser.add_argument("meshes", nargs=1, metavar="MESH", help="the mesh that it stands for")
        parser.add_argument("--probes", type=int, default=50_000, help="points (50000)")
    else:
        parser.add_argument("meshes", nargs="+", metavar="MESH", help="a mesh file")
    if name in _ENDINGS:
        parser.add_argument(
            "-o", "--output", metavar="FILE",
            help=f"the file to write, or a folder for several (MESH{_ENDINGS[name]} here)",
        )  # fmt: skip
        parser.add_argument("--force", action="store_true", help="replace existing files")
    if name == "field":
        parser.add_argument(
            "--kind",
            help="a name of config/README.md's fields (compact-auto; auto)",
        )
        parser.add_argument(
            "--budget", metavar="LIMITS",
            help='limits for the cheapest field, such as "20 mN, 500 kB": force error (mN, N, %%), '
            "size (kB: 1,000 bytes), time of a query (us)",
        )  # fmt: skip
        add_set(parser)
    parser.add_argument(
        "--name",
        help="name of the mesh in a configuration: random numbers derive from it (its file's)",
    )
    parser.add_argument("--seed", type=int, help="root of all random numbers (0)")
    parser.add_argument("--json", action="store_true", help="print a JSON list, one entry per mesh")
    parser.add_argument("--quiet", action="store_true", help="print no progress")
    if name == "labels":
        from pandis.commands import datasets  # what it imports takes half a second

        datasets.add_store_options(parser)
        parser.set_defaults(datasets=datasets)
    for section in _SECTIONS[name]:
        add_model(parser, section, defaults=LABELS if name == "labels" else None)
    parser.set_defaults(run=lambda words: _Command(name, words).run())


class _Command:
    """One call of a command, for one or several meshes."""

    def __init__(self, name, words):
        self.name, self.words = name, words
        self.rows, self.status = [], FINE

    def run(self):
        """Do the work for each mesh, print what came of it, and return the exit status."""
        words = self.words
        try:
            self.options = options_of(words, _SECTIONS[self.name])
            if self.name == "labels" and words.datasets.is_store(words):
                return words.datasets.label(words, self.options)
            outputs = self._outputs()
        except PandisError as error:
            print(f"error: {error}", file=sys.stderr)
            return USAGE
        if words.name:
            self.options["name"] = words.name
        for path, output in zip(words.meshes, outputs, strict=True):
            self._one(path, output)
        if words.json:
            print(json.dumps([row for _, row, _ in self.rows], indent=2))
        elif len(self.rows) > 1:
            width = max(len(path) for path, _, _ in self.rows)
            print(*(f"{path:{width}}  {line}" for path, _, line in self.rows), sep="\n")
        return self.status

    def _outputs(self):
        """Return the path to write for each mesh."""
        words = self.words
        if self.name not in _ENDINGS:
            return [None] * len(words.meshes)
        output = Path(words.output or ".")
        several = len(words.meshes) > 1
        if several and words.name:
            raise PandisError("--name names one mesh: run the others apart")
        if words.output and (several or words.output.endswith("/")) and not output.suffix:
            try:
                output.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise PandisError(f"-o {output}: {error.strerror}") from error
        if several and not output.is_dir():
            raise PandisError(f"-o {output}: with several meshes, name a folder")
        if not output.is_dir():
            if self.name == "repair":
                mesh_format(output)
            elif output.suffix != _ENDINGS[self.name]:
                store = ", or .zarr for many meshes" * (self.name == "labels")
                raise PandisError(f"-o {output}: the ending must be {_ENDINGS[self.name]}{store}")
            return [output]
        names = [stem_of(path) + _ENDINGS[self.name] for path in words.meshes]
        for name in names:
            if names.count(name) > 1:
                raise PandisError(f"two meshes would be written to {name}: run them apart")
        return [output / name for name in names]

    def _one(self, path, output):
        log = None if self.words.quiet else lambda text: print(text, file=sys.stderr, flush=True)
        try:
            if output:
                check_output(output, force=self.words.force)
            text, row, line, fit = getattr(self, f"_{self.name}")(path, output, log)
        except PandisError as error:
            message, status = str(error), USAGE if isinstance(error, ConfigError) else REFUSED
            option = error.option if isinstance(error, RepairError) else {}
            if option:
                message += f"\n  try again with: {as_flags(option)}"
            known = (path, str(output), getattr(self.words, "field", None) or path)
            where = "" if message.startswith(known) else f"{path}: "
            print(f"error: {where}{message}", file=sys.stderr)
            row, line = {"mesh": path, "error": str(error), "option": option}, "refused"
        else:
            status = FINE if fit else UNFIT
            if not self.words.json and (len(self.words.meshes) == 1 or text != line):
                print(text)
        self.rows.append((path, row, line))
        self.status = max(self.status, status)

    def _check(self, path, output, log):
        report = pandis.check(path, **self.options)
        line = "valid" if report.ok else f"not valid; repair: {report.repair}"
        if report.option:
            line += f" without {as_flags(report.option)}"
        text = str(report)
        if report.option:
            text += f"\n  option: {as_flags(report.option)}"
        return text, json.loads(report.to_json()), line, report.ok

    def _repair(self, path, output, log):
        mesh = pandis.repair(path, log=log, **self.options)
        mesh.save(output, self.words.force)
        moved = mesh.record.deviation
        did = "unchanged" if mesh.unchanged else ", ".join(mesh.rungs)
        line = (
            f"{output}: {len(mesh.faces):,} faces; {did}; from source to result at most "
            f"{moved['to_result']['max']:.3g}, back {moved['to_source']['max']:.3g}"
            + _invented(mesh.record)
        )
        row = {
            "mesh": path, "output": str(output), "faces": len(mesh.faces), "rungs": mesh.rungs,
            "deviation": mesh.record.deviation, "faults": mesh.record.faults_before,
        }  # fmt: skip
        return line, row, line, True

    def _field(self, path, output, log):
        words = self.words
        kind = words.kind or ("compact-auto" if words.budget is None else "auto")
        limits = {} if words.budget is None else {"budget": words.budget}
        field = pandis.field(path, kind, log=log, **(self.options | limits))
        field.save(output, words.force)
        size = output.stat().st_size
        line = f"{output}: {kind}, {field.bytes:,} bytes to query, {size:,} in the file"
        row = {"mesh": path, "output": str(output), "kind": kind, "bytes": field.bytes}
        row["file_bytes"] = size
        return line, row, line, True

    def _labels(self, path, output, log):
        labels = pandis.labels(path, log=log, **self.options)
        labels.save(output, self.words.force)
        line = f"{output}: {len(labels.points):,} points, {(labels.distance < 0).sum():,} inside"
        if labels.moved:
            line += f"; the mesh was repaired, and its surface moved by up to {labels.moved:.3g}"
        row = {
            "mesh": path, "output": str(output), "points": len(labels.points),
            "inside": int((labels.distance < 0).sum()), "tied": int(labels.tied.sum()),
            "moved": labels.moved,
        }  # fmt: skip
        return line, row, line, True

    def _compare(self, path, output, log):
        words = self.words
        if path.endswith(".pandis") and not words.field.endswith(".pandis"):
            why = "the field comes first, the mesh second; type: pandis compare"
            raise ConfigError(f"{path}: {why} {path} {words.field}", {"field": why})
        comparison = pandis.compare(words.field, path, log=log, probes=words.probes, **self.options)
        return str(comparison), json.loads(comparison.to_json()), "", comparison.ok


def _invented(record):
    """Return how much of a repaired surface has no counterpart in the source; empty if none has."""
    moved = record.deviation
    shares = {"caps": moved["to_source"].get("caps", 0.0)}
    if record.solid:
        shares["thickened sheets"] = record.solid.sheets
    named = [f"{100 * share:.3g} % {what}" for what, share in shares.items() if share]
    return f"; of the surface {' and '.join(named)} were added" if named else ""
