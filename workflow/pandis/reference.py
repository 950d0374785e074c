"""Generates what the documentation repeats: schema, option tables, measured figures.

``make docs`` writes all of it; ``make figures`` first takes the figures of the
last default run from results/ into docs/figures. A test fails when a file
differs from what this module would write.
"""

import csv
import json
import subprocess
import sys
from pathlib import Path

from pandis import config
from pandis.machine import describe

ROOT = Path(__file__).resolve().parents[2]
SCHEMA = ROOT / "workflow" / "schemas" / "config.schema.json"
OPTIONS = ROOT / "config" / "README.md"
README = ROOT / "README.md"
FIGURES = ROOT / "docs" / "figures" / "default.csv"
REPAIR = ROOT / "docs" / "repair.md"
REPAIR_FIGURES = ROOT / "docs" / "figures" / "repair.csv"
BENCHMARKS = ROOT / "docs" / "benchmarks.md"
DISTANCE_FIGURES = ROOT / "docs" / "figures" / "distances.csv"
FIELD_FIGURES = ROOT / "docs" / "figures" / "fields.csv"
TRAINING = ROOT / "docs" / "training.md"
TRAINING_FIGURES = ROOT / "docs" / "figures" / "training.csv"
END = "<!-- end of generated -->"

_SECTIONS = {
    "device": config.DeviceOptions,
    "mesh": config.MeshOptions,
    "samples": config.SampleOptions,
    "train.{recipe}, loss: exact": config.ExactRecipe,
    "train.{recipe}, loss: paper": config.PaperRecipe,
    "bake": config.BakeOptions,
    "trajectory": config.TrajectoryOptions,
    "evaluation": config.EvaluationOptions,
    "timing": config.TimingOptions,
    "hardware": config.HardwareOptions,
}


def schema_text():
    """Return the JSON schema as the text of its file."""
    return json.dumps(config.json_schema(), indent=2, ensure_ascii=False) + "\n"


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
        kind = "paper" if model is config.PaperRecipe else "exact"
        return f"`{config.DEFAULT_STEPS[kind]}` if neither budget is given"
    default = field.get_default(call_default_factory=True)
    return f"`{json.dumps(default)}`"


def bunny_table():
    """Return the README's table: the default run's figures for ``bunny``."""
    notes, rows = _figures(FIGURES)
    table = [
        "| field | bytes | on the path | shallow | deep | one query, median |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        if row["mesh"] == "bunny" and row["bytes"]:
            errors = (row[f"{name}_mean"] for name in ("trajectory", "shallow", "deep"))
            cells = " | ".join(f"{1e3 * float(error):.2f}e-3" for error in errors)
            time = f"{float(row['one_p50_us']):.0f} µs"
            table.append(f"| `{row['field']}` | {int(row['bytes']):,} | {cells} | {time} |")
    return "\n".join([*table, "", f"({'; '.join(notes)}.)"])


def _figures(path):
    """Return the notes and the rows of a file of measured figures."""
    lines = path.read_text(encoding="utf-8").splitlines()
    notes = [line.removeprefix("# ") for line in lines if line.startswith("#")]
    return notes, list(csv.DictReader(line for line in lines if not line.startswith("#")))


def repair_table():
    """Return the table of docs/repair.md: what became of every mesh of a collection."""
    notes, rows = _figures(REPAIR_FIGURES)
    table = [
        "| file | outcome | rungs kept | source to result, p99 / max (%) | result to source (%) "
        "| caps, hidden (% of area) | untouched (%) | s | MB |",
        "|---|---|---|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        outcome = row["outcome"] + (f": `{row['option']}`" if row["option"] else "")
        figures = [
            f"{_short(row['to_result_p99_percent'])} / {_short(row['to_result_max_percent'])}",
            f"{_short(row['to_source_p99_percent'])} / {_short(row['to_source_max_percent'])}",
            f"{_short(row['caps_percent'])}, {_short(row['hidden_percent'])}",
            _short(row["untouched_percent"]),
        ]
        if row["outcome"].startswith("refused"):
            figures = ["–"] * 4
        cells = [f"{row['folder']}/{row['file']}", outcome, row["rungs"] or "–", *figures]
        cells += [f"{float(row['seconds']):.0f}", f"{float(row['memory_mb']):.0f}"]
        table.append("| " + " | ".join(cells) + " |")
    valid = sum(row["outcome"] == "valid" for row in rows)
    asked = sum(row["outcome"] == "valid with option" for row in rows)
    summary = (
        f"Of {len(rows)} files {valid} end valid with the default options, {asked} more with the "
        f"option that the refusal names, {len(rows) - valid - asked} are refused."
    )
    return "\n".join([summary, "", *table, "", f"({'; '.join(notes)}.)"])


def field_table():
    """Return the table of bytes against error: our grids, and the peers' figures beside them."""
    notes, rows = _figures(FIELD_FIGURES)
    meshes = list(dict.fromkeys(row["mesh"] for row in rows))
    cells = {(row["mesh"], row["field"]): row for row in rows}
    table = [
        "| field | in memory (KB) | " + " | ".join(f"{mesh}, on disk (KB)" for mesh in meshes)
        + " | " + " | ".join(f"{mesh}, shallow / deep" for mesh in meshes) + " | built in (s) |",
        "|---" + "|--:" * (2 + 2 * len(meshes)) + "|",
    ]  # fmt: skip
    for field in dict.fromkeys(row["field"] for row in rows):
        found = [cells[mesh, field] for mesh in meshes]
        row = [field, f"{int(found[0]['bytes']) / 1e3:,.0f}"]
        row += [f"{int(f['disk_bytes']) / 1e3:,.0f}" for f in found]
        row += [f"{1e3 * float(f['shallow']):.2f} / {1e3 * float(f['deep']):.2f}" for f in found]
        row.append(f"{min(float(f['build_s']) for f in found):.1f}"
                   f"–{max(float(f['build_s']) for f in found):.1f}")  # fmt: skip
        table.append("| " + " | ".join(row) + " |")
    return "\n".join([*table, "", f"({'; '.join(notes)}.)"])


def distance_table():
    """Return the table of speed and memory."""
    notes, rows = _figures(DISTANCE_FIGURES)
    table = ["| what | case | measured | ratio or exponent |", "|---|---|--:|--:|"]
    for row in rows:
        value = float(row["value"])
        text = f"{value:,.0f}" if value >= 100 else f"{value:.3g}"
        ratio = f"{float(row['ratio']):.2f}" if row["ratio"] else ""
        table.append(f"| {row['what']} | {row['case']} | {text} {row['unit']} | {ratio} |")
    return "\n".join([*table, "", f"({'; '.join(notes)}.)"])


def training_table():
    """Return the table of docs/training.md: one row per trained network."""
    notes, rows = _figures(TRAINING_FIGURES)
    table = [
        "| mesh | recipe | options | steps | s | points/s | KB | shallow | deep | on the path |",
        "|---|---|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        options = [o for o in row["options"].split() if not o.startswith(("steps=", "device="))]
        cells = [row["mesh"], f"`{row['recipe']}`", f"`{' '.join(options)}`" if options else ""]
        cells += [f"{int(row['steps']):,}", f"{float(row['seconds']):.0f}"]
        cells += [f"{float(row['points_per_s']):,.0f}", f"{int(row['bytes']) / 1e3:,.0f}"]
        cells += [f"{1e3 * float(row[k]):.3g}" for k in ("shallow", "deep", "trajectory")]
        table.append("| " + " | ".join(cells) + " |")
    return "\n".join([*table, "", f"({'; '.join(notes)}.)"])


def _short(text):
    """Format a percentage: what is below a billionth is rounding."""
    value = float(text or 0)
    return "0" if value < 1e-9 else f"{value:.2g}" if value < 99.5 else f"{value:.4g}"


def with_generated(path, **parts):
    """Return a file's text with the parts between its markers made anew."""
    text = path.read_text(encoding="utf-8")
    for name, part in parts.items():
        begin = f"<!-- generated: {name} -->"
        head, rest = text.split(begin)
        _, tail = rest.split(END, 1)
        text = f"{head}{begin}\n\n{part}\n\n{END}{tail}"
    return text


def generated():
    """Return every generated file and what it should hold."""
    return {
        SCHEMA: schema_text(),
        OPTIONS: with_generated(OPTIONS, options=option_tables()),
        README: with_generated(README, bunny=bunny_table()),
        REPAIR: with_generated(REPAIR, repair=repair_table()),
        BENCHMARKS: with_generated(BENCHMARKS, distances=distance_table(), fields=field_table()),
        TRAINING: with_generated(TRAINING, training=training_table()),
    }


def take_figures():
    """Copy the summary of the last default run, with command, machine and commit."""
    summary = (ROOT / "results" / "summary.csv").read_text(encoding="utf-8")
    git = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(git, capture_output=True, text=True, check=True).stdout.strip()
    machine = describe()
    notes = [
        "command: make all",
        f"machine: {machine['processor']}, {machine['cores']} cores, shared",
        f"commit: {commit}",
    ]
    FIGURES.parent.mkdir(parents=True, exist_ok=True)
    FIGURES.write_text("".join(f"# {note}\n" for note in notes) + summary, encoding="utf-8")


def main(arguments):
    """Write all generated files."""
    if "figures" in arguments:
        take_figures()
    for path, text in generated().items():
        path.write_text(text, encoding="utf-8")
        print(f"wrote {path.relative_to(ROOT)}", file=sys.stderr)


if __name__ == "__main__":
    main(sys.argv[1:])
