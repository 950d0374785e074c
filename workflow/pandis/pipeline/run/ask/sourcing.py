"""The source files of a mesh: their names, whether they exist, and their digest.

A mesh may have several files: a glTF scene has buffers beside it, an OBJ file has materials with
textures. All of them are inputs of a result. Planning uses this module for every mesh, so it
imports neither torch nor trimesh.
"""

import gzip
import hashlib
import json
import os
import re
from importlib.util import find_spec
from pathlib import Path, PurePosixPath
from urllib.parse import unquote, urlsplit

from pandis.base.errors import PandisError
from pandis.base.files import file_digest
from pandis.engine.cache import cache_folder, keep

FORMATS = ("obj", "ply", "stl", "off", "glb", "gltf", "3mf")
#: Prefixes of sources that are not the user's files.
SHIPPED, ANALYTIC = "pymeshlab:", "analytic:"
#: Names of the closed forms, which `pandis.pipeline.geometry.shapes` defines.
SHAPE_NAMES = ("sphere", "torus", "box", "capsule")
#: Suffix of the array beside a mesh file that names a material for each face.
_REGIONS = ".regions.npy"
#: Largest mesh file (bytes) that is searched for references to other files. An OBJ file may have
#: them anywhere.
_LARGEST = 1 << 30


def url_extension(source):
    """Return the file ending of a URL (``ply``, ``ply.gz``), or None if it is not a URL."""
    if not source.startswith(("http://", "https://")):
        return None
    suffixes = PurePosixPath(urlsplit(source).path).suffixes[-2:]
    if suffixes[-1:] != [".gz"]:
        suffixes = suffixes[-1:]
    return "".join(suffixes).removeprefix(".") or "unknown"


def format_of(path):
    """Return the ending of a mesh file in lower case, without a final ``.gz``."""
    suffixes = [s.lower().removeprefix(".") for s in Path(path).suffixes]
    if suffixes[-1:] == ["gz"]:
        suffixes = suffixes[:-1]
    return suffixes[-1] if suffixes else ""


def stem_of(path):
    """Return the name of a mesh file without the ending of its format and ``.gz``."""
    name = Path(path).name
    for ending in ("gz", format_of(path)):
        if name.lower().endswith(f".{ending}") and ending:
            name = name[: -len(ending) - 1]
    return name


def shipped_folder():
    """Return the folder of the meshes that ship with PyMeshLab; None if it is not installed."""
    spec = find_spec("pymeshlab")
    if spec is None or not spec.submodule_search_locations:
        return None
    return Path(spec.submodule_search_locations[0]) / "tests" / "sample_meshes"


def source_path(source):
    """Return the file of a source; None for a URL or a closed form.

    Raises
    ------
    PandisError
        The file does not exist, or needs PyMeshLab, which is not installed.
    """
    if source.startswith(ANALYTIC) or url_extension(source):
        return None
    if source.startswith(SHIPPED):
        name, folder = source.removeprefix(SHIPPED), shipped_folder()
        if folder is None:
            raise PandisError(f"source: '{source}' needs PyMeshLab: pip install pymeshlab")
        if not (folder / name).is_file():
            known = ", ".join(sorted(f.name for f in folder.glob("*.*")))
            raise PandisError(f"source: PyMeshLab ships no '{name}'; it has {known}")
        return folder / name
    path = Path(source)
    if path.is_file():
        return path
    if source.startswith("~") and Path(source).expanduser().is_file():
        raise PandisError(
            f"source: '{source}': a ~ is not the home folder here; write {Path.home()} instead"
        )
    raise PandisError(
        f"source: there is no file '{source}' (looked in {Path.cwd()}); correct the path "
        "or put the file there"
    )


def source_fault(source):
    """Return a sentence that says what is wrong with a source, without reading its contents.

    Returns
    -------
    str or None
    """
    if source.startswith(ANALYTIC):
        return _shape_fault(source)
    ending = format_of(urlsplit(source).path if url_extension(source) else source)
    if ending not in FORMATS:
        return (
            f"source: {source}: unknown format '.{ending}'; the known formats are "
            + ", ".join(f".{known}" for known in FORMATS)
            + ", each also as .gz; convert the mesh to one of them"
        )
    try:
        path = source_path(source)
        readable = path is None or os.access(path, os.R_OK)
        empty = path is not None and path.stat().st_size == 0
    except PandisError as error:
        return str(error)
    except OSError:
        readable = empty = False
    if not readable:
        return f"source: {source}: the file cannot be read; check its permissions"
    return f"source: {source}: the file is empty; export the mesh again" if empty else None


def _shape_fault(source):
    if source.removeprefix(ANALYTIC) in SHAPE_NAMES:
        return None
    known = ", ".join(f"{ANALYTIC}{name}" for name in SHAPE_NAMES)
    return f"source: '{source}' is unknown; closed-form shapes are {known}"


def regions_file(path):
    """Return the path of the array that names a material for each face; it need not exist.

    For ``part.stl`` it is ``part.stl.regions.npy``: see `pandis.pipeline.mesh.regions.read_beside`.
    """
    path = Path(path)
    return path.with_name(path.name + _REGIONS)


def source_files(path):
    """Return a mesh file and the existing files beside it that it refers to.

    These include its `regions_file`.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    list of Path
        The mesh file first, then the others by name.
    """
    path = Path(path)
    named, seen = [regions_file(path).name, *_named(path)], {path}
    while named:
        target = path.parent / named.pop()
        if target not in seen and target.is_file():
            seen.add(target)
            named += _named(target)
    return [path, *sorted(seen - {path})]


def _named(path):
    """Return the names of the files that a file refers to."""
    ask = {"obj": _of_obj, "gltf": _of_gltf, "mtl": _of_mtl, "ply": _of_ply}
    reader = ask.get(format_of(path))
    if reader is None or path.stat().st_size > _LARGEST:
        return []
    try:
        packed = path.suffix.lower() == ".gz"
        data = gzip.decompress(path.read_bytes()) if packed else path.read_bytes()
        return reader(data)
    except (OSError, EOFError, ValueError, TypeError, AttributeError):
        return []  # damaged: the mesh readers report the fault


def _of_obj(data):
    lines = re.findall(rb"^[ \t]*mtllib[ \t]+([^\r\n]+)", data, re.M)
    names = [line.decode("utf-8", "replace").strip() for line in lines]
    # a line is one name with spaces, or several names: return both readings
    return [*names, *(word for line in names for word in line.split())]


def _of_mtl(data):
    maps = re.findall(rb"^[ \t]*(?:map_\w+|bump|disp|decal|refl|norm)[ \t]+([^\r\n]+)", data, re.M)
    return [line.decode("utf-8", "replace").split()[-1] for line in maps if line.split()]


def _of_ply(data):
    header = data[: data.find(b"end_header")]
    names = re.findall(rb"^comment TextureFile[ \t]+([^\r\n]+)", header, re.M)
    return [name.decode("utf-8", "replace").strip() for name in names]


def _of_gltf(data):
    scene = json.loads(data)
    parts = [*scene.get("buffers", []), *scene.get("images", [])]
    names = [part["uri"] for part in parts if part.get("uri")]
    return [unquote(uri) for uri in names if not uri.startswith("data:")]


def source_digest(files, digest=file_digest):
    """Return the SHA-256 of a source: of its only file, or of the names and digests of several.

    Parameters
    ----------
    files : list of Path
        From `source_files`.
    digest : callable
        Returns the digest of one file.
    """
    if len(files) == 1:
        return digest(files[0])
    text = "\n".join(f"{path.name} {digest(path)}" for path in files)
    return hashlib.sha256(text.encode()).hexdigest()


class SourceDigests:
    """Digests of sources, cached by path, size, times and inode, so only changed files are reread.

    Parameters
    ----------
    memory : Path, optional
        File that stores the digests, by default in the user's cache. It is rebuilt if lost.
    """

    def __init__(self, memory=None):
        self.memory = memory or cache_folder() / "sources.json"
        self._known, self._changed = None, False

    def of(self, source, *, remember=True):
        """Return the digest of a source; empty if there is no file to read.

        Without ``remember``, call `remember` after the last of many sources.
        """
        try:
            path = source_path(source)
        except PandisError:
            return ""
        if path is None:
            return ""
        digest = source_digest(self.files(path), lambda one: self._entry(one)["sha256"])
        if remember:
            self.remember()
        return digest

    def files(self, path):
        """Return the files of `source_files`, without reading files that have not changed."""
        seen, waiting = [Path(path)], [Path(path)]
        if (beside := regions_file(seen[0])).is_file():
            seen.append(beside)
        while waiting:
            next_file = waiting.pop()
            for name in self._entry(next_file)["names"]:
                other = Path(path).parent / name
                if other not in seen and other.is_file():
                    seen.append(other)
                    waiting.append(other)
        return [seen[0], *sorted(seen[1:])]

    def _entry(self, path):
        if self._known is None:
            try:
                self._known = json.loads(self.memory.read_text(encoding="utf-8"))
            except (OSError, ValueError):
                self._known = {}
        stat = os.stat(path)
        # ctime is included because a copy that preserves mtime cannot preserve ctime
        stamp = [stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns, stat.st_ino]
        entry = self._known.get(str(path.resolve()))
        if not entry or entry.get("stamp") != stamp:
            entry = {"stamp": stamp, "sha256": file_digest(path), "names": _named(path)}
            self._known[str(path.resolve())] = entry
            self._changed = True
        return entry

    def remember(self):
        """Store the digests in the file."""
        if not self._changed:
            return
        self._changed = False
        keep(self.memory, json.dumps(self._known).encode())
