"""What several tests use: running Snakemake, dry runs in this process, small meshes."""

import fcntl
import logging
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import yaml

from pandis.pipeline.geometry.strata import Strata
from pandis.pipeline.kinds.opening import open_field
from pandis.pipeline.run.ask.catalogue import KIND_OF
from pandis.pipeline.run.ask.kind import FieldSpec
from pandis.pipeline.run.job.artifact import Artifact

ROOT = Path(__file__).resolve().parents[2]
PARTS = ("workflow", "rules", "scripts", "config")


def copy_workflow(source, target):
    """Copy what a run needs, and nothing that a run made."""
    ignore = shutil.ignore_patterns("__pycache__", ".snakemake")
    for part in PARTS:
        shutil.copytree(source / part, target / part, ignore=ignore)
    return target


def once(tmp_path_factory, name, make):
    """Return a folder that ``make`` fills, given its path: once, while other workers wait."""
    root = tmp_path_factory.getbasetemp()
    root = (root.parent if "PYTEST_XDIST_WORKER" in os.environ else root) / name
    folder, whole = root / "run", root / "whole"
    root.mkdir(exist_ok=True)
    with (root / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not whole.exists():
            shutil.rmtree(folder, ignore_errors=True)
            make(folder)
            whole.touch()
    return folder


def environment(**extra):
    """The environment of a user's shell: the library is not on Python's path."""
    kept = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    return kept | extra


def snakemake_command(*arguments):
    return [sys.executable, "-m", "snakemake", *arguments]


def snakemake(folder, *arguments, **extra):
    """Run Snakemake to its end; stdout and stderr come together."""
    return subprocess.run(
        snakemake_command(*arguments),
        cwd=folder,
        env=environment(**extra),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )


class _Jobs(logging.Handler):
    """Collects the jobs that a dry run announces."""

    def __init__(self):
        super().__init__()
        self.jobs = set()

    def emit(self, record):
        from snakemake_interface_logger_plugins.common import LogEvent

        if getattr(record, "event", None) == LogEvent.JOB_INFO:
            wildcards = dict(record.wildcards or {})
            mesh = wildcards.pop("mesh", None)
            self.jobs.add((record.rule_name, mesh, *map(str, wildcards.values())))


def plan(folder, config="config/fast.yaml", targets=("all",), cores=2):
    """Return the jobs that ``snakemake -n`` would run: a set of (rule, mesh, other wildcards).

    Through Snakemake's API, in this process, with the settings of the default profile.
    """
    from snakemake.api import SnakemakeApi
    from snakemake.logging import logger
    from snakemake.settings import types as settings
    from snakemake.settings.enums import Quietness, RerunTrigger

    profile = yaml.safe_load((folder / "workflow/profiles/default/profile.yaml").read_text())
    triggers = frozenset(RerunTrigger.parse_choices_set(profile["rerun-triggers"]))
    here, jobs = os.getcwd(), _Jobs()
    os.chdir(folder)
    try:
        output = settings.OutputSettings(
            dryrun=True, quiet={Quietness.ALL}, enable_file_logging=False
        )
        with SnakemakeApi(output) as api:
            logger.addHandler(jobs)  # the API has cleared the handlers before
            workflow = api.workflow(
                resource_settings=settings.ResourceSettings(cores=cores),
                config_settings=settings.ConfigSettings(configfiles=[Path(config)]),
                snakefile=Path("workflow/Snakefile"),
            )
            dag = workflow.dag(
                settings.DAGSettings(
                    targets=set(targets),
                    rerun_triggers=triggers,
                    max_checksum_file_size=profile["max-checksum-file-size"],
                    force_incomplete=profile["rerun-incomplete"],
                )
            )
            dag.execute_workflow(executor="dryrun")
    finally:
        logger.removeHandler(jobs)
        os.chdir(here)
    return {job for job in jobs.jobs if job[0] != "all"}


def edit(path, old, new):
    """Replace a text that must be there."""
    text = Path(path).read_text(encoding="utf-8")
    assert old in text, f"{path} has no {old!r}"
    Path(path).write_text(text.replace(old, new), encoding="utf-8")


def results(folder):
    """Return path and bytes of every artifact and export but timing and hardware."""
    found = {}
    for path in sorted((folder / "results").rglob("*")):
        kept = path.name.endswith((".zarr.zip", ".onnx", ".pandis"))
        reproducible = kept and not path.name.startswith(("timing", "hardware"))
        if path.is_file() and reproducible:
            found[str(path.relative_to(folder))] = path.read_bytes()
    return found


def artifact(kind, arrays, attributes):
    """Return an artifact as a stage would read it, without a file."""
    return Artifact(kind, arrays, attributes, path=Path(f"{kind}.zarr.zip"))


# --- meshes -----------------------------------------------------------------------


def octahedron():
    vertices = np.array(
        [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float
    )
    faces = np.array(
        [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    )
    return vertices, faces


def box_mesh():
    from pandis.pipeline.geometry.shapes import Box

    return Box().tessellation(cuts=4)


def write_obj(path, vertices, faces):
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += ["f " + " ".join(str(i + 1) for i in face) for face in faces.tolist()]
    Path(path).write_text("\n".join(lines) + "\n")
    return Path(path)


def sample(body, options, seed, progress):
    """Return the arrays and attributes of a samples artifact."""
    strata = Strata(body, options, seed)
    return strata.arrays(progress), strata.attributes()


def open_as(form, artifact, name=None):
    """Open a field of a form from its artifact, whatever its size."""
    return open_field(FieldSpec(name or form, KIND_OF[form].name, form, ""), artifact)
