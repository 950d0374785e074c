"""Generate a conda environment per rule file, with only the packages that its stages import."""

import re
from pathlib import Path

from pandis.pipeline.run.ask.kinds import KINDS
from pandis.pipeline.run.job.provenance import DISTRIBUTIONS, CodeDigests, Needs

ROOT = Path(__file__).resolve().parents[2]
ENVS = ROOT / "workflow" / "envs"
#: Packages that every stage needs, for option models and for shapes in signatures.
_ALWAYS = {"pydantic", "jaxtyping"}
#: Stages that train networks, optionally on a GPU.
_TRAIN = {"train", "choose"}
#: Kinds that `train` builds; `bake` and `shard` build all others.
_TRAINED = ("network",)


def environments():
    """Return each environment's text by path: one for every rule file that runs scripts."""
    digests, pins, texts = CodeDigests(ROOT / "workflow"), _pins(), {}
    for rules in sorted((ROOT / "rules").glob("*.smk")):
        names = re.findall(r'"\.\./scripts/(\w+)\.py"', rules.read_text(encoding="utf-8"))
        keys = {key for name in names for key in digests.modules(name, _needs(name))}
        packages = {key.removeprefix("package ") for key in keys if key.startswith("package ")}
        packages |= _ALWAYS
        pinned = sorted(pins[_key(DISTRIBUTIONS.get(name, name))] for name in packages)
        if names:
            texts[ENVS / f"{rules.stem}.yaml"] = _text(rules.name, pinned)
    return texts


def _needs(stage):
    kinds = tuple(kind for kind in KINDS if kind not in _TRAINED)
    kinds = {"bake": kinds, "shard": kinds, "train": _TRAINED}.get(stage, tuple(KINDS))
    unused = () if stage in _TRAIN else KINDS["network"].unused({})
    return Needs(kinds, tuple(unused))


def _pins():
    """Return the pinning lines of constraints.txt by package name."""
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    return {_key(line.split("==")[0]): line for line in lines if "==" in line}


def _key(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def _text(rules, pins):
    lines = [
        f"# Packages that the stages of rules/{rules} import, pinned as in constraints.txt.",
        "# Made by `make docs`, for `snakemake --sdm conda` only: `make all` uses one .venv.",
        "channels:",
        "  - conda-forge",
        "dependencies:",
        "  - python=3.11",
        "  - pip",
        "  - pip:",
        *(f"      - {pin}" for pin in pins),
    ]
    return "\n".join(lines) + "\n"
