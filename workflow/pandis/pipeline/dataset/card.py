"""The card of a data set: a page and a JSON file that say what is in it."""

import base64
import json
from importlib import resources

import jinja2
import numpy as np

from pandis import __version__
from pandis.base.frame import Frame
from pandis.pipeline.dataset.reading import Shard
from pandis.pipeline.report.render import render, to_png

#: Pictures on the card, and their side length in pixels.
_PICTURES, _SIDE = 48, 96


def to_json(record):
    """Return the index's record as the bytes of ``card.json``."""
    return (json.dumps(record.attributes(), indent=1, sort_keys=True) + "\n").encode()


def build(record, shards):
    """Return the page as text.

    Parameters
    ----------
    record : pandis.pipeline.run.records.dataset.DatasetRecord
    shards : sequence of path-like
        The shards, in order, from which some meshes are drawn.
    """
    text = resources.files("pandis.pipeline.dataset") / "card.html"
    template = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    ).from_string(text.read_text(encoding="utf-8"))
    data = json.dumps([_row(mesh) for mesh in record.meshes], separators=(",", ":"))
    return template.render(
        about=record,
        summary=record.summary,
        pictures=_pictures(record.meshes, shards),
        data=data.replace("<", "\\u003c"),  # a name may contain the end of the script
        version=__version__,
    )


def _row(mesh):
    """Return the cells of a mesh in the table."""
    if mesh.failed:
        why = mesh.failed
        option = ", ".join(f"{key}: {value}" for key, value in why.option.items())
        cells = [0, 0, "", "", "failed", f"{why.stage}: {why.reason}", option]
    else:
        about = mesh.kinds or mesh.faults
        counts = ", ".join(f"{count:,} {what}" for what, count in about.items())
        moved = float(f"{mesh.moved_percent:.3g}")
        added = float(f"{100 * (mesh.invented + mesh.sheets):.3g}")
        cells = [mesh.rows, mesh.faces, moved, added, mesh.way, counts, ", ".join(mesh.repair)]
    return [mesh.name, *cells, mesh.licence, mesh.tags]


def _pictures(meshes, shards):
    """Yield pictures of meshes spread over the list, those made solid first."""
    ready = [mesh for mesh in meshes if not mesh.failed]
    solid = [mesh for mesh in ready if mesh.kinds]
    exact = [mesh for mesh in ready if not mesh.kinds]
    opened = {}
    for mesh in [*_spread(solid, _PICTURES // 2), *_spread(exact, _PICTURES // 2)]:
        number, place = mesh.shard
        if number not in opened:
            opened[number] = Shard(shards[number])
        arrays = opened[number].arrays(place, rows=False)
        corners = Frame(mesh.centre, mesh.scale).to_unit(arrays["vertices"])
        png = to_png(render(corners, arrays["faces"], _SIDE))
        uri = f"data:image/png;base64,{base64.b64encode(png).decode()}"
        yield {"name": mesh.name, "way": mesh.way, "uri": uri}


def _spread(items, count):
    places = np.unique(np.linspace(0, len(items) - 1, min(count, len(items))).astype(int))
    return [items[k] for k in places]
