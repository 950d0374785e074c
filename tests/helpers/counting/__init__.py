"""What the formats' standards say about a mesh file, one module a format, for `counter.py`.

Nothing here may use a mesh library or the project: it is what the project is held against.
"""
