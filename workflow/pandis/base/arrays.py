"""Array types with shapes, for type annotations.

Letters stand for lengths: within a call, equal letters mean equal lengths. The tests check the
shapes in every call (`tests/conftest.py`); the workflow does not check them at run time.
"""

import re

import numpy as np
from jaxtyping import AbstractDtype, Bool, Float


class Integer(AbstractDtype):
    """Any integer type, including `longlong`, which trimesh uses where it is as wide as `int64`."""

    dtypes = re.compile(r"u?(int\d+|longlong)")


#: n points, or vectors.
Points = Float[np.ndarray, "n 3"]
#: A 3 by 3 matrix for each of n points.
Matrices = Float[np.ndarray, "n 3 3"]
#: A number for each of n points.
Values = Float[np.ndarray, " n"]
#: A boolean for each of n points.
Flags = Bool[np.ndarray, " n"]
#: A mesh: V vertices, and F triangles as vertex indices.
Vertices = Float[np.ndarray, "V 3"]
Faces = Integer[np.ndarray, "F 3"]
