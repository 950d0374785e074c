"""Meshes as ``.obj`` files, for programs that draw them."""


def obj_text(vertices, faces):
    """Return a mesh as the text of an ``.obj`` file, every number to the last bit."""
    rows = ["v {!r} {!r} {!r}".format(*row) for row in vertices.tolist()]
    rows += ["f {} {} {}".format(*row) for row in (faces + 1).tolist()]
    return "\n".join(rows) + "\n"
