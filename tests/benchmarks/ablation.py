"""What each step from the paper's recipe to ours is worth; renew docs/figures/ablation.csv.

Usage: .venv/bin/python tests/benchmarks/training.py MESHES TABLE together=6 @ablation
       .venv/bin/python tests/benchmarks/ablation.py MESHES WEIGHTS.npz…

The variants are those of `runs.py`, the figures those of `full.py`. With `@ablation-cpu` they have
a tenth of the steps, on a CPU.
"""

import csv
import sys
from pathlib import Path

from common import ROOT
from full import FIGURES, Measure, by_mesh, network, renew
from matplotlib.figure import Figure
from runs import START, ablation
from training import log

KEYS = ("mesh", "what", "how", "steps", "seed")


def variant(options):
    """Return what was changed in options, and how: one change alone, or one more added up."""
    for what, how, change in ablation():
        wanted = {"loss": "paper", "weighting": "subset", "points": "area", "law": None}
        wanted |= START | change
        if wanted["loss"] == "exact":
            del wanted["weighting"], wanted["points"]
        if all(options.get(key) == value for key, value in wanted.items()):
            return what, how
    return None


def main(folder, *weights):
    """Measure, and write the table."""
    rows = []
    for mesh, paths in by_mesh(weights).items():
        measure = Measure(Path(folder) / f"{mesh}.npz")
        for path in paths:
            field, options = network(path)
            found = variant(options)
            if found is None:
                log(f"{path.name} is no variant of the ablation")
                continue
            row = dict(zip(KEYS, (mesh, *found, options["steps"], options["seed"]), strict=True))
            row |= measure.figures(field)
            rows.append(row)
            log(row)
    variants = [(what, how) for what, how, _ in ablation()]

    def order(row):
        return variants.index((row["what"], row["how"])), str(row["seed"])

    renew("ablation", (*KEYS, *FIGURES), KEYS, rows, order)
    draw()


def draw():
    """Draw docs/images/ablation.png: every seed a dot."""
    text = (ROOT / "docs/figures/ablation.csv").read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(line for line in text if not line.startswith("#")))
    lines = list(dict.fromkeys((row["what"], row["how"]) for row in rows))
    figure = Figure(figsize=(8, 0.3 * len(lines) + 0.9), layout="constrained")
    axes = figure.add_subplot()
    colours = {"": "#111111", "alone": "#2a9d5c", "added": "#d62828"}
    for how, colour in colours.items():
        own = [row for row in rows if row["how"] == how]
        across = [1e3 * float(row["contact"]) for row in own]
        down = [lines.index((row["what"], how)) for row in own]
        said = {"": "the paper's recipe", "alone": "one change", "added": "added to those above"}
        axes.plot(across, down, "o", color=colour, label=said[how], alpha=0.7)
    axes.set_yticks(range(len(lines)), [what for what, _ in lines])
    axes.set_xscale("log")
    axes.set_xticks([0.5, 1, 2, 5, 10], ["0.5", "1", "2", "5", "10"])
    axes.minorticks_off()
    axes.invert_yaxis()
    axes.grid(alpha=0.3)
    axes.set_xlabel("contact error, times 1e3 (unit frame, k = 1); every dot is a training")
    axes.legend(loc="lower right")
    figure.savefig(ROOT / "docs/images/ablation.png", dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main(*sys.argv[1:])
