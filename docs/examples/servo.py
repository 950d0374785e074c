"""The same from Python: a probe of 50 g falls onto an object and comes to rest on it.

    PYTHONPATH=workflow .venv/bin/python docs/examples/servo.py FIELD.pandis STIFFNESS

Python cannot keep a servo rate; for planning, simulation and plots it need not.
"""

import sys

import numpy as np

import pandis
from pandis.frame import UNIT_SIDE


def main(path, stiffness):
    """Let a probe fall, and print where it comes to rest."""
    field = pandis.load(path)
    centre, scale = field.frame
    unit = 0.10 * scale / UNIT_SIDE  # metres per mesh unit: the longest side is to be 10 cm
    position = np.array(centre) + [0, 0.95 / scale, 0]
    velocity, mass, damping, gravity = np.zeros(3), 0.05, 2.0, np.array([0, -9.81, 0])
    for _ in range(2000):
        force = field.force(position, k=stiffness * unit)[0]
        velocity += (force / mass + gravity - damping / mass * velocity) * 1e-3
        position += velocity / unit * 1e-3
    distance, _ = field.distance_and_normal(position)
    rest = ", ".join(f"{f:.3f}" for f in force)
    print(f"at rest {-1e3 * distance[0] * unit:.2f} mm below the surface, force {rest} N")


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))
