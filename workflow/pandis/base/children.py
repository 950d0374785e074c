"""The environment of Python processes that the library starts."""

import os


def python_path(root):
    """Return PYTHONPATH for a child process: a folder, then the folders that are on it already.

    On clusters, environment modules provide packages through PYTHONPATH.
    """
    return os.pathsep.join(filter(None, (str(root), os.environ.get("PYTHONPATH"))))
