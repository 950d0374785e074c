"""Downloads a mesh and checks its digest before it is stored."""

import hashlib
import http.client
import urllib.error
import urllib.request

from pandis.base.errors import PandisError

_BLOCK = 1 << 20


def fetch(url, sha256, progress):
    """Download a URL, check its SHA-256, and return its bytes.

    Raises
    ------
    PandisError
        The URL cannot be fetched, or the digest differs.
    """
    try:
        with urllib.request.urlopen(url, timeout=60) as response:
            total = int(response.headers.get("Content-Length") or 0)
            report, parts, done = progress("download", total or 1, "bytes"), [], 0
            while block := response.read(_BLOCK):
                parts.append(block)
                done += len(block)
                if total:
                    report.update(done)
    except (urllib.error.URLError, http.client.HTTPException, OSError, ValueError) as error:
        raise PandisError(
            f"{url}: cannot be fetched ({error}); without network access, download it "
            "elsewhere and give its path as `source`"
        ) from error
    data = b"".join(parts)
    digest = hashlib.sha256(data).hexdigest()
    if digest != sha256.lower():
        raise PandisError(
            f"{url}: the downloaded file's sha256 is {digest}, but the configuration says "
            f"{sha256.lower()}; the file changed or the download failed: correct sha256 or the URL"
        )
    return data
