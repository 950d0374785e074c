"""Which jobs scenes need, and scenes that cannot be."""

import re

import pytest

from pandis.base.errors import PandisError
from pandis.pipeline.run.plan.plan import Plan
from plans import all_of, change, native
from support import ROOT, plan

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
