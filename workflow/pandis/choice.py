"""`fields: auto`: the field that meets a budget and is the cheapest to build.

The exact mesh needs no building, a grid a second, a spline a quarter of a minute, a network
minutes: they are tried in this order, and what comes after the first that will do is skipped.
"""

import csv

import numpy as np

from pandis.artifact import Artifact
from pandis.catalogue import GRID_FIELDS
from pandis.errors import PandisError
from pandis.fields.sizing import SPLINE_BYTES, Sizing
from pandis.grids.dense import CHANNELS
from pandis.grids.search import SIZES, coarsest
from pandis.strata import Strata
from pandis.training.sizing import WIDTHS, train

#: Dense grids that are tried.
KINDS = ("nearest", "trilinear", "trilinear-normal", "trilinear-gradient", "tricubic")


class QueryTimes:
    """The table of query times: `config/query-times.csv`.

    Parameters
    ----------
    path : path-like
        CSV with the columns ``kind``, ``size``, ``microseconds``; lines with # are notes. Sizes
        are faces (exact), nodes per axis (grids), bytes (spline), units per layer (network).

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

    def seconds(self, kind, size):
        """Return the median time of one query, between the sizes of the table by logarithm.

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
        sizes, times = np.log(np.array(sorted(self.table[kind]))).T
        return float(np.exp(np.interp(np.log(max(size, 1)), sizes, times)) * 1e-6)


class Chooser:
    """Looks for the cheapest field that meets a budget.

    Parameters
    ----------
    mesh : pandis.artifact.Artifact
        Of kind ``mesh``.
    engine : object
        From `pandis.distance.open_distance`.
    surface : pandis.sampling.Surface
    options : dict
        ``budget`` (`pandis.config.BudgetOptions`), ``band``, ``seed``, ``samples``
        (`pandis.config.SampleOptions`), ``recipe`` (`pandis.config.ExactRecipe`).
    times : QueryTimes
    checkpoint : path-like
        Where training keeps its state.
    progress : callable
        Makes a `pandis.stage.Progress`.
    log : callable
    """

    def __init__(self, mesh, engine, surface, options, times, checkpoint, progress, log):
        self.mesh, self.engine, self.surface = mesh, engine, surface
        self.options, self.times, self.checkpoint = options, times, checkpoint
        self.progress, self.log = progress, log
        self.budget = options["budget"]
        self.considered = []

    def choose(self):
        """Return what is stored in ``choice.zarr.zip``.

        Returns
        -------
        arrays, attributes : dict
            Those of the field that was chosen; ``choice`` names it, with its error, bytes and
            query time, and ``considered`` tells the same of what was not taken, and why.
        finish : callable
            To be called once the artifact is written.

        Raises
        ------
        PandisError
            Nothing meets the budget.
        """
        for attempt in (self._exact, self._dense, self._spline, self._network):
            found = attempt()
            if found:
                arrays, attributes, choice, finish = found
                self.log(f"chosen: {choice['field']}, {choice['bytes']:,} bytes")
                extra = {"choice": choice, "asked": self.budget, "considered": self.considered}
                return arrays, attributes | extra, finish
        reasons = "; ".join(f"{c['field']}: {c['why']}" for c in self.considered)
        raise PandisError(f"no field meets the budget ({reasons}): ask for less")

    # --- the kinds ------------------------------------------------------------------------

    def _exact(self):
        mesh, closed_form = self.mesh.arrays, bool(self.mesh.attributes.get("shape"))
        faces = len(mesh["faces"])
        size = 0 if closed_form else self.engine.tree_bytes
        count = 1 if closed_form else faces
        if not self._fitting("exact", {count: size}):
            return None
        choice = {"field": "exact", "held_out_error": 0.0, "bytes": size}
        arrays = {key: mesh[key] for key in ("vertices", "faces")}
        attributes = {"shape": self.mesh.attributes.get("shape")}
        return arrays, attributes, choice | self._time("exact", count), _nothing

    def _dense(self):
        passed = []
        for kind in KINDS:
            each = 4 * CHANNELS[GRID_FIELDS[kind]]
            sizes = self._fitting(kind, {n: each * n**3 for n in SIZES})
            sizing = self._sizing(kind, force_error=self.budget["force_error"])
            found = self._coarsest(kind, sizes, sizing.measure) if sizes else None
            if found is None:
                continue
            size, error = found
            choice = {"field": f"{kind}-{size}", "held_out_error": error, "bytes": each * size**3}
            passed.append((sizing.made[size], choice | self._time(kind, size)))
        if not passed:
            return None
        passed.sort(key=lambda one: one[1]["bytes"])
        for _, choice in passed[1:]:
            self._skip(choice["field"], f"larger: {choice['bytes']:,} bytes")
        (arrays, attributes), choice = passed[0]
        return arrays, attributes, choice, _nothing

    def _spline(self):
        sizes = self._fitting("spline", {n: n for n in SPLINE_BYTES})
        if not sizes:
            return None
        sizing = self._sizing("spline", force_error=None, bytes=sizes[-1])
        found = self._coarsest("spline", sizes, sizing.measure)
        if found is None:
            return None
        size, error = found
        choice = {"field": "spline-auto", "held_out_error": error, "bytes": size}
        return *sizing.made[size], choice | self._time("spline", size), _nothing

    def _network(self):
        recipe = self.options["recipe"]
        widths = [w for w in WIDTHS if w < recipe["width"]] + [recipe["width"]]
        fit = self._fitting("network", {w: self._weights(w) for w in widths})
        if not fit:
            return None
        law = self.options["samples"] | {"seed": self.options["seed"]}
        strata = Strata(self.surface, self.engine, law)
        drawn = strata.arrays(self.progress)
        samples = Artifact(None, "samples", drawn, strata.attributes(), {}, "")
        wanted = {"force_error": self.budget["force_error"], "width": fit[-1]}
        own = recipe | wanted | {"seed": self.options["seed"]}
        try:
            arrays, attributes, finish = train(
                own, samples, strata, self.checkpoint, self.progress, self.log
            )
        except PandisError as error:
            self._skip(recipe["recipe"], str(error))
            return None
        width = attributes["architecture"]["width"]
        choice = {
            "field": recipe["recipe"],
            "held_out_error": attributes["sizing"]["held_out_error"],
            "bytes": self._weights(width),
        }
        return arrays, attributes, choice | self._time("network", width), finish

    # --- what they share ---------------------------------------------------------------------

    def _sizing(self, kind, **wanted):
        own = {"bytes": None, "band": self.options["band"], "seed": self.options["seed"]} | wanted
        frame = self.mesh.attributes["frame"]
        return Sizing(kind, self.engine, self.surface, frame, own, self.progress, self.log)

    def _coarsest(self, kind, sizes, measure):
        """Return the first size that meets the error, and its error; None if none does."""
        errors = {}

        def measured(size):
            errors[size] = measure(size)
            return errors[size]

        try:
            size, _ = coarsest(sizes, measured, self.budget["force_error"], kind)
        except PandisError:
            best = min(errors, key=errors.get)
            self._skip(kind, f"errs by {errors[best]:.3g} at best, at size {best:,}")
            return None
        return size, errors[size]

    def _weights(self, width):
        """Return the bytes of a network and its base."""
        recipe = self.options["recipe"]
        depth, outputs = recipe["depth"], 1 if recipe["direction"] == "gradient" else 4
        count = 3 * width + (depth - 1) * width**2 + outputs * width + depth * width + outputs
        return 4 * (count + ((recipe["base"] + 3) ** 3 if recipe["base"] else 0))

    def _time(self, kind, size):
        if self.budget["query_time"] is None:
            return {}
        return {"query_time": self.times.seconds(kind, size)}

    def _too_dear(self, kind, size, bytes_):
        """Say by what a field is beyond the budget; an empty text if it is not."""
        limits = []
        if self.budget["bytes"] is not None and bytes_ > self.budget["bytes"]:
            limits.append(f"{bytes_:,} bytes")
        slow = self._time(kind, size).get("query_time", 0.0)
        if slow > (self.budget["query_time"] or np.inf):
            limits.append(f"{slow * 1e6:.0f} µs a query")
        return " and ".join(limits)

    def _fitting(self, kind, sizes):
        """Return those of the sizes, with their bytes, that keep to the budget; note if none."""
        dear = {size: self._too_dear(kind, size, bytes_) for size, bytes_ in sizes.items()}
        if all(dear.values()):
            name = self.options["recipe"]["recipe"] if kind == "network" else kind
            self._skip(name, f"{next(iter(dear.values()))} at the least")
        return [size for size, why in dear.items() if not why]

    def _skip(self, name, why):
        self.log(f"{name}: {why}")
        self.considered.append({"field": name, "why": why})


def _nothing():
    """Finish what has left nothing behind."""
