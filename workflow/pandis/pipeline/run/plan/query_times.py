"""How long a query takes, by kind and size: the table that `fields: auto` goes by."""

import csv

import numpy as np

from pandis.base.errors import PandisError

#: Layers of the networks in the table.
LAYERS = 4


class QueryTimes:
    """The table of query times: `config/query-times.csv`.

    Parameters
    ----------
    path : path-like
        CSV with the columns ``kind``, ``size``, ``microseconds``; lines with # are notes. Sizes
        are faces (exact, compact), nodes per axis (grids), bytes (spline), units per layer
        (network, of four layers).

    Raises
    ------
    PandisError
        It is no such table.
    """

    def __init__(self, path):
        self.path, self.table = path, {}
        try:
            with open(path, encoding="utf-8") as stream:
                for row in csv.DictReader(line for line in stream if not line.startswith("#")):
                    entry = float(row["size"]), float(row["microseconds"])
                    if not min(entry) > 0:
                        raise ValueError(f"{row['kind']}: {entry} are not both above zero")
                    self.table.setdefault(row["kind"], []).append(entry)
        except (OSError, UnicodeDecodeError, KeyError, TypeError, ValueError) as error:
            raise PandisError(
                f"{path}: not a table of query times ({error}); measure one with "
                "`snakemake -f calibrate`"
            ) from error

    def __contains__(self, kind):
        return kind in self.table

    def seconds(self, kind, size, layers=LAYERS):
        """Return the median time of one query.

        Between the sizes of the table by logarithm, and beyond them along its last step, but that
        nothing gets faster with size. A network's time follows its weights, whatever its depth,
        and beyond the table at least in proportion to them.

        Parameters
        ----------
        kind : str
        size : float
            As in the table.
        layers : int
            Of a network.

        Raises
        ------
        PandisError
            The table has no such kind.
        """
        if kind not in self.table:
            raise PandisError(
                f"{self.path}: no query times of '{kind}'; measure them with "
                "`snakemake -f calibrate`"
            )
        network = kind == "network"
        known = sorted(self.table[kind])
        if network:
            known, size = [(_weights(w, LAYERS), t) for w, t in known], _weights(size, layers)
        sizes, times = np.log(np.array(known)).T
        at = np.log(max(size, 1))
        time = np.interp(at, sizes, times)
        if at > sizes[-1]:
            slope = (times[-1] - times[-2]) / (sizes[-1] - sizes[-2]) if len(sizes) > 1 else 0.0
            time += max(slope, 1.0 if network else 0.0) * (at - sizes[-1])
        return float(np.exp(time) * 1e-6)


def _weights(width, layers):
    """Return about how many products a network makes: one per weight."""
    return (layers - 1) * width**2 + 4 * width
