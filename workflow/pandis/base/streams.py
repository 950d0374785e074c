"""Numbers that select each stage's random streams.

Every stage has its own seed (`pandis.pipeline.run.plan.stages.stage_seed`). Within a stage every
purpose has its own stream, so that drawing more for one leaves the others unchanged. Two purposes
of one stage never share a number. Changing a number changes results.
"""

import numpy as np

#: Stage evaluate. Its shallow and deep probe sets use streams 0 and 1.
CONTACTS, COVERAGE = 6, 13
#: Stage stress.
PLACES, QUESTIONS, WANDER, TICKS = 1, 2, 3, 4
#: Stage validate.
WALLS, PRESSES = 21, 22
#: Stages bake_spline, bake_auto and choose. Streams for choosing and for promises have three
#: numbers: see `pandis.pipeline.geometry.points`.
SPLINE = 7
#: Stage train; an epoch or block number follows. Streams of fresh points begin with their stratum.
ORDER, BOX = 1, 2


def generator(seed, *stream):
    """Return the random generator of a stream, identified by one or more numbers."""
    return np.random.default_rng([seed, *stream])
