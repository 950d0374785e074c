"""The summary: one row per mesh and field."""

import csv
import io

from pandis.pipeline.judge.controls import demand_failure
from pandis.pipeline.judge.errors.errors import UNNORMALISED
from pandis.pipeline.judge.errors.front import AXES, may_be_used, pareto
from pandis.pipeline.report.builds import build_seconds
from pandis.pipeline.run.records.evaluation import EvaluationRecord
from pandis.pipeline.run.records.hardware import HardwareRecord
from pandis.pipeline.run.records.stress import StressRecord
from pandis.pipeline.run.records.timing import TimingRecord

#: Contact sets: the one used for the headline errors, and the shallow one.
CONTACT, SHALLOW = "contact-deep", "contact-shallow"
COLUMNS = {
    "mesh": "Mesh",
    "field": "Field",
    "bytes": "Bytes",
    "build_s": "Build time (s)",
    "contact_millinewtons": "Contact error, mean (mN)",
    "contact_percent": "% of the mean force",
    "missing_percent": "Surface missing (%)",
    "strong_percent": "Surface with a strongly different force (%)",
    "left_out_percent": "Surface too thin to be judged (%)",
    "unjudged_percent": "Edges where the exact force is under 0.05 N (%)",
    "felt_percent": "Surface that feels different (%)",
    "contact_mean": "Contact error, mean (unit frame)",
    "contact_p99": "p99",
    "contact_shallow_mean": "Contact error, 0 to 0.01 deep",
    "trajectory_millinewtons": "Error on the trajectory (mN)",
    "trajectory_percent": "% of the mean force",
    "trajectory_missing_percent": "Force missing on the trajectory (%)",
    "trajectory_felt_percent": "Feels different on the trajectory (%)",
    "trajectory_mean": "Error on the trajectory, mean (unit frame)",
    "trajectory_p99": "p99",
    "trajectory_max": "max",
    "trajectory_angle": "Angle (°)",
    "shallow_mean": "Shallow probes, mean",
    "deep_mean": "Deep probes, mean",
    "native_p50_us": "One query in C, p50 (µs)",
    "native_p999_us": "p99.9",
    "anywhere_p50_us": "In C anywhere in the box, p50 (µs)",
    "anywhere_max_us": "worst place",
    "native_cold_p50_us": "In C with empty caches, p50 (µs)",
    "native_cold_max_us": "worst",
    "one_p50_us": "From Python, p50 (µs)",
    "one_p99_us": "p99",
    "one_p999_us": "p99.9",
    "libtorch_p50_us": "In LibTorch, p50 (µs)",
    "batch_us": "In a batch (µs)",
    "jump_max_newtons": "Largest jump per 0.1 mm (N)",
    "jump_rms_newtons": "RMS change of force per 0.1 mm (N)",
    "ghost_percent": "Free space near the surface with 0.05 N or more (%)",
    "ghost_newtons": "Largest force in free space (N)",
    "stress": "Failed stress questions",
    "front": "Unbeaten",
    "hardware_p999_us": "At 1 kHz, p99.9 (µs)",
    "misses": "Misses",
    "verdict": "Verdict",
}

#: Columns of the page's main table.
FEW = (
    "field", "bytes", "contact_millinewtons", "contact_percent", "missing_percent",
    "strong_percent", "left_out_percent", "unjudged_percent", "stress", "native_p50_us",
    "jump_rms_newtons", "front",
)  # fmt: skip

#: A mean error below this (unit frame) is due to rounding, and the field counts as exact.
ROUNDING = 1e-12
#: Time columns that are empty for some fields.
_IN_C = (
    "native_p50_us", "native_p999_us", "anywhere_p50_us", "anywhere_max_us",
    "native_cold_p50_us", "native_cold_max_us", "libtorch_p50_us",
)  # fmt: skip


_RECORDS = EvaluationRecord, TimingRecord, StressRecord, HardwareRecord


def summarise(columns):
    """Return the rows of all meshes.

    Parameters
    ----------
    columns : iterable of list of pandis.pipeline.run.job.artifact.Artifact
        Artifacts of evaluations, timings, stress and hardware: one of each per mesh, in the same
        order. An artifact's folder has the name of its mesh.
    """
    rows = []
    for artifacts in zip(*columns, strict=True):
        (mesh,) = {artifact.path.parent.name for artifact in artifacts}
        records = [kind.of(artifact) for kind, artifact in zip(_RECORDS, artifacts, strict=True)]
        times = artifacts[0].path.parent.parent / "benchmarks"
        rows += summary_rows(mesh, records, build_seconds(mesh, records[0].fields, times))
    return rows


def summary_rows(mesh, records, builds):
    """Return the summary's rows for one mesh, one row per field.

    Parameters
    ----------
    mesh : str
    records : sequence
        The mesh's records of evaluation, timing, stress and hardware, in this order
        (`pandis.pipeline.run.records`).
    builds : dict of str to float
        Build time of each field, s, from `pandis.pipeline.report.builds.build_seconds`.

    Returns
    -------
    list of dict
        Rows with the keys of COLUMNS. If a field lacks a value, the entry is an empty string.
    """
    evaluation, timing, stress, hardware = records
    measured = evaluation.errors["trajectory"]
    names = [n for field in evaluation.fields for n in (field, field + UNNORMALISED)]
    rows = []
    for field in filter(measured.__contains__, names):
        row = dict.fromkeys(COLUMNS, "")
        row |= {"mesh": mesh, "field": field, "bytes": evaluation.bytes.get(field, "")}
        row |= {"build_s": builds.get(field, "")} | _errors(evaluation, field)
        if times := timing.fields.get(field):
            keys = ("one_p50_us", "one_p99_us", "one_p999_us", "batch_us")
            row |= {key: times.get(key, "") for key in keys}
            row |= {key: times.get(key, "") for key in _IN_C}
        if answers := stress.fields.get(field):
            row["jump_max_newtons"] = answers["jumps"]["mm01_max"]
            row["jump_rms_newtons"] = answers["jumps"]["mm01_rms"]
            row["ghost_percent"] = 100 * answers["contacts"]["ghosts"]
            row["ghost_newtons"] = answers["contacts"]["largest_n"]
            row["stress"] = len(stress.failed[field])
        if verdict := hardware.fields.get(field):
            row |= {
                "hardware_p999_us": verdict.compute_us["p99.9"],
                "misses": verdict.misses,
                "verdict": verdict.verdict,
            }
        rows.append(row)
    tried = control_rows(mesh, evaluation, stress)
    demand_failure("the front of unbeaten fields", (r["field"] for r in tried if may_be_used(r)))
    for row, unbeaten in zip(rows, pareto(rows, AXES), strict=True):
        row["front"] = "yes" if unbeaten else ""
    return rows


def control_rows(mesh, evaluation, stress):
    """Return the rows of the controls, all with zero size, query time and force change."""
    rows = []
    for name, errors in evaluation.controls.items():
        row = dict.fromkeys(COLUMNS, "") | {"mesh": mesh, "field": name, "bytes": 0}
        row |= _contact(errors, evaluation) | {"stress": len(stress.controls[name])}
        rows.append(row | {"native_p50_us": 0.0, "jump_rms_newtons": 0.0})
    return rows


def _errors(evaluation, field):
    """Return the error columns of a field's row."""
    errors = {n: table[field] for n, table in evaluation.errors.items() if field in table}
    path, mean_force = errors["trajectory"], evaluation.mean_force["trajectory"]
    row = {
        "trajectory_millinewtons": 1e3 * path.mean * evaluation.newtons,
        "trajectory_percent": 100 * path.mean / mean_force,
        "trajectory_mean": path.mean,
        "trajectory_p99": path.p99,
        "trajectory_max": path.max,
        "trajectory_angle": path.angle,
        "shallow_mean": _mean_text(errors["shallow"].mean) if "shallow" in errors else "",
        "deep_mean": _mean_text(errors["deep"].mean) if "deep" in errors else "",
    }
    if path.mean < ROUNDING:
        row |= {key: 0.0 for key in row if key.startswith("trajectory")}
    if path.missing is not None:
        row["trajectory_missing_percent"] = 100 * path.missing
        row["trajectory_felt_percent"] = 100 * path.felt
    return row | (_contact(errors, evaluation) if CONTACT in errors else {})


def _contact(errors, evaluation):
    """Return the columns of the contact measure, from the figures of `contact_errors`."""
    figures = errors[CONTACT]
    row = {
        "contact_millinewtons": 1e3 * figures.newtons,
        "contact_percent": 100 * figures.relative,
        "missing_percent": 100 * figures.missing,
        "strong_percent": 100 * figures.strongly_felt,
        "left_out_percent": 100 * evaluation.contact["left_out"],
        "unjudged_percent": 100 * (1 - figures.judged),
        "felt_percent": 100 * figures.felt,
        "contact_mean": figures.mean,
        "contact_p99": figures.p99,
    }
    if figures.mean < ROUNDING:
        row |= {key: 0.0 for key in row if key.startswith("contact")}
    return row | {"contact_shallow_mean": _mean_text(errors[SHALLOW].mean)}


def _mean_text(mean):
    """Return a mean error as it is reported: 0 if it is below `ROUNDING`."""
    return 0.0 if mean < ROUNDING else mean


def to_csv(rows, refused=()):
    """Return rows as CSV text. A refused mesh has a row with only its name and the reason.

    Parameters
    ----------
    rows : list of dict
    refused : dict of str to str
        Meshes that could not be built, and why.
    """
    stream = io.StringIO()
    writer = csv.DictWriter(stream, [*COLUMNS, *(["refused"] if refused else [])],
                            lineterminator="\n")  # fmt: skip
    writer.writeheader()
    writer.writerows({"mesh": mesh, "refused": refused[mesh]} for mesh in refused)
    writer.writerows(
        {k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows
    )
    return stream.getvalue()
