"""Environment variables for the Python processes that the library starts."""

import os


def python_path(root):
    """Return PYTHONPATH for a child process: ``root``, followed by the folders already on it.

    On clusters, environment modules provide packages through PYTHONPATH.
    """
    return os.pathsep.join(filter(None, (str(root), os.environ.get("PYTHONPATH"))))
