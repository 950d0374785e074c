"""The summary: one row per mesh and field."""

import csv
import io

from pandis.evaluation.errors import UNNORMALISED
from pandis.evaluation.front import pareto
from pandis.report.builds import build_seconds

COLUMNS = {
    "mesh": "Mesh",
    "field": "Field",
    "bytes": "Bytes",
    "build_s": "Built in (s)",
    "trajectory_mean": "Error on the trajectory, mean",
    "trajectory_percent": "% of the mean force",
    "trajectory_p99": "p99",
    "trajectory_max": "max",
    "shallow_mean": "Shallow probes, mean",
    "deep_mean": "Deep probes, mean",
    "trajectory_angle": "Angle (°)",
    "trajectory_millinewtons": "Error (mN)",
    "native_p50_us": "One query in C, p50 (µs)",
    "native_p999_us": "p99.9",
    "one_p50_us": "From Python, p50 (µs)",
    "one_p99_us": "p99",
    "one_p999_us": "p99.9",
    "libtorch_p50_us": "In LibTorch, p50 (µs)",
    "batch_us": "In a batch (µs)",
    "jump_max_newtons": "Largest jump per 0.1 mm (N)",
    "jump_rms_newtons": "RMS",
    "stress": "Stress: failed",
    "front": "Unbeaten",
    "hardware_p999_us": "At 1 kHz, p99.9 (µs)",
    "misses": "Misses",
    "verdict": "Verdict",
}


#: What a field that is unbeaten is compared by.
AXES = ("trajectory_mean", "native_p50_us", "bytes", "jump_rms_newtons")


def summarise(evaluations, timings, stresses, hardware):
    """Return the rows of all meshes.

    Parameters
    ----------
    evaluations, timings, stresses, hardware : list of pandis.artifact.Artifact
        One of each per mesh, in the same order. The folder is the mesh's name.
    """
    rows = []
    for found in zip(evaluations, timings, stresses, hardware, strict=True):
        (mesh,) = {artifact.path.parent.name for artifact in found}
        held = [artifact.attributes for artifact in found]
        rows += summary_rows(mesh, *held, build_seconds(mesh, held[0]["fields"]))
    return rows


def summary_rows(mesh, evaluation, timing, stress, hardware, builds):
    """Return the rows of one mesh.

    Parameters
    ----------
    mesh : str
    evaluation, timing, stress, hardware : dict
        The attributes of the four artifacts.
    builds : dict of str to float
        From `pandis.report.builds.build_seconds`.

    Returns
    -------
    list of dict
        Keys of COLUMNS; what a field does not have is empty.
    """
    rows = []
    measured, mean_force = (
        evaluation["errors"]["trajectory"],
        evaluation["mean_force"]["trajectory"],
    )
    names = [n for field in evaluation["fields"] for n in (field, field + UNNORMALISED)]
    for field in filter(measured.__contains__, names):
        errors = {n: table[field] for n, table in evaluation["errors"].items() if field in table}
        row = dict.fromkeys(COLUMNS, "")
        row |= {
            "mesh": mesh,
            "field": field,
            "bytes": evaluation["bytes"].get(field, ""),
            "build_s": builds.get(field, ""),
            "trajectory_mean": errors["trajectory"]["mean"],
            "trajectory_percent": 100 * errors["trajectory"]["mean"] / mean_force,
            "trajectory_p99": errors["trajectory"]["p99"],
            "trajectory_max": errors["trajectory"]["max"],
            "shallow_mean": errors["shallow"]["mean"] if "shallow" in errors else "",
            "deep_mean": errors["deep"]["mean"] if "deep" in errors else "",
            "trajectory_angle": errors["trajectory"]["angle"],
            "trajectory_millinewtons": 1e3 * errors["trajectory"]["mean"] * evaluation["newtons"],
        }
        if times := timing["fields"].get(field):
            keys = ("one_p50_us", "one_p99_us", "one_p999_us", "batch_us")
            row |= {key: times.get(key, "") for key in keys}
            extra = ("native_p50_us", "native_p999_us", "libtorch_p50_us")
            row |= {key: times.get(key, "") for key in extra}
        if found := stress["fields"].get(field):
            row["jump_max_newtons"] = found["jumps"]["mm01_max"]
            row["jump_rms_newtons"] = found["jumps"]["mm01_rms"]
            row["stress"] = len(stress["failed"][field])
        if verdict := hardware["fields"].get(field):
            row |= {
                "hardware_p999_us": verdict["compute_us"]["p99.9"],
                "misses": verdict["misses"],
                "verdict": verdict["verdict"],
            }
        rows.append(row)
    for row, unbeaten in zip(rows, pareto(rows, AXES), strict=True):
        row["front"] = "yes" if unbeaten else ""
    return rows


def to_csv(rows):
    """Return rows as the text of a CSV file."""
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(COLUMNS), lineterminator="\n")
    writer.writeheader()
    writer.writerows(
        {k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows
    )
    return stream.getvalue()
