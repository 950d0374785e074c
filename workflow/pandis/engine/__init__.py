"""C code and its bindings: trees, packing, splines, and the parts of ``pandis.h``.

It is compiled on first use by the system's compiler, into the user's cache.
"""
