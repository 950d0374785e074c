"""The repaired mesh as an ``.obj`` file, for programs that draw it."""

from pandis.base.obj import obj_text


def export_mesh(body):
    """Return the bytes of a mesh in its own units, every number to the last bit.

    Parameters
    ----------
    body : pandis.pipeline.geometry.body.Body
    """
    return obj_text(body.vertices, body.faces).encode()
