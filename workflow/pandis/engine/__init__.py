"""C code and its bindings: trees, packing, splines, and the parts of ``pandis.h``.

On first use the system's compiler compiles the code into the user's cache.
"""
