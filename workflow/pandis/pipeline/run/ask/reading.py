"""Reads a configuration: rejects duplicate keys, parses 1e-4, applies each mesh's overrides."""

import re
from pathlib import Path

import yaml

from pandis.base.errors import PandisError
from pandis.pipeline.run.ask.catalogue import MESH_NAME, RESERVED_NAMES
from pandis.pipeline.run.ask.config import APART, FOLDER, MeshEntry, StageOptions
from pandis.pipeline.run.ask.faults import raise_faults, stage_faults


class _StrictLoader(yaml.SafeLoader):
    """YAML loader that rejects duplicate keys instead of keeping the last one."""

    def construct_mapping(self, node, deep=False):
        seen = set()
        for key, _ in node.value:
            if key.tag == "tag:yaml.org,2002:merge":
                continue
            name = self.construct_object(key, deep=True)
            if name in seen:
                raise PandisError(
                    f"{self.name}, line {key.start_mark.line + 1}: the key '{name}' occurs twice; "
                    "rename or remove one of them"
                )
            seen.add(name)
        return super().construct_mapping(node, deep)


def check_yaml(path):
    """Raise PandisError if the YAML file has a duplicate key or does not parse.

    Snakemake has already read the file and silently kept the last of two
    equal keys, so two meshes of the same name would have become one.
    """
    with Path(path).open(encoding="utf-8") as stream:
        loader = _StrictLoader(stream)
        loader.name = str(path)
        try:
            loader.get_single_data()
        except yaml.YAMLError as error:
            raise PandisError(f"{path}: not valid YAML: {error}") from error
        finally:
            loader.dispose()


_FLOAT = re.compile(r"[+-]?\d+(\.\d*)?[eE][+-]?\d+")


def _read_numbers(value):
    """Turn `1e-4` into a number: YAML 1.1 reads it as text."""
    if isinstance(value, dict):
        return {k: v if k == "source" else _read_numbers(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_read_numbers(v) for v in value]
    if isinstance(value, str) and _FLOAT.fullmatch(value):
        return float(value)
    return value


def merge(base, override):
    """Merge two nested dicts key by key; any other value of ``override`` replaces the base's."""
    merged = dict(base)
    for key, value in override.items():
        both = isinstance(value, dict) and isinstance(merged.get(key), dict)
        merged[key] = merge(merged[key], value) if both else value
    return merged


def results_folder(raw):
    """Return the folder of a configuration's results.

    Raises
    ------
    PandisError
        The folder is not a path of plain names.
    """
    folder = raw.get("results", "results")
    if not isinstance(folder, str) or not re.fullmatch(FOLDER, folder):
        expected = (
            "a folder, such as results/front or /scratch/front; names may contain letters, digits, "
            ". _ and -"
        )
        raise_faults({"results": f"{expected} (given: {folder!r})"})
    if Path(folder).exists() and not Path(folder).is_dir():
        raise_faults({"results": f"{folder} is a file; name a folder, or remove the file"})
    return folder


def last_target(raw):
    """Return the named target at which a configuration's run ends; None if it makes everything.

    Raises
    ------
    PandisError
        A run cannot end with this target, or the configuration also has scenes.
    """
    until = raw.get("until")
    if until not in (None, "meshes", "samples", "exports"):
        raise_faults({"until": f"expected meshes, samples, exports, or nothing (given: {until!r})"})
    if until and raw.get("scenes"):
        raise_faults({"until": "scenes build what they need and nothing else: remove until"})
    return until


def load_config(raw, refused=None):
    """Validate a configuration and merge each mesh's overrides.

    Parameters
    ----------
    raw : dict
        The parsed YAML.
    refused : dict, optional
        Receives the faults of meshes whose own options are wrong, by name; the other meshes are
        returned. The faults are raised instead if it is omitted, no mesh is left, or a shared
        option is wrong.

    Returns
    -------
    dict of str to MeshEntry
        The complete options of each mesh, in the order of the file.

    Raises
    ------
    PandisError
        Lists every fault at once, each with its dotted path.
    """
    raw = _read_numbers(raw)
    top = {key: value for key, value in raw.items() if key not in APART}
    meshes = raw.get("meshes")
    faults = stage_faults(StageOptions, top)
    merged = {}
    if not meshes and raw.get("datasets"):
        meshes = {}
    elif not isinstance(meshes, dict) or not meshes:
        needed = "at least one mesh is needed" if not meshes else "expected a mapping, not a list"
        faults["meshes"] = f"{needed}: `meshes: {{name: {{source: …}}}}`"
        meshes = {}
    shared = dict(faults)
    for name, entry in meshes.items():
        path = f"meshes.{name}"
        if isinstance(name, bool):
            faults[path] = "YAML reads on, off, yes and no as true or false: put the name in quotes"
        elif not re.fullmatch(MESH_NAME, str(name)):
            faults[path] = "a mesh's name must start with a-z; the rest may be a-z, 0-9, - or _"
        elif name in RESERVED_NAMES:
            faults[path] = "this name is taken by a folder of results/: choose another"
        if not isinstance(entry, dict):
            faults.setdefault(path, "expected a mapping such as {source: path/to/mesh.obj}")
        else:
            options = merge(top, entry)
            mesh_faults = stage_faults(MeshEntry, options)
            for key, message in mesh_faults.items():
                if key not in faults:
                    faults[f"{path}.{key}" if key else path] = message
            if not mesh_faults and path not in faults:
                merged[name] = MeshEntry.model_validate(options)
    if refused is not None and merged and not shared:
        for key, message in faults.items():
            # an invalid name may contain a dot
            name = next(n for n in meshes if f"{key}.".startswith(f"meshes.{n}."))
            line = f"{key}: {message}"
            refused[name] = f"{refused[name]}; {line}" if name in refused else line
        faults = {}
    raise_faults(faults)
    return merged
