"""The command ``pandis``: looks at files, and hands them on to other programs; NumPy is enough."""

import argparse
import json
import sys
import tempfile
import webbrowser
from pathlib import Path

from pandis import __version__
from pandis.errors import PandisError


def main(arguments=None):
    """Run the command; returns its exit status."""
    parser = argparse.ArgumentParser(
        prog="pandis", description="Looks at .pandis files, and hands them on."
    )
    parser.add_argument("--version", action="version", version=f"pandis {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    info = commands.add_parser("info", help="say what files hold, and check them")
    info.add_argument("files", nargs="+", metavar="FILE", help="a .pandis file")
    info.add_argument("--json", action="store_true", help="for programs: a list, one for each file")
    info.set_defaults(run=_info)
    mjcf = commands.add_parser("mjcf", help="write a scene for MuJoCo")
    mjcf.add_argument("scene", metavar="SCENE", help="results/scenes/{scene}.json")
    mjcf.add_argument("model", metavar="MODEL", help="the file to write: ….xml")
    mjcf.set_defaults(run=_mjcf)
    sample = commands.add_parser("sample", help="write the file of a closed form")
    sample.add_argument("shape", metavar="SHAPE", help="sphere, torus, box or capsule")
    sample.add_argument("file", metavar="FILE", help="the file to write: ….pandis")
    sample.add_argument("sizes", nargs="*", type=float, metavar="SIZE", help="see docs/format.md")
    sample.set_defaults(run=_sample)
    view = commands.add_parser("view", help="touch fields of one object in a browser")
    view.add_argument("files", nargs="+", metavar="FILE", help="a .pandis file")
    view.add_argument("--output", metavar="PAGE", help="write the page here, and open no browser")
    view.add_argument("--size", type=float, default=0.1, help="length of the object, m (0.1)")
    view.add_argument("--stiffness", type=float, default=400.0, help="N/m, at first (400)")
    view.set_defaults(run=_view)
    asked = parser.parse_args(arguments)
    return asked.run(asked)


def _info(asked):
    """Say what files hold: 1 if one of them cannot be read, after all others have been told."""
    from pandis.native.info import facts, told

    status, every = 0, []
    for path in asked.files:
        try:
            found = facts(path)
        except PandisError as error:
            print(f"error: {error}", file=sys.stderr)
            status = 1
            continue
        every.append(found)
        if not asked.json:
            print(told(found))
    if asked.json:
        print(json.dumps(every, indent=2))
    return status


def _mjcf(asked):
    """Write a scene as MJCF: 1 if that cannot be."""
    from pandis.native.mujoco.mjcf import write_mjcf

    try:
        write_mjcf(asked.scene, asked.model)
    except (PandisError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


def _sample(asked):
    """Write a closed form: 1 if that cannot be."""
    from pandis.native.samples import sample_bytes

    try:
        Path(asked.file).write_bytes(sample_bytes(asked.shape, *asked.sizes))
    except (PandisError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


def _view(asked):
    """Write a page to touch fields on, and open it: 1 if that cannot be."""
    from pandis.native.web import write_page

    path = Path(asked.output or Path(tempfile.mkdtemp(prefix="pandis-")) / "touch.html")
    try:
        write_page(path, asked.files, asked.size, asked.stiffness)
    except (PandisError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(path)
    if not asked.output and not webbrowser.open(path.resolve().as_uri()):
        print("no browser could be opened: open the page by hand", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
