"""Everything that answers "distance and normal at these points".

One module per family; `pandis.pipeline.kinds.opening` opens any of them by name.
"""
