"""This machine's cache of compiled libraries and computed values."""

import hashlib
import json
import os
import sys
import tempfile
from functools import cache
from pathlib import Path


def cache_folder():
    """Return the cache folder: ``PANDIS_CACHE``, else ``pandis`` in the user's cache."""
    if os.environ.get("PANDIS_CACHE"):
        return Path(os.environ["PANDIS_CACHE"])
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(home) / "pandis"


def keep(path, data):
    """Write a cache file atomically, even if other processes write it at the same time.

    If the cache is not writable, do nothing: later processes merely repeat the work.
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
    """Return the result of `make`, from the cache if an earlier process has stored it.

    Each result is stored with a digest, so that a damaged one is detected and recomputed.

    Parameters
    ----------
    maker : path-like
        ``__file__`` of the module that computes the result; editing it makes all its results stale.
    text : bytes
        Everything else that the result depends on.
    make : callable
        Computes the result, which must be JSON-serialisable.
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
    return json.loads(stored)  # the same value that later processes read


def _digest(data):
    return hashlib.sha256(data).hexdigest().encode()


@cache
def _identity(maker):
    """Return a digest of a module and of the Python version (major.minor)."""
    version = repr(sys.version_info[:2]).encode()
    return hashlib.sha256(version + Path(maker).read_bytes()).digest()
