"""What a stage is asked: one model in plan and script, which does nothing but name and check."""

import ast
import inspect
from pathlib import Path

import pytest
from pydantic import ValidationError

from pandis.base.errors import ArtifactError
from pandis.pipeline.run.ask import options, recipes, targets, tasks, values
from pandis.pipeline.run.ask.kinds import build_task
from pandis.pipeline.run.job.artifact import Artifact
from pandis.pipeline.run.job.provenance import _MODELS
from pandis.pipeline.run.plan.plan import Plan
from pandis.pipeline.run.records.stress import StressRecord
from support import ROOT

#: Two meshes whose fields need every stage that a mesh without a download can have.
FIELDS = ["exact", "trilinear-24", "spline-48", "spline-auto", "pandis", "pandis-exact"]
FIELDS += ["compact-16", "compact-auto", "support-planes", "salisbury"]
MESHES = {
    "a": {
        "source": "analytic:sphere",
        "fields": FIELDS,
        "bake": {"vti": True},
        "export": {"also": ["mjcf", "newton", "page", "vdb"]},
    },
    "b": {"source": "analytic:torus", "fields": "auto", "budget": {"force_error": 1e-3}},
}
MODULES = (options, recipes, targets, tasks, values)


def planned(meshes):
    """Return the plan, and every output of it with what its stage is asked."""
    made = Plan({"meshes": meshes}, ROOT / "workflow")
    outputs = [output for mesh in meshes for output in made.outputs(mesh)]
    return made, [(o, made.stage_options(o.stage, **o.wildcards)) for o in outputs]


def script_model(stage):
    """Return the model that a stage's script names."""
    tree = ast.parse((ROOT / "scripts" / f"{stage}.py").read_text())
    opened = next(node for node in ast.walk(tree) if isinstance(node, ast.With))
    name = opened.items[0].context_expr.args[1].id
    return build_task if name == "build_task" else getattr(tasks, name)


def test_plan_and_script_name_the_same_model():
    seen = set()
    made, asked = planned(MESHES)
    for output, task in asked:
        model = script_model(output.stage)
        assert model is build_task or type(task) is model
        # what Snakemake carries, as the script gets it back
        again = model(**made.options(output.stage)(output.wildcards))
        assert (type(again), again) == (type(task), task)
        seen.add(output.stage)
    for stage in ("summary", "report", "collection", "verify", "calibrate"):
        assert type(made.stage_options(stage)) is script_model(stage)
        seen.add(stage)
    others = {"fetch", "refuse", "scene", "shard", "dataset"}  # of other configurations
    assert seen | others == {path.stem for path in (ROOT / "scripts").glob("*.py")}


def test_models_do_nothing_that_a_stage_could_depend_on():
    """They are no part of a stage's code: so they may check what is given, and nothing else."""
    assert set(_MODELS) == {module.__name__ for module in MODULES}
    for module in MODULES:
        for model in vars(module).values():
            if not (inspect.isclass(model) and issubclass(model, values.Options)):
                continue
            tree = ast.parse(inspect.getsource(model))
            for made in ast.walk(tree):
                if isinstance(made, ast.FunctionDef):
                    words = {ast.unparse(one).partition("(")[0] for one in made.decorator_list}
                    assert words & {"field_validator", "model_validator"}, (model, made.name)


def test_a_task_refuses_what_no_stage_is_asked():
    given = tasks.SampleTask(seed=1).model_dump()
    with pytest.raises(ValidationError, match="sede"):
        tasks.SampleTask(**given, sede=2)
    with pytest.raises(ValidationError, match="seed"):
        tasks.SampleTask()


def keys_of(path):
    """Yield the constant keys by which a module reads options or attributes of an artifact."""
    for node in ast.walk(ast.parse(path.read_text())):
        base = key = None
        if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Load):
            base, key = node.value, node.slice
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.args:
            base, key = (node.func.value, node.args[0]) if node.func.attr == "get" else (None, None)
        if isinstance(key, ast.Constant) and isinstance(key.value, str):
            of = ast.unparse(base)
            if any(word in of for word in ("options", "attributes", "task", "record")):
                yield f"{path.name}: {of}[{key.value!r}]"


def test_options_and_attributes_are_read_by_name_and_not_by_key():
    library = ROOT / "workflow" / "pandis"
    files = [path for path in library.rglob("*.py") if library / "pipeline/run" not in path.parents]
    files = [path for path in files if path.name != "record.py"]
    found = [key for path in [*files, *(ROOT / "scripts").glob("*.py")] for key in keys_of(path)]
    assert len(found) <= 20, found


def test_a_paper_recipe_may_stand_for_the_chosen_network():
    train = {"pandis-exact": {"loss": "paper"}}
    budget = {"fields": "auto", "budget": {"force_error": 1e-3}}
    _, asked = planned({"a": {"source": "analytic:sphere", "train": train} | budget})
    (task,) = (task for output, task in asked if output.stage == "choose")
    assert task.recipe.loss == "paper"


def test_attributes_of_another_version_are_a_sentence():
    artifact = Artifact("stress", {}, {"fields": {}}, path=Path("x.zarr.zip"))
    with pytest.raises(ArtifactError, match=r"x\.zarr\.zip: made by another version of pandis"):
        StressRecord.of(artifact)
