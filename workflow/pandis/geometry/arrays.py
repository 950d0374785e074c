"""Shapes of arrays, for signatures.

The letters are lengths: within one call the same letter is the same length. Nothing is checked
while the workflow runs; the tests check every call (`tests/conftest.py`).
"""

import numpy as np
from jaxtyping import Bool, Float, Integer

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
