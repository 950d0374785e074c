"""Query times by kind and size: the table that `fields: auto` uses."""

import csv

import numpy as np

from pandis.base.errors import PandisError
from pandis.pipeline.run.ask.catalogue import KIND_OF


class QueryTimes:
    """The table of query times: `config/query-times.csv`.

    Parameters
    ----------
    path : path-like
        CSV with the columns ``kind``, ``size``, ``microseconds``; lines that start with # are
        comments. A size is the number of faces (exact, compact), nodes per axis (grids), bytes
        (spline), or units per layer (networks of four layers).

    Raises
    ------
    PandisError
        The file is not a table of this form.
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
                "`snakemake -j1 -f calibrate`"
            ) from error

    def __contains__(self, form):
        return form in self.table

    def seconds(self, form, size, **shape):
        """Return the median time of one query.

        The logarithm of the time is interpolated linearly over the logarithm of the kind's `work`,
        between the sizes in the table. Beyond the largest size, the slope is that of the last
        interval, or the kind's `growth` if that is greater.

        Parameters
        ----------
        form : str
        size : float
            As in the table.
        **shape
            Further arguments of the kind's `work`.

        Raises
        ------
        PandisError
            The table has no such form.
        """
        if form not in self.table:
            raise PandisError(
                f"{self.path}: no query times of '{form}'; measure them with "
                "`snakemake -j1 -f calibrate`"
            )
        kind = KIND_OF[form]
        known = [(kind.work(s), time) for s, time in sorted(self.table[form])]
        sizes, times = np.log(np.array(known)).T
        at = np.log(max(kind.work(size, **shape), 1))
        time = np.interp(at, sizes, times)
        if at > sizes[-1]:
            slope = (times[-1] - times[-2]) / (sizes[-1] - sizes[-2]) if len(sizes) > 1 else 0.0
            time += max(slope, kind.growth) * (at - sizes[-1])
        return float(np.exp(time) * 1e-6)
