"""The command ``pandis``. A command's module is imported when it is run."""

import argparse
import os
import signal
import sys
from importlib import import_module

from pandis import __version__

#: Module of `pandis.commands` and summary of each command.
COMMANDS = {
    "check": ("meshes", "find the faults of meshes, and what repair would do"),
    "repair": ("meshes", "make meshes closed and valid"),
    "field": ("meshes", "make the field of a mesh: a .pandis file"),
    "labels": ("meshes", "draw points and label them with exact distances and normals"),
    "layout": ("datasets", "write a data set in a layout that others' training code reads"),
    "compare": ("meshes", "measure the errors of a field against its mesh"),
    "run": ("workflow", "run the whole workflow on meshes, with its report"),
    "view": ("files", "touch an object's fields in a browser"),
    "info": ("files", "check .pandis files and describe them"),
    "volume": ("files", "write a field as an OpenVDB or NanoVDB volume"),
    "mjcf": ("files", "write a scene for MuJoCo"),
    "csharp": ("files", "write the files for C# programs and Unity"),
    "sample": ("files", "write a closed-form shape as a .pandis file"),
    "include": ("files", "print the folder of pandis.h, for a compiler"),
    "snakefile": ("files", "print the path of the workflow"),
}


def main(arguments=None):
    """Run the command and return its exit status.

    It is 0 if all is well, 1 if a mesh or a field is not fit for use, 2 for wrong arguments, 3 if
    something was refused, and 130 if the command was stopped.
    """
    if arguments is None:
        arguments = sys.argv[1:]
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # temporary files are removed
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # idle threads cost a command 0.3 CPU s
    try:
        status = _run(arguments)
        sys.stdout.flush()
    except BrokenPipeError:  # whoever read the output has what it wants
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    return status


def _run(arguments):
    parser = argparse.ArgumentParser(
        prog="pandis",
        description="Make fields, solids and labels from triangle meshes, and use the files.",
    )
    parser.add_argument("--version", action="version", version=f"pandis {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (module, summary) in COMMANDS.items():
        command = commands.add_parser(
            name,
            help=summary,
            description=f"{summary[0].upper()}{summary[1:]}.",
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        if name in arguments[:1]:  # the options of the others would take a second to import
            import_module(f"pandis.commands.{module}").add_options(name, command)
    words = parser.parse_args(arguments)
    return words.run(words)


if __name__ == "__main__":
    sys.exit(main())
