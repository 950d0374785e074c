"""The `compact` field: exact distances to the mesh with its vertices on a lattice."""

import numpy as np

from pandis.base.frame import Frame
from pandis.engine.packing.unpacking import unpack
from pandis.pipeline.geometry.distance import SURFACE_DISTANCE, MeshDistance
from pandis.pipeline.kinds.compact.lattice import to_unit
from pandis.pipeline.kinds.compact.record import CompactRecord
from pandis.pipeline.kinds.field import Field


class CompactField(Field):
    """A mesh on a lattice, queried through a tree over its faces in double precision.

    ``pandis.h`` queries the packed bytes; the exported file is compared with this field.

    Parameters
    ----------
    name : str
    artifact : pandis.pipeline.run.job.artifact.Artifact
        Artifact of kind ``compact``.
    """

    kind = "compact"

    def __init__(self, name, artifact):
        self.record, self.arrays = CompactRecord.of(artifact), dict(artifact.arrays)
        vertices, faces = unpack(self.arrays)
        self.engine = MeshDistance(to_unit(vertices, self.record.bits), faces)
        size = sum(part.nbytes for part in self.arrays.values())
        super().__init__(name, Frame.of(artifact), size)

    def answer(self, points):
        """Return distance (n,) and normal (n, 3) at points (n, 3), all in the unit frame.

        Sides come from the winding number, as in the packed mesh: pseudonormals are ambiguous
        where sheets coincide on the lattice, or pieces vanish.
        """
        distance, normal = self.engine.distance_and_normal(points, check=False)
        wrong = self.engine.inside(points) != (distance < 0)
        wrong &= np.abs(distance) > SURFACE_DISTANCE
        return np.where(wrong, -distance, distance), np.where(wrong[:, None], -normal, normal)


def open_field(spec, artifact):
    """Return the field of a `FieldSpec` from its artifact."""
    return CompactField(spec.name, artifact)
