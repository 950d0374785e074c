"""Writes an RO-Crate 1.1 of verified results, which lists each file's stage and inputs.

Source: https://www.researchobject.org/ro-crate/specification/1.1/
"""

import json
import mimetypes
from datetime import UTC, datetime
from pathlib import Path
from urllib.parse import quote

import pandis
from pandis.base.files import file_digest, write_atomically
from pandis.pipeline.run.job.stored import RESULTS

NAME = "ro-crate-metadata.json"
_SPECIFICATION = "https://w3id.org/ro/crate/1.1"
_SOFTWARE, _LICENCE = "#pandis", "#licences-of-the-meshes"
#: Media types that Python's `mimetypes` lacks, by file suffix.
_TYPES = {".zip": "application/zip", ".pandis": "application/octet-stream"}


def write_crate(folder, outputs, provenance):
    """Write ro-crate-metadata.json into the results folder.

    Parameters
    ----------
    folder : str
        The results folder.
    outputs : list of pandis.pipeline.run.plan.plan.Output
        Verified results; results outside the folder are left out.
    provenance : dict of str to dict
        Stored provenance, by output path; plain companion files have none.

    Returns
    -------
    pathlib.Path
        Path of the written file.
    """
    root = Path(folder)
    inside = [output for output in outputs if root in Path(output.path).parents]
    ids = {output.path: _identifier(root, output.path) for output in inside}
    files, actions = [], []
    for output in inside:
        files.append(_file(output.path, ids[output.path]))
        if stored := provenance.get(output.path):
            actions.append(_action(output, ids, stored, folder=folder))
    parts = [{"@id": file["@id"]} for file in files]
    graph = [_descriptor(), _dataset(parts), _licence(), *files, *actions, _software()]
    document = {"@context": f"{_SPECIFICATION}/context", "@graph": graph}
    path = root / NAME
    write_atomically(path, f"{json.dumps(document, indent=1, ensure_ascii=False)}\n".encode())
    return path


def remove_crate(folder):
    """Remove the results' crate, which describes the results of an earlier check."""
    Path(folder, NAME).unlink(missing_ok=True)


def _identifier(root, path):
    return quote(Path(path).relative_to(root).as_posix())


def _descriptor():
    about = {"about": {"@id": "./"}, "conformsTo": {"@id": _SPECIFICATION}}
    return {"@id": NAME, "@type": "CreativeWork", **about}


def _dataset(parts):
    return {
        "@id": "./",
        "@type": "Dataset",
        "name": "Results of a pandis workflow",
        "description": "Repaired meshes, samples, force fields, their evaluation and validation, "
        "with the stage and the inputs of each file. Every file passed `verify`.",
        "datePublished": datetime.now(UTC).date().isoformat(),
        "license": {"@id": _LICENCE},
        "hasPart": parts,
    }


def _licence():
    return {
        "@id": _LICENCE,
        "@type": "CreativeWork",
        "name": "The licences of the meshes",
        "description": "They apply to everything that is derived from the meshes.",
    }


def _file(path, identifier):
    path = Path(path)
    kind = mimetypes.guess_type(path.name)[0] or _TYPES.get(path.suffix, "text/plain")
    return {
        "@id": identifier,
        "@type": "File",
        "name": identifier,
        "contentSize": str(path.stat().st_size),
        "encodingFormat": kind,
        "sha256": file_digest(path),
    }


def _action(output, ids, stored, *, folder):
    """Return the entry for a stage's run: its inputs in the crate, its result, its options."""
    names = [name.replace(RESULTS, folder, 1) for name in stored["inputs"]]
    inputs = [{"@id": ids[name]} for name in names if name in ids]
    return {
        "@id": f"#{output.stage}-{ids[output.path]}",
        "@type": "CreateAction",
        "name": " ".join([output.stage, *output.wildcards.values()]),
        "instrument": {"@id": _SOFTWARE},
        **({"object": inputs if len(inputs) > 1 else inputs[0]} if inputs else {}),
        "result": {"@id": ids[output.path]},
        "description": f"options: {json.dumps(stored['options'], sort_keys=True)}",
    }


def _software():
    return {
        "@id": _SOFTWARE,
        "@type": "SoftwareApplication",
        "name": "pandis",
        "softwareVersion": pandis.__version__,
    }
