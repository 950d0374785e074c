"""The seal at the end of a file: its provenance, and a checksum of the file and provenance."""

import hashlib
import json
from pathlib import Path

from pandis.base.errors import ArtifactError

#: Marks that open and close the comment at the end of a file. A volume can end in a comment too:
#: programs that read it follow the offsets in its header, and never read its end.
_HTML, _LINE = (b"\n<!-- pandis: ", b" -->\n"), (b"\n# pandis: ", b"\n")
_MARKS = {".html": _HTML, ".xml": _HTML, ".obj": _LINE, ".vdb": _LINE}
#: Extensions of the files sealed this way.
SEALED = frozenset(_MARKS)
#: Length of a checksum, with the space after it.
_DIGITS = 65


def seal(data, provenance, ending):
    """Return the bytes of a file with provenance and checksum as a comment at the end.

    Parameters
    ----------
    data : bytes
    provenance : dict
    ending : {".html", ".xml", ".obj", ".vdb"}
        Ending of the file name.
    """
    start, end = _MARKS[ending]
    # "--" would end an HTML comment
    text = json.dumps(provenance, sort_keys=True).replace("--", "-\\u002d").encode()
    return data + start + _digest(data, text) + text + end


def read_seal(path):
    """Return the provenance of a sealed file.

    Raises
    ------
    ArtifactError
        The file is damaged or was never sealed.
    """
    path = Path(path)
    start, end = _MARKS[path.suffix]
    data, mark, rest = path.read_bytes().rpartition(start)
    text = rest.removesuffix(end)
    digest, text = text[:_DIGITS], text[_DIGITS:]
    if not mark or not rest.endswith(end) or digest != _digest(data, text):
        raise ArtifactError(f"{path}: truncated or damaged")
    return json.loads(text)


def _digest(data, text):
    """Return the checksum of a file and its provenance, followed by a space."""
    return hashlib.sha256(data + text).hexdigest().encode() + b" "
