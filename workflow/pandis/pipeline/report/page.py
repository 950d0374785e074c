"""The report: one self-contained HTML file."""

from importlib import resources

import jinja2
import numpy as np
from markupsafe import Markup, escape

from pandis import __version__
from pandis.base.files import file_digest
from pandis.base.frame import Frame
from pandis.base.physical import Scale
from pandis.bridges.web import script
from pandis.pipeline.geometry.shares import MISSING_LIMIT
from pandis.pipeline.judge.errors.front import PRICES, may_be_used, recommend
from pandis.pipeline.judge.errors.paths import BASELINES, verdict
from pandis.pipeline.judge.stress.jumps import STEEP
from pandis.pipeline.judge.stress.suite import PROXY_QUESTIONS, QUESTIONS
from pandis.pipeline.kinds.network.record import ModelRecord
from pandis.pipeline.kinds.opening import open_field
from pandis.pipeline.mesh.diagnosis import THICKNESS_RAYS
from pandis.pipeline.report import figures, paper
from pandis.pipeline.report.builds import build_seconds
from pandis.pipeline.report.picks import picks, usable
from pandis.pipeline.report.section import Section
from pandis.pipeline.report.sections import sections
from pandis.pipeline.report.tables import COLUMNS, CONTACT, FEW, control_rows, summary_rows
from pandis.pipeline.report.touch import shared, touch, touchable
from pandis.pipeline.report.view import view
from pandis.pipeline.run.ask.budget import Limits, describe_figures, describe_force
from pandis.pipeline.run.ask.catalogue import parse_field
from pandis.pipeline.run.host.processes import each
from pandis.pipeline.run.job.artifact import read_artifact
from pandis.pipeline.run.records.choice import ChoiceRecord
from pandis.pipeline.run.records.evaluation import EvaluationRecord
from pandis.pipeline.run.records.hardware import HardwareRecord
from pandis.pipeline.run.records.mesh import MeshRecord
from pandis.pipeline.run.records.stress import StressRecord
from pandis.pipeline.run.records.timing import TimingRecord


def mesh_sections(meshes, threads, progress, *, note):
    """Prepare the sections of all meshes in separate processes, at most one per thread.

    Each process reads a mesh, draws it and frees it, so memory contains only the meshes that are
    being drawn.

    Parameters
    ----------
    meshes : dict of str to tuple
        The paths of a mesh's artifacts and of its files for ``pandis.h``, and the names of its
        fields.
    threads : int
    progress : pandis.base.progress.Progress
    note : callable
        Receives the path and the digest of every artifact that was read.

    Returns
    -------
    list of pandis.pipeline.report.section.Section
        In the order of ``meshes``.
    """
    report, sections = progress("pages", len(meshes), "meshes"), []
    work = [(name, *of) for name, of in meshes.items()]
    for section, digests in each(_read_and_draw, work, threads):
        for path, digest in digests.items():
            note(path, digest)
        sections.append(section)
        report.update(len(sections))
    return sections


def _read_and_draw(work):
    name, paths, field_names = work
    stored = [path for path in paths if str(path).endswith(".zarr.zip")]
    files = touchable(path for path in paths if path not in stored)
    artifacts = [read_artifact(path) for path in stored]
    digests = {str(artifact.path): artifact.digest for artifact in artifacts}
    digests |= {str(path): file_digest(path) for path in files}
    return mesh_section(name, artifacts, field_names, files=files), digests


def mesh_section(name, artifacts, field_names, *, files=()):
    """Prepare one mesh for the template.

    Parameters
    ----------
    name : str
    artifacts : list of pandis.pipeline.run.job.artifact.Artifact
        Mesh, trajectory, evaluation, stress, timing, hardware, the artifact of every field, and the
        samples if there are networks.
    field_names : list of str
    files : list of path-like
        Files for ``pandis.h`` that can be touched on the page.

    Returns
    -------
    pandis.pipeline.report.section.Section
    """
    artifacts = {artifact.path.name.removesuffix(".zarr.zip"): artifact for artifact in artifacts}
    mesh, evaluation = artifacts["mesh"], artifacts["evaluation"]
    recipes = [stem.removeprefix("model-") for stem in artifacts if stem.startswith("model-")]
    specs = [parse_field(field, recipes) for field in field_names]
    networks = [spec.name for spec in specs if spec.learned]
    frame, repaired = Frame.of(mesh), MeshRecord.of(mesh)
    trajectory = artifacts["trajectory"]
    home = mesh.path.parent
    builds = build_seconds(name, field_names, home.parent / "benchmarks")
    records = [
        EvaluationRecord.of(evaluation),
        TimingRecord.of(artifacts["timing"]),
        StressRecord.of(artifacts["stress"]),
        HardwareRecord.of(artifacts["hardware"]),
    ]
    evaluated, timed, stressed, validated = records
    rows = summary_rows(name, records, builds)
    known = [row for row in rows if row["bytes"] != ""]
    shown = [parse_field("exact", ()), *(s for s in specs if s.name in _best(specs, rows))]
    vertices, faces = frame.to_unit(mesh.arrays["vertices"]), mesh.arrays["faces"]
    forces = {s.name: evaluation.arrays[f"force_{s.name}"] for s in specs}
    ticks = artifacts["hardware"].arrays
    compute = {s.name: ticks[f"compute_{s.name}"] for s in specs if s.native}
    models = {n: ModelRecord.of(artifacts[f"model-{n}"]) for n in networks}
    curves = {n: artifacts[f"model-{n}"].arrays["curve"] for n in networks}
    return Section(
        name=name,
        mesh=repaired,
        evaluation=evaluated,
        stress=stressed,
        timing=timed,
        hardware=validated,
        models=models,
        frame=frame,
        rows=rows,
        controls=control_rows(name, evaluated, stressed),
        picks=picks(rows, validated, home),
        advice=recommend(known),
        columns={k: title for k, title in COLUMNS.items() if any(row[k] != "" for row in rows)},
        built=len(known),
        sound=len(usable(rows, validated)),
        per_unit=Scale.of(stressed).newtons * frame.scale,
        metres=frame.scale / Scale.of(stressed).metre,
        judged=evaluated.controls["control-zero"][CONTACT].judged,
        walls=max((v.walls.points for v in validated.fields.values()), default=0),
        builds=builds,
        versions=_versions(artifacts.values()),
        sentence=_sentence(rows, networks, bool(repaired.shape)),
        paths_said=verdict(evaluated.paths, models),
        repair=[rung.operation for rung in repaired.rungs if rung.kept],
        verdicts=_verdicts(QUESTIONS, stressed.fields, stressed.failed),
        proxy_verdicts=_verdicts(PROXY_QUESTIONS, stressed.proxies, stressed.proxies_failed),
        notes={n: _training(model) for n, model in models.items()},
        followed=trajectory.attributes["followed"],
        choice=_chosen(ChoiceRecord.of(artifacts["choice"])) if "choice" in artifacts else None,
        view=view(
            evaluation.arrays,
            evaluated.newtons,
            [s.name for s in specs],
            first=_first(rows, networks),
        ),
        touch=touch(files, stressed.size, stressed.stiffness, view=f"view:{name}"),
        picture=figures.picture(vertices, faces, trajectory.arrays["points"]),
        heat=_heat_map(mesh, vertices, repaired),
        sections=sections(vertices, faces, mesh.arrays["deviation"] > repaired.solid.cell)
        if repaired.solid
        else None,
        holding=figures.holding(vertices, faces, **artifacts["stress"].arrays),
        quiver=figures.quiver([open_field(s, artifacts[s.artifact]) for s in shown]),
        path=figures.force_along_path(
            forces, evaluation.arrays["exact_force"], specs, networks=networks
        ),
        front=figures.error_against_time(rows, specs, networks),
        samples=figures.samples(artifacts["samples"]) if "samples" in artifacts else None,
        curves=figures.training_curves(curves) if curves else None,
        histogram=figures.compute_histogram(compute, specs, networks, deadline=validated.deadline)
        if compute
        else None,
    )


def _versions(artifacts):
    """Return the versions recorded in artifacts, by package."""
    versions = {}
    for artifact in artifacts:
        versions |= artifact.provenance.get("versions", {})
    return dict(sorted(versions.items()))


def _chosen(record):
    """Return the choice as a dict, with measured errors and limits in words."""
    scale, limits = record.scale, Limits(**record.limits)
    mean = describe_force(limits.mean, scale.newtons, scale.mean_force)
    tail = describe_force(limits.tail, scale.newtons, scale.mean_force)
    return {
        "field": record.choice.field,
        "bytes": record.choice.bytes,
        "considered": record.considered,
        "says": describe_figures(record.choice.held_out, scale.newtons, scale.mean_force),
        "wanted": f"at most {mean} on average, {tail} at p99, and "
        f"{100 * limits.missed:.2g} % of the surface missing",
    }


def _verdicts(questions, answers, failures):
    """Return, by field, a text that states which questions it failed and by how much."""
    return {
        field: "; ".join(questions[question].says(answers[field][question]) for question in failed)
        for field, failed in failures.items()
    }


def _heat_map(mesh, vertices, record):
    """Return a picture of what the repair changed; None if it changed nothing."""
    if not mesh.arrays["origin"].any():
        return None
    moved = mesh.arrays["deviation"] / record.after["diagonal"]
    return figures.heat_map(vertices, mesh.arrays["faces"], mesh.arrays["origin"], moved=moved)


def _best(specs, rows):
    """Return the names of the best network and the best grid, for the quiver plot."""
    error = {row["field"]: row["trajectory_mean"] for row in rows}
    networks = [s.name for s in specs if s.learned]
    grids = [s.name for s in specs if "vti" in s.exports]
    return [min(group, key=error.get) for group in (grids, networks) if group]


def _training(model):
    error, size = model.held_out_error, model.direction_length
    symbol = "‖∇Φ‖" if model.architecture.outputs == 1 else "‖Ψ‖"
    return (
        f"{model.steps:,} steps on {model.device}; force error on the "
        "network's own held-out points (half of them at most 0.01 deep, so that this error differs "
        "from the contact error): "
        f"mean {error.mean:.2e}, p99 {error.p99:.2e}; "
        f"{symbol} {size.mean:.3f} ± {size.std:.3f}"
    )


def _first(rows, networks):
    """Return the field whose errors the view shows first: the best network, else the best field."""
    known = [r for r in rows if r["bytes"] != "" and r["trajectory_mean"] > 0]
    shown = [r for r in known if r["field"] in networks] or known
    return min(shown, key=lambda row: row["trajectory_mean"], default={"field": ""})["field"]


def _sentence(rows, networks, closed_form):
    """Return sentences on the best usable field, the networks' errors and the exact query time."""
    known = [row for row in rows if row["bytes"] != ""]
    approximate = [row for row in known if row["field"] != "exact" and row["trajectory_mean"] > 0]
    if not approximate:
        return "Only exact fields were built."
    able = [row for row in approximate if may_be_used(row)]
    if able:
        best = min(able, key=lambda row: row["contact_mean"])
        text = (
            "Of the approximate fields that fail no question of the stress suite and lack the "
            f"force on at most 0.5 % of the surface, {best['field']} has the lowest error where a "
            f"probe can press: {best['contact_millinewtons']:.3g} mN on average, "
            f"{best['contact_percent']:.2g} % of the mean force."
        )
    else:
        text = (
            "Every approximate field fails a stress question, lacks the force on too much surface, "
            "or could not be judged on enough of the surface."
        )
    error = {row["field"]: row["trajectory_mean"] for row in approximate}
    base = next((b for b in BASELINES if error.get(b)), None)
    box = "the mesh's own box, as in the paper" if base == BASELINES[0] else "the unit frame's cube"
    for name in networks:
        if base and name in error:
            text += (
                f" On the trajectory {name} has {error[name] / error[base]:.2f} times the error of "
                f"{base}, which covers {box}."
            )
    exact = next((r for r in rows if r["field"] == "exact" and r["native_p50_us"] != ""), None)
    if exact:
        text += f" The exact field answers one query in {exact['native_p50_us']:.2g} µs, " + (
            "in closed form."
            if closed_form
            else "with no error but with a force step at every edge of the mesh."
        )
    return text


def build(sections, refused=None):
    """Return the page as text.

    Parameters
    ----------
    sections : list of pandis.pipeline.report.section.Section
    refused : dict of str to str, optional
        Meshes that could not be built, and why.
    """
    environment = jinja2.Environment(
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        loader=jinja2.FunctionLoader(
            lambda name: (resources.files("pandis.pipeline.report") / name).read_text(
                encoding="utf-8"
            )
        ),
    )
    panels = [
        (resources.files("pandis.pipeline.report") / f"{name}.js").read_text(encoding="utf-8")
        for name in ("page", "view")
    ]
    touches, loop = shared(sections)
    scripts = [script("solid"), *panels, *([script("touch")] if touches else [])]
    environment.filters["number"] = _number
    environment.filters["percent"] = _percent
    environment.filters["path"] = _path
    return environment.get_template("page.html").render(
        sections=sections,
        refused=refused or {},
        version=__version__,
        rays=THICKNESS_RAYS,
        few=FEW,
        jump=STEEP,
        prices=PRICES,
        baselines=BASELINES,
        questions=QUESTIONS,
        proxy_questions=PROXY_QUESTIONS,
        touches=touches,
        touch_loop=loop,
        touch_style=(resources.files("pandis.bridges.web") / "style.css").read_text("utf-8"),
        scripts=scripts,
        tables=paper.tables(sections),
        missing_limit=MISSING_LIMIT,
        versions={k: v for section in sections for k, v in section.versions.items()},
    )


def _path(path):
    """Return a path as HTML that allows a line break after each folder."""
    return Markup("/<wbr>").join(map(escape, str(path).split("/")))


def _percent(share):
    """Format a share as a percentage; a share within rounding error is 0."""
    return _number(100 * share if abs(share) > 1e-12 else 0)


def _number(value):
    """Format a cell: three significant digits, and an exponent only for extreme values."""
    if isinstance(value, bool | str):
        return value
    if isinstance(value, int | np.integer):
        return f"{value:,}"
    if value == 0:
        return "0"
    if 100 <= abs(value) < 1e6:
        return f"{value:,.0f}"
    return f"{value:.3g}" if 1e-2 <= abs(value) < 100 else f"{value:.2e}"
