"""Lists of networks to train: what `training.py` takes as @NAME, on a GPU or on a CPU.

`@full` trains both recipes to the end: the paper's 10,000 epochs are 10,000 × (vertices // 1,400)
steps of the meshes at hand. `@ablation` goes from the one recipe to the other, one change at a
time and added up, in a tenth of the steps. A name with `-cpu`, as in `@ablation-cpu`, has a tenth
of the steps of its list, on a CPU.
"""

#: The paper's epochs on the meshes at hand; ours for all of them.
STEPS = {"bunny": 240_000, "armadillo": 350_000, "dragon": 280_000}
EXACT_STEPS = 45_000
SEEDS = (1, 2, 3)

#: What turns `pandis` into `pandis-exact`, in the order in which the changes are added up.
CHANGES = {
    "labels": {"loss": "exact", "batch": 2800},
    "outputs": {"direction": "gradient"},
    "base": {"base": 16, "width": 248},
    "ω0": {"omega": 80},
    "optimiser": {"learning_rate": 2e-4, "matrix_rate": 0.05, "schedule": "cosine", "clip": None},
    "batch": {"batch": 4096},
}
#: The paper's recipe, with exact labels or without, until a change is made.
START = {
    "width": 256,
    "direction": "output",
    "base": None,
    "omega": 30,
    "learning_rate": 1e-4,
    "matrix_rate": None,
    "schedule": "constant",
    "clip": 1.0,
    "batch": 1400,
}


def ablation():
    """Yield the label, ``how`` it is reached, and the changed options of every variant."""
    yield "pandis", "", {}
    yield "weighting: batch", "alone", {"weighting": "batch"}
    yield "points: vertices", "alone", {"points": "vertices"}
    for name, change in CHANGES.items():
        # the paper's recipe counts the points on the surface, which are half of its batch
        yield name, "alone", change | ({"batch": 2048} if name == "batch" else {})
    yield "labels, at the paper's points", "alone", CHANGES["labels"] | {"law": "paper"}
    together = {}
    for name, change in CHANGES.items():
        together |= change
        if name != "labels":
            yield f"+ {name}", "added", dict(together)


def _run(mesh, recipe, **options):
    words = ("null" if v is None else v for v in options.values())
    return f"{mesh}:{recipe}:" + ",".join(
        f"{key}={word}" for key, word in zip(options, words, strict=True)
    )


def ablation_runs(steps, device):
    """Return the runs of the ablation, on the Bunny."""
    runs = []
    for seed in SEEDS:
        for _, _, change in ablation():
            options = START | change
            recipe = "ablation" if options.get("loss") == "exact" else "pandis"
            options = {"seed": seed, "steps": steps, "device": device} | options
            options.pop("loss", None)
            runs.append(_run("bunny", recipe, **options))
    return runs


def full_runs(share, device):
    """Return the runs of both recipes to the end, or a share of it; the longest ones first.

    Among them what is as near to the paper as can be told: vertices, and SIREN's weighting. Of
    SIREN's weighting three seeds are trained on the Bunny alone.
    """
    order = sorted(STEPS, key=STEPS.get, reverse=True)

    def each(recipe, steps=None, **options):
        for mesh in order:
            once = options.get("weighting") == "batch" and mesh != "bunny"
            for seed in SEEDS[:1] if once else SEEDS:
                own = {"seed": seed, "steps": int((steps or STEPS[mesh]) * share), "device": device}
                yield _run(mesh, recipe, **own, **options)

    return [
        *each("pandis", weighting="subset"),
        *each("pandis-exact", steps=EXACT_STEPS),
        *each("pandis", weighting="batch"),
        *each("pandis", points="vertices", weighting="batch"),
    ]


def expand(word):
    """Return the runs that a word of the command line stands for."""
    if not word.startswith("@"):
        return [word]
    name, _, cpu = word[1:].partition("-")
    share, device = (0.1, "cpu") if cpu else (1.0, "cuda")
    if name == "full":
        return full_runs(share, device)
    if name == "ablation":
        return ablation_runs(int(STEPS["bunny"] * 0.1 * share), device)
    raise SystemExit(f"{word}: known are @full and @ablation, and with -cpu")
