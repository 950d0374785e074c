"""The file of an exact field: its tree and its mesh, or the parameters of its closed form."""

import numpy as np

from pandis.engine.bvh import LEAF_BYTES, NODE_BYTES
from pandis.pipeline.geometry.distance import ShapeDistance
from pandis.pipeline.kinds.check import check_nearest
from pandis.pipeline.kinds.limits import least_limit
from pandis.pipeline.kinds.native import FieldFile, regions_of
from pandis.runtime.field import NativeField
from pandis.runtime.field.constants import MESH, SHAPE, SHAPES
from pandis.runtime.field.files import Parts

#: Maximum number of nodes, leaves and faces that a query near the surface visits, enough for every
#: query on scans. The limit is raised if half of it would cut a query next to the surface.
MOST = 1000
#: Largest allowed difference between the file's distances and the library's (unit frame).
_ROUNDING = 1e-12


class File(FieldFile):
    """See `FieldFile`."""

    def __init__(self, field, weight_bits, most=None):
        super().__init__(field, weight_bits)
        self.shape = field.engine.shape if isinstance(field.engine, ShapeDistance) else None
        self.version = 1 if self.shape else 4
        self._most = most

    def parts(self):
        """See `FieldFile.parts`."""
        if self.shape:
            names = self.shape.__dataclass_fields__
            sizes = np.ravel([getattr(self.shape, name) for name in names]).tolist()
            return Parts(SHAPE, [SHAPES.index(type(self.shape).__name__.lower())], sizes, {})
        engine = self.field.engine
        sections = engine.tree_parts()
        counts = [
            len(sections["VERT"]) // 24,
            len(sections["FACE"]) // 12,
            len(sections["TREE"]) // NODE_BYTES,
            len(sections["LEAF"]) // LEAF_BYTES,
        ]
        most = self._least() if self._most is None else self._most
        return Parts(MESH, [*counts, most], [engine.reach], sections)

    def _least(self):
        """Return the limit on nodes, leaves and faces per query: see `least_limit`."""
        engine, frame = self.field.engine, self.field.frame

        def query(points, most):
            native = NativeField(File(self.field, self.weight_bits, most).data({}))
            answer, clear = native.query_within(frame.to_mesh(points), np.inf)
            return answer.distance, clear

        return least_limit(MOST, engine.vertices, engine.faces, query=query)

    def faces(self, body, original_faces):
        """See `FieldFile.faces`."""
        regions = None if self.shape else body.regions
        return regions_of(regions.of_face, regions.names) if regions else {}

    def left_out(self, native, points):
        """Return a mask of the points whose queries are cut: only their bounds are compared."""
        return native.clear(points) < np.abs(native.query(points).distance)

    def differences(self, exported):
        """See `FieldFile.differences`."""
        if self.shape:
            return super().differences(exported)
        differences = super().differences(exported, self.left_out)
        return differences | check_nearest(exported, self.field.engine, _ROUNDING)
