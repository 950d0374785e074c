"""The loop of servo.cpp in Python: let a probe of 50 g down onto an object until it rests there.

    PYTHONPATH=workflow .venv/bin/python docs/examples/servo.py FIELD.pandis STIFFNESS

Python cannot keep a servo rate, but planning, simulation and plots do not need one.
"""

import sys

import numpy as np

import pandis
from pandis.base.frame import UNIT_SIDE

MASS, GRAVITY = 0.05, 9.81
#: Damping (Ns/m) and stiffness (N/m) of the hand that keeps the probe over its place.
DAMPING, GUIDE = 2.0, 500.0


def level_place(field, deep):
    """Return the most level place, seen from above, whose solid is ``deep`` thick; else None."""
    centre, reach = np.array(field.frame.centre), 0.9 / field.frame.scale
    across = reach * (2 * (np.arange(40) + 0.5) / 40 - 1)
    heights = np.linspace(reach, -reach, 400)
    best, place = 0.0, None
    for x in across:
        for z in across:
            line = centre + np.column_stack([np.full(400, x), heights, np.full(400, z)])
            inside = np.flatnonzero(field.distance_and_normal(line)[0] < -2 * reach / 400)
            if not len(inside):
                continue
            top = line[inside[0]]
            distance, normal = field.distance_and_normal([top, top - [0, deep, 0]])
            level = normal[:, 1].min()
            if distance[1] < -deep / 2 and level > best:
                best, place = level, top
    return place


def main(path, stiffness):
    """Let a probe down, and print where it comes to rest."""
    field = pandis.load(path)
    unit = 0.10 * field.frame.scale / UNIT_SIDE  # metres per mesh unit: longest side 10 cm
    guide = level_place(field, 0.004 / unit)
    if guide is None:
        return print("no level place found where the solid is 4 mm thick")
    position, velocity = guide + [0, 0.002 / unit, 0], np.zeros(3)
    held = []
    for _ in range(2000):
        force = field.force(position, k=stiffness * unit)[0]
        hand = GUIDE * (guide - position) * unit
        hand[1] = -MASS * GRAVITY
        velocity += (force + hand - DAMPING * velocity) / MASS * 1e-3
        position += velocity / unit * 1e-3
        held.append(force[1])
    below = -1e3 * field.distance_and_normal([position])[0][0] * unit
    print(
        f"{below:.2f} mm below the surface, held with {np.mean(held[-500:]):.3f} N, "
        f"moving at {abs(velocity[1]):.1e} m/s"
    )


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))
