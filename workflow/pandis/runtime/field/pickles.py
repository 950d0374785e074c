"""Fields in pickles: the path of a file, and what tells whether it is still the same."""

from pandis.base.errors import ArtifactError


def stamp(path):
    """Return what tells whether a file is still the one it was; None if it is not there."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_size, status.st_mtime_ns


def reopened(path, known):
    """Open a file that a pickle names.

    Raises
    ------
    ArtifactError
        It is gone, or has another stamp than the one known.
    """
    from pandis.runtime.field import NativeField

    if stamp(path) != known:
        raise ArtifactError(f"{path}: it has changed since the field was pickled, or is gone")
    return NativeField(path)
