"""C code and its bindings: trees, packing, splines, and the parts of ``pandis.h``.

The system's compiler compiles it on first use, into the user's cache.
"""
