"""The repaired mesh as an ``.obj`` file, for programs that draw it."""

from pandis.base.obj import obj_text


def export_mesh(body):
    """Return the bytes of an ``.obj`` file in mesh units; no coordinate is rounded.

    Parameters
    ----------
    body : pandis.pipeline.geometry.body.Body
    """
    return obj_text(body.vertices, body.faces).encode()
