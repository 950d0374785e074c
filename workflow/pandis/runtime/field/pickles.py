"""Pickling of fields: a file's path, and a stamp that shows whether the file has changed."""

from pandis.base.errors import ArtifactError


def stamp(path):
    """Return a file's size and modification time, to detect changes; None if it is missing."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_size, status.st_mtime_ns


def reopened(path, known):
    """Open a pickled field's file.

    Raises
    ------
    ArtifactError
        The file is missing, or its stamp differs from ``known``.
    """
    from pandis.runtime.field import NativeField

    if stamp(path) != known:
        raise ArtifactError(f"{path}: the file has changed since the field was pickled, or is gone")
    return NativeField(path)
