"""One table for a collection of many meshes: the source, repair and files of each."""

import base64
import csv
import io
from importlib import resources
from pathlib import Path
from types import SimpleNamespace

import jinja2

from pandis import __version__
from pandis.base.files import file_digest
from pandis.base.frame import Frame
from pandis.pipeline.report.render import render, to_png
from pandis.pipeline.run.host.processes import each
from pandis.pipeline.run.job.artifact import read_artifact
from pandis.pipeline.run.records.mesh import MeshRecord
from pandis.runtime.info import facts

#: Columns of the table, and their headings on the page.
COLUMNS = {
    "mesh": "Mesh",
    "source": "Source",
    "faces_before": "Faces read",
    "faults": "Faults",
    "repair": "Repaired by",
    "moved_percent": "Surface moved by at most (% of the diagonal)",
    "faces": "Faces",
    "components": "Components",
    "genus": "Genus",
    "file": "File",
    "bytes": "Bytes",
    "holds": "Contents",
}
#: Directions of the deviation: from the source to the result, and back.
_WAYS = "to_result", "to_source"
#: Side length of a picture, pixels.
_SMALL = 72


def collect(meshes, threads, progress, *, note):
    """Return the rows of all meshes in order. With n threads, n meshes are read at a time.

    Parameters
    ----------
    meshes : dict of str to list of path-like
        The artifact of each repaired mesh and its files for ``pandis.h``.
    threads : int
    progress : pandis.base.progress.Progress
    note : callable
        Receives the path and the digest of every file that was read.

    Returns
    -------
    list of dict
        One row for each file, with the keys of `COLUMNS` and ``picture``, a ``data:`` URI in the
        first row of a mesh.
    """
    report, rows = progress("meshes", len(meshes), "meshes"), []
    for done, (rows_of_mesh, digests) in enumerate(each(_read, list(meshes.items()), threads), 1):
        for path, digest in digests.items():
            note(path, digest)
        rows += rows_of_mesh
        report.update(done)
    return rows


def _read(work):
    name, paths = work
    stored = next(path for path in paths if Path(path).name == "mesh.zarr.zip")
    files = [path for path in paths if str(path).endswith(".pandis")]
    mesh = read_artifact(stored)
    record = MeshRecord.of(mesh)
    read = record.source, record.before, record.after, *map(record.deviation.get, _WAYS)
    source, before, after, result, way_back = (SimpleNamespace(**each_of) for each_of in read)
    row = {
        "mesh": name,
        "source": source.name,
        "faces_before": before.faces,
        "faults": record.faults_before,
        "repair": "; ".join(rung.operation for rung in record.rungs if rung.kept),
        "moved_percent": 100 * max(result.max or 0.0, way_back.max or 0.0) / after.diagonal,
        "faces": after.faces,
        "components": after.components,
        "genus": after.genus,
    }
    contents = [facts(path) for path in files] or [dict.fromkeys(("file", "bytes", "made_of"), "")]
    rows = [row | {"file": Path(one["file"]).name, "bytes": one["bytes"], "holds": one["made_of"],
                   "picture": ""} for one in contents]  # fmt: skip
    rows[0]["picture"] = _picture(mesh)
    digests = {str(path): file_digest(path) for path in files}
    return rows, digests | {str(stored): mesh.digest}


def _picture(mesh):
    """Return a small picture of a mesh as a ``data:`` URI."""
    vertices = Frame.of(mesh).to_unit(mesh.arrays["vertices"])
    png = to_png(render(vertices, mesh.arrays["faces"], _SMALL))
    return f"data:image/png;base64,{base64.b64encode(png).decode()}"


def to_csv(rows, refused=()):
    """Return rows as CSV text. A refused mesh has a row with only its name and the reason.

    Parameters
    ----------
    rows : list of dict
        From `collect`.
    refused : dict of str to str
        Meshes that could not be built, and why.
    """
    stream = io.StringIO()
    names = [*COLUMNS, *(["refused"] if refused else [])]
    writer = csv.DictWriter(stream, names, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows({"mesh": mesh, "refused": refused[mesh]} for mesh in refused)
    writer.writerows(
        {k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows
    )
    return stream.getvalue()


def build(rows, refused=None):
    """Return the page as text.

    Parameters
    ----------
    rows : list of dict
        From `collect`.
    refused : dict of str to str, optional
        Meshes that could not be built, and why.
    """
    text = {name: (resources.files("pandis.pipeline.report") / name).read_text(encoding="utf-8")
            for name in ("collection.html", "page.js")}  # fmt: skip
    template = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    ).from_string(text["collection.html"])
    return template.render(
        rows=rows,
        columns=COLUMNS,
        refused=refused or {},
        meshes=len({row["mesh"] for row in rows}),
        bytes=sum(row["bytes"] or 0 for row in rows),
        version=__version__,
        script=text["page.js"],
    )
