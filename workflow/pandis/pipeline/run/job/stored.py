"""Results in an object store: jobs use local copies, but record paths as if there were no store."""

import os

#: Environment variable that passes the folder of the store's local copies to jobs.
COPIES = "PANDIS_COPIES"


def tell_copies(settings):
    """Set `COPIES`, for this process's jobs, to the folder of the default store's local copies.

    Parameters
    ----------
    settings : snakemake.settings.types.StorageSettings
    """
    store = settings.default_storage_prefix
    if store:
        kind, _, bucket = store.rstrip("/").partition("://")
        os.environ[COPIES] = os.path.join(str(settings.local_storage_prefix), kind, bucket)


#: Stands for the results folder in the recorded paths of inputs, because the folder may be moved.
RESULTS = "<results>"


def is_copy(path):
    """Return whether a path is that of a local copy of a stored file."""
    copies = os.environ.get(COPIES)
    return bool(copies) and not os.path.relpath(path, copies).startswith("..")


def original(path):
    """Return ``path``, made relative if it is inside the working directory.

    For a copy, return the path that the file would have without a store. Results record this path
    for each input, so that their bytes are the same with and without a store.
    """
    if is_copy(path):
        return os.path.relpath(path, os.environ[COPIES])
    relative = os.path.relpath(path)
    return relative if not relative.startswith("..") else str(path)
