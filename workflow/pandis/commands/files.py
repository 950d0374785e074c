"""Commands that inspect ``.pandis`` files and convert them for other programs; NumPy only."""

import json
import sys
import tempfile
import webbrowser
from pathlib import Path

from pandis.base.errors import PandisError
from pandis.base.files import check_output, write_new
from pandis.base.workflow import workflow_folder
from pandis.commands import FINE, REFUSED


def add_options(name, parser):
    """Add the options of a command to its parser, and the function that runs it."""
    if name == "info":
        parser.add_argument("files", nargs="+", metavar="FILE", help="a .pandis file")
        parser.add_argument(
            "--json", action="store_true", help="print a JSON list, one entry per file"
        )
        parser.set_defaults(run=_info)
    elif name == "mjcf":
        parser.add_argument("scene", metavar="SCENE", help="results/scenes/{scene}.json")
        parser.add_argument("model", metavar="MODEL", help="the file to write: ….xml")
        _add_force(parser)
        parser.set_defaults(run=_mjcf)
    elif name == "sample":
        parser.add_argument("shape", metavar="SHAPE", help="sphere, torus, box or capsule")
        parser.add_argument("file", metavar="FILE", help="the file to write: ….pandis")
        parser.add_argument(
            "sizes", nargs="*", type=float, metavar="SIZE", help="see docs/format.md"
        )
        _add_force(parser)
        parser.set_defaults(run=_sample)
    elif name == "volume":
        parser.add_argument("file", metavar="FILE", help="a .pandis file")
        parser.add_argument("volume", metavar="VOLUME", help="the file to write: ….vdb or ….nvdb")
        parser.add_argument("--voxel", type=float, help="voxel length (1/200 of the object)")
        parser.add_argument(
            "--band", type=float, default=3.0, help="band on each side, in voxels (3)"
        )
        parser.add_argument(
            "--length", type=float, default=1.0, help="volume units per mesh unit (1)"
        )
        _add_force(parser)
        parser.set_defaults(run=_volume)
    elif name == "csharp":
        parser.add_argument("folder", metavar="FOLDER", help="for Unity: Assets/Plugins")
        _add_force(parser)
        parser.set_defaults(run=_csharp)
    elif name == "view":
        parser.add_argument("files", nargs="+", metavar="FILE", help="a .pandis file")
        parser.add_argument(
            "--output", metavar="PAGE", help="write the page here; do not open a browser"
        )
        parser.add_argument(
            "--size", type=float, help="length of the object, m (that of the run, or 0.1)"
        )
        parser.add_argument(
            "--stiffness", type=float, help="initial stiffness, N/m (that of the run, or 400)"
        )
        parser.add_argument(
            "--up", choices=("x", "y", "z"), default="y", help="axis that points up (y)"
        )
        _add_force(parser)
        parser.set_defaults(run=_view)
    elif name == "include":
        parser.set_defaults(run=_include)
    else:
        parser.set_defaults(run=_snakefile)


def _add_force(parser):
    parser.add_argument("--force", action="store_true", help="replace an existing file")


def _info(words):
    """Describe all files that can be read; return REFUSED if any cannot."""
    from pandis.runtime.info import describe, facts

    status, every = FINE, []
    for path in words.files:
        try:
            contents = facts(path)
        except PandisError as error:
            print(f"error: {error}", file=sys.stderr)
            status = REFUSED
            every.append({"file": path, "error": str(error)})
            continue
        every.append(contents)
        if not words.json:
            print(describe(contents))
    if words.json:
        print(json.dumps(every, indent=2))
    return status


def _done(work, *arguments, **options):
    """Call a function and return FINE; if it fails, print the reason and return REFUSED."""
    try:
        work(*arguments, **options)
    except (PandisError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return REFUSED
    return FINE


def _mjcf(words):
    """Write a scene as MJCF."""
    from pandis.bridges.mujoco.mjcf import write_mjcf

    def write():
        check_output(words.model, force=words.force)
        write_mjcf(words.scene, words.model)

    return _done(write)


def _sample(words):
    """Write a closed-form shape as a file."""
    from pandis.runtime.samples import sample_bytes

    def write():
        if Path(words.file).suffix != ".pandis":
            raise PandisError(f"{words.file}: the ending must be .pandis")
        write_new(words.file, sample_bytes(words.shape, *words.sizes), force=words.force)

    return _done(write)


def _volume(words):
    """Write a field as a volume."""
    from pandis import load
    from pandis.bridges.vdb.writing import write_volume

    options = {"voxel": words.voxel, "band": words.band, "length": words.length}

    def write():
        check_output(words.volume, force=words.force)
        write_volume(load(words.file), words.volume, **options)

    return _done(write)


def _csharp(words):
    """Write the C# binding and print the paths of its files."""
    from pandis.bridges.csharp import FILES, write_csharp

    def write():
        for name in FILES:
            if (Path(words.folder) / name).exists():
                check_output(Path(words.folder) / name, force=words.force)
        print(*write_csharp(words.folder), sep="\n")

    return _done(write)


def _include(words):
    """Print the folder of the header."""
    from pandis import engine

    print(Path(engine.__file__).parent)
    return 0


def _snakefile(words):
    """Print the path of the Snakefile."""
    print(workflow_folder() / "Snakefile")
    return 0


def _view(words):
    """Write a page for touching fields and open it."""
    from pandis.bridges.web import write_page

    path = Path(words.output or Path(tempfile.mkdtemp(prefix="pandis-")) / "touch.html")
    options = {"stiffness": words.stiffness, "up": words.up}

    def write():
        if words.output and path.suffix not in (".html", ".htm"):
            raise PandisError(f"{path}: the ending must be .html")
        if words.output:
            check_output(path, force=words.force)
        write_page(path, words.files, words.size, **options)

    if status := _done(write):
        return status
    print(path)
    if not words.output and not webbrowser.open(path.resolve().as_uri()):
        print("no browser could be opened: open the page yourself", file=sys.stderr)
    return 0
