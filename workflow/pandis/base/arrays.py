"""Array shapes, for signatures.

Letters stand for lengths: within a call, equal letters mean equal lengths. The workflow checks
nothing at run time; the tests check every call (`tests/conftest.py`).
"""

import re

import numpy as np
from jaxtyping import AbstractDtype, Bool, Float


class Integer(AbstractDtype):
    """Any integer, including NumPy's `longlong`: trimesh returns it where `int64` is as wide."""

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
