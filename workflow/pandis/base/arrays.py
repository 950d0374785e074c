"""Shapes of arrays, for signatures.

The letters are lengths: within one call the same letter is the same length. Nothing is checked
while the workflow runs; the tests check every call (`tests/conftest.py`).
"""

import re

import numpy as np
from jaxtyping import AbstractDtype, Bool, Float


class Integer(AbstractDtype):
    """Any integer, also NumPy's `longlong`: trimesh gives it where `int64` has the same bits."""

    dtypes = re.compile(r"u?(int\d+|longlong)")


#: n points, or vectors.
Points = Float[np.ndarray, "n 3"]
#: A matrix for each of n points.
Matrices = Float[np.ndarray, "n 3 3"]
#: A number for each of n points.
Values = Float[np.ndarray, " n"]
#: Yes or no for each of n points.
Flags = Bool[np.ndarray, " n"]
#: A mesh: V corners, and F triangles of them.
Vertices = Float[np.ndarray, "V 3"]
Faces = Integer[np.ndarray, "F 3"]
