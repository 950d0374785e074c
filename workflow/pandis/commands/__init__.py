"""The command ``pandis``: one module for files, with NumPy only, and one for meshes."""

#: Exit statuses: fine; not fit for use; wrong arguments; refused.
FINE, UNFIT, USAGE, REFUSED = range(4)
