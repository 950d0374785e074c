"""The exact field: the paper's GT, but through a tree instead of brute force."""

import numpy as np

from pandis.engine.bvh import LEAF_BYTES, NODE_BYTES
from pandis.pipeline.geometry.distance import ShapeDistance
from pandis.pipeline.kinds.field import Field
from pandis.runtime.field import MESH, SHAPE, SHAPES
from pandis.runtime.field.files import pack

#: The first version of the format that knows meshes as they are written now.
MESH_VERSION = 4


class ExactField(Field):
    """Exact distance and direction of a mesh or a closed-form shape."""

    def __init__(self, name, body):
        self.engine = body.distance
        super().__init__(name, body.frame, body.bytes)

    def answer(self, points):
        """Answer distance (n,) and normal (n, 3) at points (n, 3), all in the unit frame."""
        # as in a loop: signs are compared with the winding number where labels are made
        return self.engine.distance_and_normal(points, check=False)

    def file_parts(self, most):
        """Return what its file holds: the number of its kind, whole and real numbers, sections.

        Parameters
        ----------
        most : int
            Nodes, leaves and faces that a query may look at.
        """
        if isinstance(self.engine, ShapeDistance):
            shape = self.engine.shape
            names = shape.__dataclass_fields__
            sizes = np.ravel([getattr(shape, name) for name in names]).tolist()
            return SHAPE, [SHAPES.index(type(shape).__name__.lower())], sizes, {}
        sections = self.engine.tree_parts()
        counts = [
            len(sections["VERT"]) // 24,
            len(sections["FACE"]) // 12,
            len(sections["TREE"]) // NODE_BYTES,
            len(sections["LEAF"]) // LEAF_BYTES,
        ]
        return MESH, [*counts, most], [self.engine.reach], sections

    def file(self, most):
        """Return the bytes of a ``.pandis`` file of this field, without provenance."""
        kind, wholes, reals, sections = self.file_parts(most)
        version = MESH_VERSION if kind == MESH else 1
        return pack(kind, self.frame, wholes, reals, sections, {}, version)
