"""Streams of random numbers: what each part of a stage draws from, by name.

A stage has a seed of its own (`pandis.pipeline.run.plan.stages.stage_seed`). Within a stage every
purpose draws
from a stream of its own, so that one that draws more leaves the others as they are. Two purposes
of one stage never share a number; another number would give other results.
"""

import numpy as np

#: evaluate. Its probe sets, shallow and deep, have 0 and 1.
CONTACTS, COVERAGE = 6, 13
#: stress.
PLACES, QUESTIONS, WANDER, TICKS = 1, 2, 3, 4
#: validate.
WALLS, PRESSES = 21, 22
#: bake_spline, bake_auto, choose. What chooses and what promises has three numbers: see
#: `pandis.pipeline.geometry.points`.
SPLINE = 7
#: train, with the number of the epoch or block; fresh points have that of their stratum first.
ORDER, BOX = 1, 2


def generator(seed, *stream):
    """Return the generator of a stream, named by one number or more."""
    return np.random.default_rng([seed, *stream])
