"""What the benchmarks share: repaired meshes in the unit frame, and files of measured figures."""

import csv
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "workflow"))

from pandis.base.frame import Frame  # noqa: E402
from pandis.pipeline.run.ask.tasks import MeshTask  # noqa: E402
from pandis.pipeline.run.job.machine import describe  # noqa: E402

#: The scans that the accuracy bars name.
SCANS = {
    "bunny": "stanford/bunny_35947v_69451f_binary.ply",
    "armadillo": "stanford/armadillo_49990v_99976f_ngp.obj",
    "dragon": "stanford/dragon_closed_39994v_79988f.obj",
}


def load(path):
    """Read, repair and scale a mesh of the collection that PANDIS_MESHES names."""
    from pandis.pipeline.mesh.build import build  # needs the mesh libraries, training does not

    path = Path(os.environ["PANDIS_MESHES"]) / path
    task = MeshTask(source=str(path), sha256=None, seed=0)
    arrays, _ = build(task, path, lambda text: None)
    vertices = arrays["vertices"]
    frame = Frame.of_bounds(vertices.min(0), vertices.max(0))
    return frame.to_unit(vertices), arrays["faces"]


def notes(command, gpu=None):
    """Return what stands above measured figures: the command, the machine and the commit."""
    git = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
    done = subprocess.run(git, capture_output=True, text=True, check=False)
    machine = describe()
    gpu = f"{gpu}, " if gpu else ""
    return (
        f"# command: .venv/bin/python tests/benchmarks/{command}\n"
        f"# machine: {gpu}{machine['processor']}, {machine['cores']} cores, shared\n"
        f"# commit: {done.stdout.strip() or 'unknown'}\n"
    )


def write(name, columns, rows, earlier=()):
    """Write docs/figures/{name}.csv with the command, the machine and the commit.

    ``earlier`` are lines on rows that were measured at another commit.
    """
    target = ROOT / "docs" / "figures" / f"{name}.csv"
    with target.open("w", encoding="utf-8", newline="") as stream:
        stream.write(notes(f"{name}.py"))
        stream.writelines(f"# {line}\n" for line in earlier)
        writer = csv.DictWriter(stream, columns, lineterminator="\n", restval="")
        writer.writeheader()
        for row in rows:
            writer.writerow({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()})
    print(f"wrote {target}", file=sys.stderr)
