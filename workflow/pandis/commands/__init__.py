"""The command ``pandis``: one module for files, with NumPy only, and one for meshes."""
