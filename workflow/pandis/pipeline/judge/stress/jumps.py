"""Tests for jumps: changes of the force over short moves, which a device renders as clicks."""

import numpy as np

from pandis.base.forces import penalty_force
from pandis.pipeline.judge.stress.probes import excess

#: Lengths of moves (m): the distances covered in a tick at 0.1 m/s (0.1 mm), 0.5 m/s and 1 m/s.
WAYS = {"mm01": 1e-4, "tick05": 5e-4, "tick1": 1e-3}
_COUNTED = "mm01"
#: A force jumps if it changes by more than this times k · way, unless the exact one does so nearby.
STEEP = 2.0
#: Largest share of the moves over which the force may jump.
ALLOWED = 0.005
#: The force may change by at most WORST · k · way more than the exact force does nearby. Only the
#: share RARE of the moves may exceed this. RARE is small because even a long seam is so thin that
#: few moves cross it.
WORST, RARE = 5.0, 1e-4
#: Length, in multiples of a move, over which a change of the exact force counts as nearby: smooth
#: fields spread jumps.
NEARBY = 10


def jumps(answer, exact, shell, *, along, scale, device):
    """Measure the changes of the force over short moves.

    Parameters
    ----------
    answer, exact : callable
    shell : pandis.pipeline.judge.stress.probes.Shell
        Points at which moves begin.
    along : ndarray, shape (n, 3)
        Unit vectors along the moves. All moves are tested over 0.1 mm, a tenth of them over other
        lengths.
    scale : pandis.base.physical.Scale
    device : pandis.pipeline.judge.stress.physical.Device

    Returns
    -------
    dict
        ``…_p999``, ``…_max`` and ``…_rms``: changes in newtons over an encoder step (``encoder``),
        0.1 mm (``mm01``), and a tick at 0.5 and 1 m/s; ``jumps``: the share of moves of 0.1 mm over
        which the force jumps and the exact one does not; ``worst_n``: the change beyond that of the
        exact force on the worst move in ten thousand; ``limit``; ``passed``; ``exact_…``: changes
        of the exact force over 0.1 mm.
    """
    figures = {}
    for name, way in {"encoder": device.encoder, **WAYS}.items():
        part = slice(None, None, 1 if name == _COUNTED else 10)
        change = _changes(answer, shell.points[part], along[part], way=way * scale.metre)
        figures |= _change_figures(name, change * scale.newtons)
        if name == _COUNTED:
            flat = way * scale.metre
            exactly = _changes(exact, shell.points, along, way=flat)
            figures |= _change_figures("exact", exactly * scale.newtons)
            reference = _nearby(exact, shell.points, along, way=flat, exactly=exactly)
            share = excess(change, reference, STEEP * flat, weight=shell.weight)
            worst = _upper(change - reference, shell.weight, RARE)
    passed = share <= ALLOWED and worst <= WORST * flat
    worst_n = float(worst * scale.newtons)
    return figures | {"jumps": share, "worst_n": worst_n, "limit": ALLOWED, "passed": bool(passed)}


def _change_figures(name, change):
    """Return percentile, maximum and root mean square of force changes (n,), newtons."""
    levels = {
        "p999": np.percentile(change, 99.9),
        "max": change.max(),
        "rms": np.sqrt((change**2).mean()),
    }
    return {f"{name}_{level}": float(value) for level, value in levels.items()}


def _nearby(exact, points, along, *, way, exactly):
    """Return how much (n,) the exact force changes over a longer move, beyond a flat wall's share.

    The longer move has the same middle and is NEARBY times as long. What a flat wall adds over the
    extra length is subtracted. The result is at least ``exactly``, the change over the move itself.
    """
    middle = points + way / 2 * along
    whole = _changes(exact, middle - NEARBY * way / 2 * along, along, way=NEARBY * way)
    return np.maximum(whole - (NEARBY - 1) * way, exactly)


def _upper(values, weight, share):
    """Return the value that only ``share`` of the area exceeds."""
    order = np.argsort(-values, kind="stable")
    return values[order[np.searchsorted(np.cumsum(weight[order]), share)]]


def _changes(answer, points, along, *, way):
    ends = np.concatenate([points, points + way * along])
    one, other = np.split(penalty_force(*answer(ends)), 2)
    return np.linalg.norm(other - one, axis=1)
