"""The seal at the end of the report: its provenance, and a checksum of the page before it."""

import hashlib
import json
from pathlib import Path

from pandis.errors import ArtifactError

_MARK = "\n<!-- pandis: "


def seal(page, provenance):
    """Return a page with its provenance and checksum as a comment at the end."""
    digest = hashlib.sha256(page.encode()).hexdigest()
    # "--" would end an HTML comment
    text = json.dumps({"provenance": provenance, "sha256": digest}, sort_keys=True)
    comment = text.replace("--", "-\\u002d")
    return f"{page}{_MARK}{comment} -->\n"


def read_seal(path):
    """Return the provenance of a sealed page.

    Raises
    ------
    ArtifactError
        The page is damaged or was never sealed.
    """
    page, mark, rest = Path(path).read_bytes().partition(_MARK.encode())
    try:
        seal = json.loads(rest.removesuffix(b" -->\n"))
        whole = mark and seal["sha256"] == hashlib.sha256(page).hexdigest()
    except (ValueError, KeyError, TypeError):
        whole = False
    if not whole:
        raise ArtifactError(f"{path}: truncated or damaged")
    return seal["provenance"]
