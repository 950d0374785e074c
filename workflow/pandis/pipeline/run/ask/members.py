"""The meshes of a data set: their names, files and digests, from a folder, list, table or archive.

Planning uses this module. It reads the names in an archive and unpacks nothing.
"""

import csv
import hashlib
import json
import os
import re
import stat
import tarfile
import zipfile
from pathlib import Path, PurePosixPath
from typing import NamedTuple
from urllib.parse import urlsplit

from pandis.base.errors import PandisError, ReadError
from pandis.base.files import file_digest
from pandis.pipeline.run.ask.sourcing import (
    FORMATS,
    SourceDigests,
    format_of,
    source_fault,
    url_extension,
)

#: Endings of archives.
ARCHIVES = (".zip", ".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tar.xz")
#: Largest file in an archive, bytes unpacked, and its largest ratio of unpacked to packed bytes.
LARGEST, RATIO = 4 << 30, 1000


class Member(NamedTuple):
    """A mesh of a data set.

    Attributes
    ----------
    name : str
        Path in the source, without the ending of the format.
    source : str
        Path or URL of its file, or of the archive that contains it.
    inside : str
        Name in the archive; empty if there is none.
    digest : str
        Identifies the contents: SHA-256, or in an archive what its directory says.
    unit, licence, tags, sha256 : str
        From the table; empty if it does not say.
    fault : str
        Why it cannot be read; empty if nothing is known against it.
    """

    name: str
    source: str
    inside: str = ""
    digest: str = ""
    unit: str = ""
    licence: str = ""
    tags: str = ""
    sha256: str = ""
    fault: str = ""


def members(options, digests=None):
    """Return the meshes of a data set, by name.

    Parameters
    ----------
    options : pandis.pipeline.run.ask.datasets.DatasetOptions or ShardTask
        Its ``source`` and ``table``.
    digests : SourceDigests, optional

    Returns
    -------
    list of Member
        Meshes with a fault are among them: two of one name, another sha256 than in the table, a
        path that leaves the archive, or no row in the table.

    Raises
    ------
    PandisError
        The source or the table cannot be read, or the table names meshes that are not there.
    """
    digests = digests or SourceDigests()
    source, table = Path(options.source), {}
    if options.table:
        table = {row["name"]: row for row in _rows(options.table, "name")}
    if source.is_dir():
        listed = list(_of_folder(source))
    elif options.source.lower().endswith(ARCHIVES):
        listed = _of_archive(options.source, digests)
    elif source.suffix == ".txt":
        listed = [_of_line(line, source) for line in _lines(source)]
    elif source.suffix == ".csv":
        listed = [_of_row(row, source) for row in _rows(source, "source")]
    else:
        listed = list(_of_pattern(options.source))
    if not listed:
        raise PandisError(
            f"source: there is no mesh in {options.source}; the known formats are "
            + ", ".join(f".{ending}" for ending in FORMATS)
        )
    listed = _merged(listed, table, options.table)
    listed = sorted(_identified(_once(listed), digests))
    digests.remember()
    return listed


def list_digest(listed):
    """Return the SHA-256 of a list of members."""
    return hashlib.sha256(json.dumps(listed).encode()).hexdigest()


def _of_folder(root):
    def refuse(error):
        raise PandisError(f"source: {error.filename}: cannot be read: {error.strerror}")

    for folder, _, names in os.walk(root, onerror=refuse):
        yield from _visible(root, (Path(folder, name) for name in names))


def _of_pattern(source):
    if format_of(source) in FORMATS and Path(source).is_file():  # a data set of one mesh
        yield Member(_name(Path(source).name), source)
        return
    if not any(c in source for c in "*?["):
        raise PandisError(
            f"source: {source} is neither a folder, a pattern, a list (.txt), a table (.csv) nor "
            "an archive"
        )
    parts = Path(source).parts
    fixed = next(k for k, part in enumerate(parts) if any(c in part for c in "*?["))
    root = Path(*parts[:fixed])
    yield from _visible(root, root.glob("/".join(parts[fixed:])))


def _visible(root, paths):
    for path in paths:
        relative = path.relative_to(root)
        hidden = any(part.startswith(".") for part in relative.parts)
        if not hidden and format_of(path) in FORMATS and path.is_file():
            yield Member(_name(relative), str(path))


def _name(relative):
    """Return the name of a mesh: its path without ``..``, the ending of the format and ``.gz``."""
    parts = PurePosixPath(Path(relative).as_posix()).parts
    text = "/".join(part for part in parts if part not in ("..", "/"))
    ending = format_of(text)
    return re.sub(rf"\.{re.escape(ending)}(\.gz)?$", "", text, flags=re.I) if ending else text


def _lines(path):
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise PandisError(f"source: {path}: cannot be read ({error})") from error
    lines = (line.strip() for line in text.splitlines())
    return [line for line in lines if line and not line.startswith("#")]


def _of_line(line, path):
    if url_extension(line):
        url, _, digest = line.partition(" ")
        return _of_url(url, digest.strip())
    return _beside(line, path)


def _of_url(url, digest):
    fault = "" if re.fullmatch(r"[0-9a-fA-F]{64}", digest) else "a URL needs its sha256 after it"
    return Member(_name(urlsplit(url).path), url, digest=digest.lower(), fault=fault)


def _beside(text, listing):
    """Return the member of a path in a list or table, relative to that file's folder."""
    path = Path(text) if Path(text).is_absolute() else Path(listing).parent / text
    return Member(_name(text), str(path))


def _rows(path, column):
    try:
        with Path(path).open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.DictReader(stream)
            rows = [{k: (v or "").strip() for k, v in row.items() if k} for row in reader]
            columns = reader.fieldnames or []
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise PandisError(f"{path}: cannot be read as CSV ({error})") from error
    if column not in columns:
        raise PandisError(f"{path}: it has no column `{column}`; it has {', '.join(columns)}")
    seen = set()
    for number, row in enumerate(rows, 2):
        if not row[column]:
            raise PandisError(f"{path}, line {number}: `{column}` is empty")
        if row[column] in seen:
            raise PandisError(f"{path}, line {number}: {row[column]} has a row already")
        seen.add(row[column])
    return rows


def _of_row(row, path):
    text = row["source"]
    member = _of_url(text, row.get("sha256", "")) if url_extension(text) else _beside(text, path)
    if row.get("name"):
        member = member._replace(name=row["name"])
    if {"..", "/"} & set(PurePosixPath(member.name).parts):
        member = member._replace(name=_name(member.name), fault="its name leaves the data set")
    return _described(member, row)


def _described(member, row):
    about = {key: row[key] for key in ("unit", "licence", "tags") if row.get(key)}
    return member._replace(sha256=row.get("sha256", "").lower(), **about)


def _merged(listed, table, path):
    """Add what the table says of each member."""
    if not path:
        return listed
    missing = sorted(set(table) - {member.name for member in listed})
    if missing:
        raise PandisError(
            f"table: {path} names {len(missing)} meshes that are not in the source, such as "
            f"{missing[0]}; a name is the path in the source, without the ending"
        )
    no_row = f"it has no row in {path}"
    return [
        _described(member, table[member.name])
        if member.name in table
        else member._replace(fault=member.fault or no_row)
        for member in listed
    ]


def _once(listed):
    """Mark members that share a name."""
    files = {}
    for member in map(_printable, listed):
        files.setdefault(member.name, []).append(member)
    for name, same in files.items():
        member = min(same)
        if len(same) > 1:
            paths = ", ".join(sorted(one.inside or one.source for one in same))
            member = member._replace(fault=f"{len(same)} files have the name {name}: {paths}")
        elif not re.fullmatch(r"[^\x00-\x1f\x7f]{1,1000}", name):
            member = member._replace(fault="its name has characters that cannot be printed")
        yield member


def _printable(member):
    """Mark a member whose name is not text, and write it so that it can be printed."""
    texts = [text.encode("utf-8", "surrogateescape").decode("utf-8", "replace")
             for text in (member.name, member.source, member.inside)]  # fmt: skip
    if texts == [member.name, member.source, member.inside]:
        return member
    name, source, inside = texts
    fault = "its name is not UTF-8: rename it"
    return member._replace(name=name, source=source, inside=inside, fault=fault)


def _identified(listed, digests):
    """Add the digests of files; compare them with those of the table."""
    for member in listed:
        remote = member.inside or url_extension(member.source)
        yield member if member.fault or remote else _with_digest(member, digests)


def _with_digest(member, digests):
    try:
        if fault := source_fault(member.source):
            return member._replace(fault=fault.removeprefix("source: "))
        expected, digest, fault = member.sha256, digests.of(member.source, remember=False), ""
        if expected and expected != digest and expected != (sha256 := file_digest(member.source)):
            fault = f"its sha256 is {sha256}, but the table says {expected}"
    except OSError as error:
        return member._replace(fault=f"it cannot be read: {error.strerror}")
    except ReadError as error:  # a file beside it, too
        return member._replace(fault=str(error))
    return member._replace(digest=digest, fault=fault)


# --- archives ---------------------------------------------------------------------------


def _of_archive(source, digests):
    try:
        if source.lower().endswith(".zip"):
            with zipfile.ZipFile(source) as archive:
                return [_of_zip(source, info) for info in archive.infolist() if _is_mesh(info)]
        with tarfile.open(source) as archive:
            most = RATIO * Path(source).stat().st_size
            listed = [_of_tar(source, info, most) for info in archive if _is_mesh(info)]
    except (OSError, EOFError, zipfile.BadZipFile, tarfile.TarError) as error:
        raise PandisError(f"source: {source} is no complete archive ({error})") from error
    digest = digests.of(source, remember=False)
    return [member._replace(digest=f"{digest} {member.inside}") for member in listed]


def _is_mesh(info):
    name = getattr(info, "filename", None) or info.name
    folder = info.is_dir() if hasattr(info, "is_dir") else info.isdir()
    hidden = any(part.startswith((".", "__MACOSX")) and part not in (".", "..")
                 for part in PurePosixPath(name).parts)  # fmt: skip
    return not folder and not hidden and format_of(name) in FORMATS


def _of_zip(source, info):
    link = stat.S_ISLNK(info.external_attr >> 16)
    fault = _entry_fault(info.filename, info.file_size, link=link)
    if not fault and info.file_size > RATIO * max(info.compress_size, 1) + (1 << 20):
        fault = f"it unpacks to more than {RATIO} times its size in the archive"
    if info.flag_bits & 1:
        fault = "it is encrypted"
    digest = f"crc32 {info.CRC:08x} {info.file_size}"
    return Member(_name(info.filename), source, info.filename, digest, fault=fault)


def _of_tar(source, info, most):
    fault = _entry_fault(info.name, info.size, link=not info.isreg())
    if not fault and info.size > most:
        fault = f"it unpacks to more than {RATIO} times the size of the archive"
    return Member(_name(info.name), source, info.name, fault=fault)


def _entry_fault(name, size, *, link):
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or "\\" in name or re.match(r"[A-Za-z]:", name):
        return f"its path in the archive ({name}) leaves the archive"
    if link:
        return "it is a link or a device in the archive, and no file"
    return f"it unpacks to more than {LARGEST >> 30} GiB" if size > LARGEST else ""
