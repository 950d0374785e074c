"""Files that are written completely or not at all."""

import errno
import hashlib
import os
import secrets
import stat
from contextlib import suppress
from pathlib import Path

from pandis.base.errors import PandisError, ReadError


def file_digest(path):
    """Return the SHA-256 (hex) of a file's bytes.

    Raises
    ------
    ReadError
        The file cannot be read.
    """
    try:
        with Path(path).open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        why = error.strerror or error
        raise ReadError(f"{path}: the file cannot be read: {why}") from error


class AtomicFile:
    """A file that is written under a temporary name and renamed once it is whole and on disk."""

    def __init__(self, path, name=None):
        self.path, self.name = Path(path), name or path
        self.part = self.path.with_name(f".{self.path.name}.part")
        self.stream = None

    def open(self):
        """Open a temporary file and return the stream to write to."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.stream = self.part.open("w+b")
        except OSError as error:
            raise self.explain(error) from error
        return self.stream

    def keep(self):
        """Move the file into place once it is on disk."""
        self.stream.flush()
        os.fsync(self.stream.fileno())
        self.stream.close()
        self.part.replace(self.path)
        folder = os.open(self.path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)

    def discard(self):
        """Remove the temporary file, if there is one."""
        if self.stream and not self.stream.closed:
            with suppress(OSError):  # closing flushes, which fails again on a full disk
                self.stream.close()
        with suppress(OSError):  # on a read-only file system, even if there is no file
            self.part.unlink(missing_ok=True)

    def explain(self, error):
        """Return a PandisError that describes an error and says what to do."""
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        return PandisError(
            f"{self.name}: cannot write: {error.strerror or error}; "
            + ("free some space" if full else "check the folder's permissions")
            + " and run the same command again"
        )


def write_atomically(path, data, name=None):
    """Write ``data`` (bytes) to ``path`` in one step, completely or not at all.

    Messages call the file ``name``, if given.

    Raises
    ------
    PandisError
        The disk is full or the folder is not writable.
    """
    file = AtomicFile(path, name)
    try:
        file.open().write(data)
        file.keep()
    except OSError as error:
        raise file.explain(error) from error
    finally:
        file.discard()


def check_output(path, *, force):
    """Refuse a path at which no file can be written, before any work is done.

    Raises
    ------
    PandisError
        The path exists (unless ``force``), is a folder, or lies in none.
    """
    path = Path(path)
    try:
        kind = path.stat().st_mode
    except FileNotFoundError:
        kind = None
    except OSError as error:
        raise PandisError(f"{path}: cannot be written: {error.strerror}") from error
    if kind is None:
        if not path.parent.is_dir():
            raise PandisError(f"{path}: there is no folder {path.parent}; create it")
    elif stat.S_ISDIR(kind):
        raise PandisError(f"{path} is a folder; name a file in it")
    elif not stat.S_ISREG(kind):
        raise PandisError(f"{path} is a device and no file; name a file")
    elif not force:
        raise _exists(path)


def _exists(path):
    return PandisError(f"{path} exists; --force (force=True) replaces it")


def write_new(path, data, *, check=None, force=False):
    """Write a file beside its place, check it there, and move it.

    Without ``force``, of several processes that write one path, one succeeds and the others are
    refused.

    Parameters
    ----------
    path : path-like
    data : bytes
    check : callable, optional
        Takes the path of the written file, which has the same ending; raises if it is wrong.
    force : bool
        Whether to replace an existing file.

    Raises
    ------
    PandisError
        As from `check_output` and `write_atomically`. Nothing is left behind.
    """
    path = Path(path)
    check_output(path, force=force)
    if path.is_symlink():
        path = path.resolve()  # the link stays
    part = path.with_name(f".{secrets.token_hex(8)}{path.suffix}")  # a name may be 255 bytes long
    try:
        write_atomically(part, data, path)
        if check:
            check(part)
        if force:
            part.replace(path)
            return
        try:
            os.link(part, path)  # unlike a move, this fails if the file exists
        except FileExistsError:
            raise _exists(path) from None
        except OSError:  # a file system without hard links
            check_output(path, force=False)
            part.replace(path)
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)
