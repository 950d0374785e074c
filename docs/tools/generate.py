"""Generates pandis.h, the schema, the environments, and the documentation's tables and API pages.

``make docs`` writes all of it. ``make figures`` first copies the figures of the
last default run from results/ to docs/figures (``make figures RUN=sphere``:
those of config/sphere.yaml). A test fails if a file differs from this module's
output.
"""

import json
import subprocess
import sys
from pathlib import Path

from pydantic import BaseModel

import api
import charts
import tables
from environments import environments
from pandis.pipeline.run.ask import config, contacts, datasets, options, recipes, targets
from pandis.pipeline.run.job.machine import describe

ROOT = Path(__file__).resolve().parents[2]
SCHEMA = ROOT / "workflow" / "schemas" / "config.schema.json"
OPTIONS = ROOT / "config" / "README.md"
README = ROOT / "README.md"
REPAIR = ROOT / "docs" / "repair.md"
SOLID = ROOT / "docs" / "solid.md"
SIGNS = ROOT / "docs" / "benchmarks" / "signs.md"
BENCHMARKS = ROOT / "docs" / "benchmarks"
SPHERE = ROOT / "docs" / "sphere.md"
TRAINING = ROOT / "docs" / "training.md"
CLUSTER = ROOT / "docs" / "cluster.md"
ENGINE = ROOT / "workflow" / "pandis" / "engine"
HEADER = ENGINE / "pandis.h"
#: Parts of pandis.h in `engine/parts`, in the order in which they are joined.
PARTS = (
    *(
        "opening",
        "types",
        "interface",
        "objects",
        "scenes",
        "basis",
        "states",
        "vectors",
        "sines",
        "bsplines",
        "triangles",
        "mesh",
        "nearest",
        "packed",
        "compact",
    ),
    *(
        "network",
        "grid",
        "spline",
        "shape",
        "query",
        "curvature",
        "refit",
        "handover",
        "scene",
        "poses",
        "textures",
        "planes",
        "proxy",
        "hops",
        "following",
        "walking",
        "contact",
        "touches",
        "sections",
        "trees",
        "file",
    ),
)
END = "<!-- end of generated -->"

_SECTIONS = {
    "device": targets.DeviceOptions,
    "mesh": options.MeshOptions,
    "samples": options.SampleOptions,
    "train.{recipe}, loss: exact": recipes.ExactRecipe,
    "train.{recipe}, loss: paper": recipes.PaperRecipe,
    "budget": targets.BudgetOptions,
    "bake": options.BakeOptions,
    "export": options.ExportOptions,
    "trajectory": options.TrajectoryOptions,
    "evaluation": options.EvaluationOptions,
    "stress": options.StressOptions,
    "timing": options.TimingOptions,
    "contact": contacts.ContactOptions,
    "contact.materials.{name}": contacts.MaterialOptions,
    "contact.texture": contacts.TextureOptions,
    "hardware": options.HardwareOptions,
    "hardware.attached": options.AttachedOptions,
    "scenes.{scene}": config.SceneOptions,
    "scenes.{scene}.objects.{object}": config.SceneObject,
    "datasets.{dataset}": datasets.DatasetOptions,
    "datasets.{dataset}.override.{mesh}": datasets.Override,
}


def schema_text():
    """Return the text of the JSON schema's file."""
    return json.dumps(config.json_schema(), indent=2, ensure_ascii=False) + "\n"


def header_text():
    """Return pandis.h, joined from its parts."""
    return "".join((ENGINE / "parts" / f"{part}.h").read_text("utf-8") for part in PARTS)


def option_tables():
    """Return one Markdown table per section of the configuration."""
    lines = []
    for name, model in _SECTIONS.items():
        summary = (model.__doc__ or "").strip().splitlines()[0]
        lines += [
            f"### `{name}`",
            "",
            summary,
            "",
            "| option | default | meaning |",
            "|---|---|---|",
        ]
        for key, field in model.model_fields.items():
            if key == "loss":
                continue
            lines.append(
                f"| `{key}` | {_default(model, key, field)} | {_cell(field.description)} |"
            )
        lines.append("")
    return "\n".join(lines).rstrip()


def _cell(text):
    """Escape the bars that would end a table cell."""
    return text.replace("|", "\\|")


def _default(model, key, field):
    if key == "steps":
        kind = "paper" if model is recipes.PaperRecipe else "exact"
        return f"`{recipes.DEFAULT_STEPS[kind]}` if neither budget is given"
    if field.is_required():
        return "must be given"
    default = field.get_default(call_default_factory=True)
    if isinstance(default, BaseModel):
        default = default.model_dump(exclude_defaults=True)
    return f"`{json.dumps(default)}`"


def with_generated(path, **parts):
    """Return a file's text with the parts between its markers replaced."""
    text = path.read_text(encoding="utf-8")
    for name, part in parts.items():
        begin = f"<!-- generated: {name} -->"
        head, rest = text.split(begin)
        _, tail = rest.split(END, 1)
        text = f"{head}{begin}\n\n{part}\n\n{END}{tail}"
    return text


def _benchmarks():
    """Return the pages of docs/benchmarks with their tables."""
    pages = {
        "accuracy": {
            "bunny": tables.bunny_table(),
            "fields": tables.field_table(),
            "compact": tables.compact_table(),
        },
        "size": {
            "small": tables.small_table(),
            "hashgrid": tables.hashgrid_table(),
            "front": tables.front_table(),
        },
        "query-time": {
            "native": tables.native_table(),
            "times": tables.time_table(),
            "peers": tables.peers_table(),
            "worst": tables.worst_table(),
            "scenes": tables.scene_table(),
            "servo": tables.servo_table(),
        },
        "building": {
            "distances": tables.distance_table(),
            "large": tables.large_table(),
            "refit": tables.refit_table(),
            "throughput": tables.throughput_table(),
            "labels": tables.labels_table(),
        },
        "contact": {
            "presses": tables.press_table(),
            "contact": tables.contact_table(),
            "touched": tables.touched_table(),
        },
        "simulators": {
            "simulator": tables.simulator_table(),
            "bridge": tables.bridge_table(),
            "kernels": tables.kernels_table(),
            "cooked": tables.cooked_table(),
        },
        "ablations": {
            "order": tables.order_table(),
            "full": tables.full_table(),
            "base": tables.base_table(),
        },
    }
    return {
        BENCHMARKS / f"{name}.md": with_generated(BENCHMARKS / f"{name}.md", **parts)
        for name, parts in pages.items()
    }


def generated():
    """Return every generated file's path and text."""
    return environments() | {
        SCHEMA: schema_text(),
        HEADER: header_text(),
        OPTIONS: with_generated(OPTIONS, options=option_tables()),
        README: with_generated(README, which=tables.which_table()),
        SPHERE: with_generated(SPHERE, sphere=tables.sphere_table()),
        REPAIR: with_generated(REPAIR, repair=tables.repair_table()),
        SOLID: with_generated(SOLID, solid=tables.solid_table()),
        SIGNS: with_generated(SIGNS, signs=tables.signs_table()),
        **_benchmarks(),
        **charts.charts(),
        api.PYTHON: api.python_page(),
        api.MESHES: api.meshes_page(),
        api.C: api.c_page(header_text()),
        CLUSTER: with_generated(CLUSTER, cluster=tables.cluster_table()),
        TRAINING: with_generated(
            TRAINING,
            training=tables.training_table(),
            ablation=tables.ablation_table(),
            untuned=tables.training_table("untuned"),
            budgets=tables.budget_table(),
            sweep=tables.sweep_table(),
        ),
    }


def take_figures(name):
    """Copy the last run's summary to docs/figures, headed by its command, machine and commit."""
    summary = (ROOT / "results" / "summary.csv").read_text(encoding="utf-8")
    git = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(git, capture_output=True, text=True, check=True).stdout.strip()
    machine = describe()
    command = (
        "make all" if name == "default" else f"snakemake -j2 all --configfile config/{name}.yaml"
    )
    notes = [
        f"command: {command}",
        f"machine: {machine['processor']}, {machine['cores']} cores, shared",
        f"commit: {commit}",
    ]
    text = "".join(f"# {note}\n" for note in notes) + summary
    (tables.FOLDER / f"{name}.csv").write_text(text, encoding="utf-8")


def main(arguments):
    """Write all generated files."""
    if arguments[:1] == ["figures"]:
        take_figures(*arguments[1:] or ["default"])
    for path, text in generated().items():
        path.write_text(text, encoding="utf-8")
        print(f"wrote {path.relative_to(ROOT)}", file=sys.stderr)


if __name__ == "__main__":
    main(sys.argv[1:])
