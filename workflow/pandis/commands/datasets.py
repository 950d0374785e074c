"""Commands for data sets: ``labels`` of many meshes in one store, and ``layout``."""

import argparse
import json
import sys
from pathlib import Path

import pandis
from pandis.base.errors import ConfigError, PandisError
from pandis.commands import FINE, REFUSED, UNFIT, USAGE
from pandis.pipeline.api.datasets import PLAIN
from pandis.pipeline.dataset.layouts import LAYOUTS, Points
from pandis.pipeline.run.ask.datasets import DatasetOptions

#: Options of a data set that are set in a configuration alone.
_CONFIGURED = ("override",)


def add_options(name, parser):
    """Add the options of the command ``layout`` to its parser, and the function that runs it."""
    del name
    parser.epilog = (
        "examples:\n  pandis layout parts.zarr --as vecset -o training/\n\nPoints of vecset, "
        "hunyuan and dora are drawn anew and labelled as they are rounded; npz, webdataset and "
        "zarr have the stored rows, and pandis has the fields."
    )
    parser.add_argument("store", metavar="STORE", help="the folder of a data set")
    parser.add_argument("--as", dest="layout", choices=LAYOUTS, required=True, help="the layout")
    parser.add_argument("-o", "--output", metavar="FOLDER", required=True, help="a new folder")
    parser.add_argument("--seed", type=int, default=0, help="root of all random numbers (0)")
    for part, count in Points()._asdict().items():
        parser.add_argument(
            f"--{part}", type=int, default=count, help=f"points of a mesh ({count})"
        )
    parser.set_defaults(run=_layout)


def _layout(words):
    points = {part: getattr(words, part) for part in Points._fields}
    try:
        folder = Path(words.output)
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise PandisError(f"-o {folder}: it exists and is no empty folder; name a new one")
        if min(points.values()) < 1 or words.seed < 0:
            raise PandisError("counts must be at least 1, and the seed at least 0")
        files = pandis.LabelStore(words.store).export(words.layout, folder, words.seed, **points)
    except PandisError as error:
        print(f"error: {error}", file=sys.stderr)
        return REFUSED
    print(f"{folder}: {len(files):,} files")
    return FINE


def add_store_options(parser):
    """Add the options of data sets to the parser of the command ``labels``."""
    group = parser.add_argument_group(
        "data sets (-o STORE.zarr)",
        "MESH is then a folder, a pattern in quotes, an archive, a list or a table",
    )
    group.add_argument("--workers", type=int, metavar="N", help="meshes at a time (one per core)")
    for name in PLAIN:
        if name in _CONFIGURED:
            continue
        field = DatasetOptions.model_fields[name]
        words = field.description.replace("%", "%%").replace("`", "")
        kind = {"table": str, "fields": str, "seconds": float, "memory_gb": float}.get(name, int)
        default = f" ({field.default:g})" if isinstance(field.default, int | float) else ""
        several = {"nargs": "+", "action": "extend"} if name == "fields" else {}
        group.add_argument(
            f"--{name.replace('_', '-')}", dest=name, type=kind, default=argparse.SUPPRESS,
            metavar=name.rpartition("_")[2].upper(), help=words + default, **several,
        )  # fmt: skip


def is_store(words):
    """Return whether the command is to write a store of many meshes."""
    return bool(words.output) and words.output.rstrip("/").endswith(".zarr")


def label(words, options):
    """Write the store, print what is in it, and return the exit status.

    The status is that of an unfit mesh if some came to nothing.
    """
    log = None if words.quiet else lambda text: print(text, file=sys.stderr, flush=True)
    options |= {name: getattr(words, name) for name in PLAIN if hasattr(words, name)}
    try:
        if len(words.meshes) > 1:
            raise ConfigError(
                f"-o {words.output}: a store has one source: name a folder, or a pattern in quotes",
                {"source": "several were named"},
            )
        if words.name:
            raise ConfigError("--name names one mesh: a store has many", {"name": "one mesh"})
        store = pandis.label_meshes(
            words.meshes[0], words.output, workers=words.workers, force=words.force, log=log,
            **options,
        )  # fmt: skip
    except PandisError as error:
        print(f"error: {error}", file=sys.stderr)
        return USAGE if isinstance(error, ConfigError) else REFUSED
    summary = store.summary
    if words.json:
        print(json.dumps({"store": words.output} | summary.model_dump(), indent=2))
    else:
        print(
            f"{words.output}: {summary.ready:,} of {summary.meshes:,} meshes, "
            f"{summary.rows:,} points; see {words.output.rstrip('/')}/card.html"
        )
        for cause in summary.causes:
            print(f"  {cause.count:,} failed: {cause.stage}: {cause.reason}")
    return UNFIT if summary.failed else FINE
