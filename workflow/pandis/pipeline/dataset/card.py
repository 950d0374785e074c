"""The card of a data set: a page and a JSON file that say what is in it."""

import base64
import io
import json
from importlib import resources

import jinja2
import numpy as np
from matplotlib.image import imsave

from pandis import __version__
from pandis.base.frame import Frame
from pandis.pipeline.dataset.index import way_of
from pandis.pipeline.dataset.reading import Shard
from pandis.pipeline.report.render import render

#: Pictures on the card, and their side length in pixels.
_PICTURES, _SIDE = 48, 96


def to_json(attributes):
    """Return the index's attributes as the bytes of ``card.json``."""
    return (json.dumps(attributes, indent=1, sort_keys=True) + "\n").encode()


def build(attributes, shards):
    """Return the page as text.

    Parameters
    ----------
    attributes : dict
        From `pandis.pipeline.dataset.index.collect`.
    shards : sequence of path-like
        The shards, in order, from which some meshes are drawn.
    """
    text = resources.files("pandis.pipeline.dataset") / "card.html"
    template = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    ).from_string(text.read_text(encoding="utf-8"))
    rows = [_row(mesh) for mesh in attributes["meshes"]]
    # "</" would end the script
    data = json.dumps(rows, separators=(",", ":")).replace("</", "<\\/")
    return template.render(
        about=attributes,
        summary=attributes["summary"],
        pictures=_pictures(attributes["meshes"], shards),
        data=data,
        version=__version__,
    )


def _row(mesh):
    """Return the cells of a mesh in the table."""
    if "failed" in mesh:
        why = mesh["failed"]
        option = ", ".join(f"{key}: {value}" for key, value in why["option"].items())
        cells = [0, 0, 0, "failed", f"{why['stage']}: {why['reason']}", option]
    else:
        about = mesh["kinds"] or mesh["faults"]
        counts = ", ".join(f"{count:,} {what}" for what, count in about.items())
        moved = float(f"{mesh['moved_percent']:.3g}")
        cells = [mesh["rows"], mesh["faces"], moved, way_of(mesh), counts,
                 ", ".join(mesh["repair"])]  # fmt: skip
    return [mesh["name"], *cells, mesh["licence"], mesh["tags"]]


def _pictures(meshes, shards):
    """Return pictures of meshes spread over the list, those made solid first."""
    ready = [mesh for mesh in meshes if "failed" not in mesh]
    solid = [mesh for mesh in ready if mesh["kinds"]]
    exact = [mesh for mesh in ready if not mesh["kinds"]]
    chosen = [*_spread(solid, _PICTURES // 2), *_spread(exact, _PICTURES // 2)]
    opened = {}
    for mesh in chosen:
        number, index = mesh["shard"]
        shard = opened.setdefault(number, Shard(shards[number]))
        solid_mesh = shard.arrays(index, rows=False)
        frame = Frame(np.array(mesh["centre"]), mesh["scale"])
        image = render(frame.to_unit(solid_mesh["vertices"]), solid_mesh["faces"], _SIDE)
        stream = io.BytesIO()
        imsave(stream, image, format="png")
        uri = f"data:image/png;base64,{base64.b64encode(stream.getvalue()).decode()}"
        yield {"name": mesh["name"], "way": way_of(mesh), "uri": uri}


def _spread(items, count):
    places = np.unique(np.linspace(0, len(items) - 1, min(count, len(items))).astype(int))
    return [items[k] for k in places]
