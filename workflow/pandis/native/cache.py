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


def remembered(maker, text, make):
    """Return what `make` makes of a text, or what an earlier process has kept of it.

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
        return json.loads(path.read_bytes())
    except (OSError, ValueError):
        value = json.loads(json.dumps(make()))  # as the next process will read it
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=path.parent, delete=False) as stream:
            json.dump(value, stream)
        os.replace(stream.name, path)
    except OSError:
        pass  # a cache that cannot be written costs time alone
    return value


@cache
def _identity(maker):
    """Return a digest of a module and of the version of Python that runs it."""
    version = repr(sys.version_info[:2]).encode()
    return hashlib.sha256(version + Path(maker).read_bytes()).digest()
