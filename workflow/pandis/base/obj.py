"""Meshes as ``.obj`` files, for rendering programs."""


def obj_text(vertices, faces):
    """Return a mesh as ``.obj`` text; its numbers are exact to the last bit."""
    rows = ["v {!r} {!r} {!r}".format(*row) for row in vertices.tolist()]
    rows += ["f {} {} {}".format(*row) for row in (faces + 1).tolist()]
    return "\n".join(rows) + "\n"
