"""Results in an object store: a job works on local copies, and results are named without them."""

import os

#: The variable that tells a job where the copies of a store lie.
COPIES = "PANDIS_COPIES"


def tell_copies(settings):
    """Let this process's jobs know where Snakemake puts the copies of the default store.

    Parameters
    ----------
    settings : snakemake.settings.types.StorageSettings
    """
    store = settings.default_storage_prefix
    if store:
        kind, _, bucket = store.rstrip("/").partition("://")
        os.environ[COPIES] = os.path.join(str(settings.local_storage_prefix), kind, bucket)


#: How the folder of results is written where a result names its inputs: it may be moved.
RESULTS = "<results>"


def is_copy(path):
    """Tell whether a path is that of a copy of what is in a store."""
    copies = os.environ.get(COPIES)
    return bool(copies) and not os.path.relpath(path, copies).startswith("..")


def original(path):
    """Return ``path`` relative to the working directory where it lies below it.

    Of a copy, the path that its file would have without a store: results name their inputs by it,
    so that they have the same bytes with a store and without.
    """
    if is_copy(path):
        return os.path.relpath(path, os.environ[COPIES])
    relative = os.path.relpath(path)
    return relative if not relative.startswith("..") else str(path)
