"""Which jobs run after which change: the exact sets, through Snakemake's own dry run."""

import os
import re
import shutil
from pathlib import Path

import pytest
import yaml

from pandis.base.errors import ConfigError, PandisError
from pandis.base.files import file_digest
from pandis.pipeline.run.plan.plan import Plan
from support import ROOT, edit, plan, snakemake

FAST = "config/fast.yaml"
DOWNSTREAM = {"evaluate", "timing", "validate"}
#: What a change of a field reaches; the stress suite needs no path.
DEPENDENT = DOWNSTREAM | {"stress"}
LAST = {("summary", None), ("report", None)}
BOTH = ("sphere", "torus")


def native(*names, meshes=BOTH):
    """The jobs that write files for pandis.h."""
    return {("export_native", mesh, name) for mesh in meshes for name in names}


def graphs(*names, meshes=BOTH):
    """The jobs that write graphs, and of networks programs, too."""
    return {
        ("export_graph", mesh, name, ending)
        for mesh in meshes
        for name in names
        for ending in ("onnx", "pt2")
        if ending == "onnx" or name.startswith("pandis")
    }


FIELDS = ("exact", "trilinear-24", "pandis-exact")
EVERYTHING = (
    {(stage, mesh) for stage in ("mesh", "sample", "trajectory", *DEPENDENT) for mesh in BOTH}
    | {("train", mesh, "pandis-exact") for mesh in BOTH}
    | {("bake", mesh, "grid-force-24") for mesh in BOTH}
    | graphs("trilinear-24", "pandis-exact")
    | native(*FIELDS)
    | LAST
)


def change(folder, **sections):
    """Merge sections into the configuration file."""
    path = folder / FAST
    config = yaml.safe_load(path.read_text())
    for key, value in sections.items():
        if isinstance(value, dict):
            config[key] = config.get(key, {}) | value
        else:
            config[key] = value
    path.write_text(yaml.safe_dump(config))


def all_of(*stages, meshes=("sphere", "torus")):
    return {(stage, mesh) for stage in stages for mesh in meshes}


def test_fresh_plan_has_every_job_once(workspace):
    assert plan(workspace) == EVERYTHING
    assert len(EVERYTHING) + 1 <= 34  # with `all`


def test_finished_run_has_nothing_to_do(rerun):
    assert plan(rerun) == set()


def test_training_option_of_one_mesh(rerun):
    change(
        rerun,
        meshes={"torus": {"source": "analytic:torus", "train": {"pandis-exact": {"steps": 301}}}},
    )
    network = {("train", "torus", "pandis-exact")} | graphs("pandis-exact", meshes=["torus"])
    network |= native("pandis-exact", meshes=["torus"])
    assert plan(rerun) == network | all_of(*DEPENDENT, meshes=["torus"]) | LAST


def test_new_mesh(rerun):
    change(rerun, meshes={"box": {"source": "analytic:box"}})
    own = all_of("mesh", "sample", "trajectory", *DEPENDENT, meshes=["box"])
    own |= {("train", "box", "pandis-exact"), ("bake", "box", "grid-force-24")}
    own |= graphs("trilinear-24", "pandis-exact", meshes=["box"])
    own |= native(*FIELDS, meshes=["box"])
    assert plan(rerun) == own | LAST


def test_auto_builds_one_field_and_trains_nothing_beside_it(rerun):
    change(rerun, fields="auto", budget={"force_error": 1e-3})
    assert plan(rerun) == all_of("choose", *DEPENDENT) | native("auto") | LAST


@pytest.mark.full
def test_query_times_are_an_input_of_the_choice(rerun):
    change(rerun, fields="auto", budget={"force_error": 1e-3})
    snakemake(rerun, "-j2", "all", "--configfile", FAST)
    assert plan(rerun) == set()
    table = rerun / "config/query-times.csv"
    table.write_text(table.read_text().replace("network,512,", "network,512,1"))
    assert plan(rerun) == all_of("choose", *DEPENDENT) | native("auto") | LAST


def test_another_folder_has_its_own_results(rerun):
    change(rerun, results="results/other")
    assert plan(rerun) == EVERYTHING
    meshes = {"meshes": {"x": {"source": "analytic:box"}}}
    files = Plan({"results": "a/b"} | meshes, ROOT / "workflow")
    assert all(path.startswith("a/b/") for path in files.target("all"))
    files = Plan({"results": "/scratch/b"} | meshes, ROOT / "workflow")
    assert all(path.startswith("/scratch/b/") for path in files.target("all"))
    for folder in ("../up", "/", "a b", "", 3, "a/../b"):
        with pytest.raises(PandisError, match="results: a folder, such as"):
            Plan({"results": folder} | meshes, ROOT / "workflow")


def test_another_repository_goes_by_the_query_times_that_come_along(tmp_path, monkeypatch):
    """As a module: until the working directory has a table of its own, which calibrate makes."""
    monkeypatch.chdir(tmp_path)
    budget = {"force_error": 1e-3}
    meshes = {"x": {"source": "analytic:box", "fields": "auto", "budget": budget}}
    made = Plan({"meshes": meshes}, ROOT / "workflow")
    assert Path(made.query_times).samefile(ROOT / "config/query-times.csv")
    assert made.stage_options("calibrate").table == "config/query-times.csv"
    (tmp_path / "config").mkdir()
    (tmp_path / "config/query-times.csv").touch()
    assert made.query_times == "config/query-times.csv"


def test_a_mesh_with_a_fault_of_its_own_keeps_no_other_from_running(rerun):
    bad = {"source": "analytic:box", "x": 1}
    change(rerun, meshes={"torus": {"source": "torus.obj"}, "bad": bad})
    jobs = plan(rerun)
    assert jobs - LAST == {("refuse", "torus"), ("refuse", "bad")}
    with pytest.raises(PandisError, match=r"no mesh can be built:\n  meshes.x.source: .*part.step"):
        Plan({"meshes": {"x": {"source": "part.step"}}}, ROOT / "workflow")


def test_a_mesh_that_may_not_be_read_keeps_no_other_from_running(tmp_path, monkeypatch):
    secret = tmp_path / "secret.stl"
    secret.write_bytes(b"solid")
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != secret)
    meshes = {"secret": {"source": str(secret)}, "torus": {"source": "analytic:torus"}}
    made = Plan({"meshes": meshes}, ROOT / "workflow")
    assert list(made.entries) == ["torus"]
    assert "secret.stl: the file cannot be read" in made.refused["secret"]
    with pytest.raises(PandisError, match="cannot be read: Is a directory"):
        file_digest(tmp_path)


def test_evaluation_option_trains_nothing(rerun):
    change(rerun, evaluation={"probes": 4000})
    assert plan(rerun) == all_of("evaluate", "validate") | LAST


def test_library_module_restales_its_importers_only(rerun):
    edit(rerun / "workflow/pandis/pipeline/geometry/trajectories.py", "_TRIES = 24", "_TRIES = 25")
    assert plan(rerun) == all_of("trajectory", *DOWNSTREAM) | LAST


def test_module_imported_through_another_counts(rerun):
    edit(rerun / "workflow/pandis/pipeline/mesh/tools.py", "OMP_NUM_THREADS", "OMP_THREAD_LIMIT")
    assert plan(rerun) == EVERYTHING


def test_template_counts(rerun):
    edit(
        rerun / "workflow/pandis/pipeline/report/page.html",
        "<h1>pandis report</h1>",
        "<h1>pandis</h1>",
    )
    assert plan(rerun) == LAST


def test_script_edited(rerun):
    edit(rerun / "scripts/timing.py", "for path in", "for path in list() or")
    assert plan(rerun) == all_of("timing") | LAST


def test_field_module_edited_restales_no_other_field(rerun):
    edit(
        rerun / "workflow/pandis/pipeline/kinds/network/training/trainer.py",
        "QUICK = 4000",
        "QUICK = 4001",
    )
    network = {("train", m, "pandis-exact") for m in BOTH} | graphs("pandis-exact")
    network |= native("pandis-exact")
    assert plan(rerun) == network | all_of(*DEPENDENT) | LAST


def test_baking_module_edited_trains_nothing(rerun):
    edit(rerun / "workflow/pandis/pipeline/kinds/grid/dense.py", "(1 << 18)", "(1 << 17)")
    grids = {("bake", m, "grid-force-24") for m in BOTH}
    grids |= graphs("trilinear-24") | native("trilinear-24")
    assert plan(rerun) == grids | all_of(*DEPENDENT) | LAST


def test_grid_module_edited_bakes_and_trains_nothing(rerun):
    edit(
        rerun / "workflow/pandis/pipeline/kinds/grid/interpolation.py",
        "Lattice.around_box(len(self.values) - 1)",
        "Lattice.around_box(+len(self.values) - 1)",
    )
    grids = graphs("trilinear-24") | native("trilinear-24")
    assert plan(rerun) == grids | all_of(*DEPENDENT) | LAST


def test_network_module_edited_bakes_nothing(rerun):
    edit(
        rerun / "workflow/pandis/pipeline/kinds/network/reference.py", "h = np.sin(", "h = +np.sin("
    )
    networks = graphs("pandis-exact") | native("pandis-exact")
    assert plan(rerun) == networks | all_of(*DEPENDENT) | LAST


def test_one_loss_edited_trains_the_other_recipe_not_again(rerun):
    edit(
        rerun / "workflow/pandis/pipeline/kinds/network/training/paper_loss.py",
        "clamp(max=80.0)",
        "clamp(max=81.0)",
    )
    assert plan(rerun) == set()  # the configuration trains pandis-exact alone
    edit(
        rerun / "workflow/pandis/pipeline/kinds/network/training/exact_loss.py",
        "off + options",
        "+off + options",
    )
    network = {("train", m, "pandis-exact") for m in BOTH} | graphs("pandis-exact")
    network |= native("pandis-exact")
    assert plan(rerun) == network | all_of(*DEPENDENT) | LAST


def test_config_module_edited_reruns_nothing(rerun):
    """Options reach a stage through its params: the module that reads them is not a part of it."""
    edit(
        rerun / "workflow/pandis/pipeline/run/ask/reading.py",
        "def merge(base, override):",
        "def merge(base, override=()):",
    )
    assert plan(rerun) == set()


def test_comment_and_docstring_edited(rerun):
    for path in (rerun / "workflow/pandis").rglob("*.py"):
        path.write_text("# a comment\n" + path.read_text() + "\n\n\n")
    edit(rerun / "scripts/mesh.py", '"""Read', '"""Really read')
    assert plan(rerun) == set()


def test_everything_touched(rerun):
    for path in rerun.rglob("*"):
        if path.is_file() and ".snakemake" not in path.parts:
            os.utime(path)
    assert plan(rerun) == set()


def test_tree_copied(rerun, tmp_path):
    shutil.copytree(rerun, tmp_path / "copied", copy_function=shutil.copyfile)
    assert plan(tmp_path / "copied") == set()


def test_keys_reordered(rerun):
    config = yaml.safe_load((rerun / FAST).read_text())

    def backwards(value):
        if isinstance(value, dict):
            return {k: backwards(value[k]) for k in reversed(value)}
        return value

    (rerun / FAST).write_text(yaml.safe_dump(backwards(config), sort_keys=False))
    # the order of the meshes is the order of the report, and nothing else
    assert plan(rerun) <= LAST
    config = backwards(config) | {"meshes": config["meshes"]}
    (rerun / FAST).write_text(yaml.safe_dump(config, sort_keys=False))
    assert plan(rerun) == set()


def test_swapped_values_are_noticed(rerun):
    config = yaml.safe_load((rerun / FAST).read_text())
    samples = config["samples"]
    samples["offsets"], samples["box"] = samples["box"], samples["offsets"]
    (rerun / FAST).write_text(yaml.safe_dump(config))
    network = {("train", m, "pandis-exact") for m in BOTH} | graphs("pandis-exact")
    network |= native("pandis-exact")
    assert plan(rerun) == all_of("sample", *DEPENDENT) | network | LAST


def test_field_added(rerun):
    change(
        rerun, fields=["exact", "trilinear-24", "pandis-exact", "nearest-24", "trilinear-normal-8"]
    )
    own = {("bake", m, "grid-normal-8") for m in BOTH}
    own |= graphs("nearest-24", "trilinear-normal-8")
    own |= native("nearest-24", "trilinear-normal-8")
    assert plan(rerun) == own | all_of(*DEPENDENT) | LAST


@pytest.mark.parametrize("field", ["trilinear-24", "pandis-exact"])
def test_field_taken_off(rerun, field):
    kept = [f for f in ("exact", "trilinear-24", "pandis-exact") if f != field]
    change(rerun, fields=kept)
    assert plan(rerun) == all_of(*DEPENDENT) | LAST


def test_no_network_means_no_samples(workspace):
    change(workspace, fields=["exact", "trilinear-24"])
    assert not {job[0] for job in plan(workspace)} & {"sample", "train"}


def test_upstream_missing_reruns_what_follows(rerun):
    (rerun / "results/torus/samples.zarr.zip").unlink()
    own = all_of("sample", *DEPENDENT, meshes=["torus"])
    own |= {("train", "torus", "pandis-exact")} | graphs("pandis-exact", meshes=["torus"])
    own |= native("pandis-exact", meshes=["torus"])
    assert plan(rerun) == own | LAST


@pytest.mark.parametrize(
    ("target", "stages"),
    [
        ("meshes", {"mesh"}),
        ("samples", {"mesh", "sample"}),
        ("models", {"mesh", "sample", "train"}),
        ("grids", {"mesh", "bake"}),
        (
            "exports",
            {"mesh", "sample", "train", "bake", "export_graph", "export_native"},
        ),
    ],
)
def test_named_targets(workspace, target, stages):
    jobs = plan(workspace, targets=[target])
    assert {job[0] for job in jobs} - {target} == stages


SCENE = {"objects": {"a": {"mesh": "torus", "field": "trilinear-24"}}}


def test_a_scene_builds_what_its_objects_need(workspace):
    """No other mesh, no other field, and no stage besides."""
    change(workspace, scenes={"table": SCENE})
    wanted = {("mesh", "torus"), ("bake", "torus", "grid-force-24"), ("scene", None, "table")}
    assert plan(workspace) == wanted | native("trilinear-24", meshes=["torus"])


def test_a_scene_may_ask_for_a_field_that_is_not_listed(workspace):
    objects = {"a": {"mesh": "torus", "field": "spline-auto"}, "b": SCENE["objects"]["a"]}
    objects["c"] = {"mesh": "sphere", "field": "pandis-exact"}
    change(workspace, scenes={"table": {"objects": objects}, "other": SCENE})
    wanted = all_of("mesh")
    wanted |= {("bake", "torus", stem) for stem in ("grid-force-24", "grid-spline-auto")}
    wanted |= {("sample", "sphere"), ("train", "sphere", "pandis-exact")}
    wanted |= {("scene", None, "table"), ("scene", None, "other")}
    wanted |= native("trilinear-24", "spline-auto", meshes=["torus"])
    wanted |= native("pandis-exact", meshes=["sphere"])
    assert plan(workspace) == wanted


def test_a_scene_with_materials_brings_the_mesh_that_knows_where_they_are(workspace):
    """A grid knows no regions: a mesh that is listed says them, a compact one before the exact."""
    felt = SCENE | {"contact": {"materials": {"rubber": {"sticking": 0.9}}}}
    change(workspace, scenes={"table": felt, "other": SCENE})
    wanted = {("mesh", "torus"), ("bake", "torus", "grid-force-24")}
    wanted |= {("scene", None, "table"), ("scene", None, "other")}
    assert plan(workspace) == wanted | native("trilinear-24", "exact", meshes=["torus"])

    def beside(scene, *fields, listed=("exact", "compact-auto")):
        objects = {f"o{i}": {"mesh": "t", "field": field} for i, field in enumerate(fields)}
        meshes = {"t": {"source": "analytic:torus", "fields": [*listed, "tricubic-24"]}}
        config = {"meshes": meshes, "scenes": {"table": scene | {"objects": objects}}}
        asked = Plan(config, ROOT / "workflow").stage_options("scene", scene="table").objects
        return [placed.beside for placed in asked]

    assert beside(SCENE, "tricubic-24") == [None]
    given = "exact", "tricubic-24", "compact-12"
    assert beside(felt, *given) == [None, "compact-auto", None]
    assert beside(felt, *given, listed=["exact"]) == [None, "exact", None]
    assert beside(felt, *given, listed=[]) == [None, None, None]


def test_moving_an_object_tries_the_scene_alone(rerun):
    """What a run without scenes has built is taken."""
    change(rerun, scenes={"table": SCENE})
    assert plan(rerun) == {("scene", None, "table")}


def test_other_targets_do_not_mind_scenes(rerun):
    """Comparing all fields of all meshes is done, and stays so."""
    change(rerun, scenes={"table": SCENE})
    for target in ("report", "hardware", "evaluations", "models"):
        assert plan(rerun, targets=(target,)) == set()


def test_faults_of_every_part_of_a_configuration_are_reported_at_once():
    config = {
        "results": "re sults",
        "until": "report",
        "seed": -1,
        "meshes": {"torus": {"source": "missing.stl"}, "cup": {"source": "analytic:torus", "x": 1},
                   "ball": {"source": "analytic:spere"}, "far": {"source": "https://a.org/a.stl"}},
        "scenes": {"table": {"objects": {
            "a": {"mesh": "vase", "field": "exact"}, "b": {"mesh": "cup", "field": "exakt"},
            "c": {"mesh": "cup", "field": "mine"},
        }}},
        "train": {"mine": {}},
        "datasets": {"parts": {"source": "none"}},
    }  # fmt: skip
    with pytest.raises(ConfigError) as error:
        Plan(config, ROOT / "workflow")
    for key in ("results", "until", "seed", "meshes.torus.source", "meshes.cup.x",
                "meshes.ball.source", "meshes.far.sha256",
                "scenes.table.objects.a.mesh", "scenes.table.objects.b.field",
                "datasets.parts.source"):  # fmt: skip
        assert f"\n  {key}: " in str(error.value)
    assert "10 faults" in str(error.value)


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        ({"objects": {"a": {"mesh": "cup", "field": "exact"}}}, "there is no mesh cup"),
        ({"objects": {"a": {"mesh": "gone", "field": "exact"}}}, "gone cannot be built"),
        ({"objects": {"a": {"mesh": "torus", "field": "exakt"}}}, "scenes.table.objects.a.field"),
        ({"objects": {"a": {"mesh": "torus", "field": "salisbury"}}}, "has no file for pandis.h"),
        ({"objects": {"a": {"mesh": "torus", "field": "auto"}}}, "budget.force_error"),
        ({"objects": {"a": {"mesh": "torus"}}}, "scenes.table.objects.a.field: "),
        ({"objects": {}}, "scenes.table.objects: "),
        ({}, "scenes.table.objects: "),
        ({"objects": {"A b": SCENE["objects"]["a"]}}, "an object's name must start with a-z"),
        ({"objects": {"a": SCENE["objects"]["a"] | {"size": 0}}}, "scenes.table.objects.a.size"),
        ({"objects": {"a": SCENE["objects"]["a"] | {"sise": 1}}}, "did you mean 'size'?"),
        ({"objects": {"a": SCENE["objects"]["a"] | {"position": [0, 0]}}}, "objects.a.position"),
    ],
)
def test_a_scene_that_cannot_be_is_refused(scene, said):
    meshes = {"torus": {"source": "analytic:torus"}, "gone": {"source": "gone.stl"}}
    config = {"meshes": meshes, "scenes": {"table": scene}}
    with pytest.raises(PandisError, match=re.escape(said)):
        Plan(config, ROOT / "workflow")
