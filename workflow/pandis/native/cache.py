"""Where this machine keeps what it would otherwise make again."""

import os
from pathlib import Path


def cache_folder():
    """Return the folder for libraries and digests: ``PANDIS_CACHE``, else in the user's cache."""
    if os.environ.get("PANDIS_CACHE"):
        return Path(os.environ["PANDIS_CACHE"])
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(home) / "pandis"
