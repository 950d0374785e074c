"""How much the force changes over a short way: what a device turns into a click."""

import numpy as np

from pandis.forces import penalty_force

#: Lengths (m): a tenth of a millimetre, and what a tick at 0.1, 0.5 and 1 m/s covers.
WAYS = {"mm01": 1e-4, "tick05": 5e-4, "tick1": 1e-3}
_COUNTED = "mm01"
#: A change of more than so many times k · the way is a jump. The exact force has some, too: a
#: field's may be a tenth more and a tenth larger, and so many besides (share of the ways).
STEEP, MORE, ALLOWED = 2.0, 1.1, 1e-4


def jumps(answer, exact, points, along, scale, device):
    """Measure the changes of the force.

    Parameters
    ----------
    answer, exact : callable
    points, along : ndarray, shape (n, 3)
        Where ways begin, and unit vectors along them. All are taken over 0.1 mm, a tenth over
        the other ways.
    scale, device
        See `pandis.stress.physical`.

    Returns
    -------
    dict
        In newtons, over an encoder step (``encoder``), 0.1 mm (``mm01``: what a tick at 0.1 m/s
        covers), and a tick at 0.5 and 1 m/s: ``…_p999``, ``…_max`` and ``…_rms``; ``jumps``, the
        share of ways of 0.1 mm with one; ``limit``: how many there may be; ``passed``.
    """
    found = {}
    for name, way in {"encoder": device.encoder, **WAYS}.items():
        part = slice(None, None, 1 if name == _COUNTED else 10)
        change = _changes(answer, points[part], along[part], way * scale.metre)
        found[f"{name}_p999"] = float(np.percentile(change, 99.9) * scale.newtons)
        found[f"{name}_max"] = float(change.max() * scale.newtons)
        found[f"{name}_rms"] = float(np.sqrt((change**2).mean()) * scale.newtons)
        if name == _COUNTED:
            reference = _changes(exact, points, along, way * scale.metre)
            flat = STEEP * way * scale.metre
            jumps, limit = (float((c > flat).mean()) for c in (change, reference))
            p999, highest = (float(np.percentile(c, 99.9)) for c in (change, reference))
    limit = MORE * limit + ALLOWED
    passed = jumps <= limit and p999 <= max(flat, MORE * highest)
    return found | {"jumps": jumps, "limit": limit, "passed": passed}


def _changes(answer, points, along, way):
    ends = np.concatenate([points, points + way * along])
    one, other = np.split(penalty_force(*answer(ends)), 2)
    return np.linalg.norm(other - one, axis=1)
