"""Where this machine keeps what it would otherwise make again."""

import hashlib
import json
import os
import sys
import tempfile
from functools import cache
from pathlib import Path


def cache_folder():
    """Return the folder for libraries and digests: ``PANDIS_CACHE``, else in the user's cache."""
    if os.environ.get("PANDIS_CACHE"):
        return Path(os.environ["PANDIS_CACHE"])
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(home) / "pandis"


def keep(path, data):
    """Put bytes into the cache, all of them or nothing, whoever else does the same.

    A cache that cannot be written costs time alone.
    """
    part = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as stream:
            part = Path(stream.name)
            stream.write(data)
        part.replace(path)
    except OSError:
        if part:
            part.unlink(missing_ok=True)


def remembered(maker, text, make):
    """Return what `make` makes of a text, or what an earlier process has kept of it.

    What was kept stands behind its own digest: if it is damaged, it is made again.

    Parameters
    ----------
    maker : path-like
        The module that makes it (its ``__file__``): edited, it makes everything anew.
    text : bytes
        What the value depends on besides.
    make : callable
        Returns something that JSON holds.
    """
    path = cache_folder() / "texts" / hashlib.sha256(_identity(maker) + text).hexdigest()
    try:
        digest, _, stored = path.read_bytes().partition(b"\n")
        if digest == _digest(stored):
            return json.loads(stored)
    except OSError:
        pass
    stored = json.dumps(make()).encode()
    keep(path, _digest(stored) + b"\n" + stored)
    return json.loads(stored)  # as the next process will read it


def _digest(data):
    return hashlib.sha256(data).hexdigest().encode()


@cache
def _identity(maker):
    """Return a digest of a module and of the version of Python that runs it."""
    version = repr(sys.version_info[:2]).encode()
    return hashlib.sha256(version + Path(maker).read_bytes()).digest()
