"""The command ``pandis run``: the whole workflow on a few meshes."""

import json
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

from pandis.base.errors import PandisError
from pandis.base.files import check_output, write_new
from pandis.base.workflow import workflow_folder
from pandis.commands import FINE, REFUSED
from pandis.pipeline.api.sources import source_of

_EXAMPLE = "pandis run part.stl\n  pandis run --fields compact-auto,spline-auto parts/*.stl"


def add_options(name, parser):
    """Add the options of the command to its parser, and the function that runs it."""
    del name
    parser.epilog = (
        f"examples:\n  {_EXAMPLE}\n\nIt writes a configuration, which you can edit, and "
        "runs it. The same command goes on where it stopped, with the configuration as it is."
    )
    parser.add_argument("meshes", nargs="+", metavar="MESH", help="a mesh file")
    parser.add_argument(
        "-o", "--output", metavar="FILE", help="the configuration (MESH.yaml of the first mesh)"
    )
    parser.add_argument(
        "--fields", default="exact,compact-auto", help="fields to compare (exact,compact-auto)"
    )
    parser.add_argument("--size", default="0.1", help="longest side on a device: 60 mm, or m (0.1)")
    parser.add_argument("--unit", help="unit of the meshes, for reports: mm, m, … (the files')")
    parser.add_argument("--solid", action="store_true", help="make solids of broken meshes")
    parser.add_argument("--stiffness", type=float, default=400.0, help="stiffness, N/m (400)")
    parser.add_argument("--force", action="store_true", help="write the configuration anew")
    parser.add_argument("-j", "--jobs", type=int, default=2, help="jobs at once (2)")
    parser.add_argument("-n", "--dry-run", action="store_true", help="only say what would run")
    parser.set_defaults(run=_run)


def _run(words):
    try:
        if find_spec("snakemake") is None:
            raise PandisError("the workflow needs packages: pip install 'pandis-fields[workflow]'")
        path = _write(words)
    except PandisError as error:
        print(f"error: {error}", file=sys.stderr)
        return REFUSED
    command = [
        sys.executable, "-m", "snakemake", "-s", str(workflow_folder() / "Snakefile"),
        f"-j{words.jobs}", "all", "--configfile", str(path), *(["-n"] if words.dry_run else []),
    ]  # fmt: skip
    return FINE if subprocess.run(command, check=False).returncode == 0 else REFUSED


def _write(words):
    """Write the configuration, unless there is one already, and return its path."""
    meshes = {}
    for text in words.meshes:
        name = source_of(text).name
        if name in meshes:
            raise PandisError(f"{text}: there are two meshes named {name}; rename one")
        meshes[name] = text
    first = next(iter(meshes))
    path = Path(words.output or f"{first}.yaml")
    check_output(path, force=True)
    options = {"fields": words.fields, "size": words.size, "unit": words.unit,
               "solid": words.solid, "stiffness": words.stiffness, "meshes": meshes}  # fmt: skip
    text = _configuration(path, options)
    there = path.read_text(encoding="utf-8", errors="replace") if path.exists() else None
    if words.force or there is None or _is_unedited(path, there):
        if there != text:
            write_new(path, text.encode(), force=True)
            print(f"wrote {path}", file=sys.stderr)
        return path
    if there.partition("\n")[0] != text.partition("\n")[0]:
        raise PandisError(
            f"{path} was edited, and was written for other meshes or options than these: name "
            "another file with -o, or replace it with --force"
        )
    print(f"{path} has been edited and is used as it is; --force writes it anew", file=sys.stderr)
    return path


def _configuration(path, chosen):
    """Return the text of a configuration; its first line says for what it was written."""
    mesh, size = {}, chosen["size"]
    if not re.fullmatch(r"[\d.e-]+", size):  # a length with a unit
        size = json.dumps(size)
    if chosen["unit"]:
        mesh["unit"] = chosen["unit"]
    if chosen["solid"]:
        mesh["solid"] = "always"
    folder = re.sub(r"[^A-Za-z0-9_-]", "-", path.stem)
    lines = [
        f"# for {json.dumps(chosen)}",
        f"results: results/{folder}",
        f"fields: {json.dumps(chosen['fields'].split(','))}",
        f"device: {{size: {size}, stiffness: {chosen['stiffness']!r}}}",
        *([f"mesh: {json.dumps(mesh)}"] if mesh else []),
        "meshes:",
        *(f"  {name}: {{source: {json.dumps(text)}}}" for name, text in chosen["meshes"].items()),
    ]
    return "\n".join(lines) + "\n"


def _is_unedited(path, there):
    """Return whether a configuration is as it was written."""
    try:
        options = json.loads(there.partition("\n")[0].removeprefix("# for "))
        return there == _configuration(path, options)
    except (ValueError, TypeError, KeyError, AttributeError):
        return False
