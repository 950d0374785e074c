import json
import re

import numpy as np
import pytest
import yaml

import generate
from pandis.base.errors import PandisError
from pandis.pipeline.run.ask.kinds import KINDS
from pandis.pipeline.run.ask.options import MeshOptions
from pandis.pipeline.run.ask.reading import check_yaml, load_config, merge
from pandis.pipeline.run.plan.plan import Plan
from pandis.pipeline.run.plan.stages import stage_seed
from support import ROOT


def load(text, **meshes):
    config = yaml.safe_load(text) or {}
    return load_config({"meshes": meshes or {"a": {"source": "a.obj"}}} | config)


def faults(text, **meshes):
    with pytest.raises(PandisError) as caught:
        load(text, **meshes)
    return str(caught.value)


def test_configs_that_come_along_are_valid_and_name_their_schema():
    paths = sorted((ROOT / "config").glob("*.yaml"))
    assert {"config.yaml", "fast.yaml", "front.yaml", "sphere.yaml"} <= {p.name for p in paths}
    for path in paths:
        check_yaml(path)
        assert load_config(yaml.safe_load(path.read_text()))
        first = path.read_text().splitlines()[0]
        schema = re.search(r"\$schema=(\S+)", first)[1]
        assert (path.parent / schema).is_file()


def test_auto_is_one_field_and_needs_to_know_what_to_achieve():
    assert "fields.0: auto needs a target" in faults("fields: auto")
    assert "budget" in faults("fields: auto\nbudget: {bytes: 1000}")
    entry = load("fields: auto\nbudget: {force_error: 1e-3}")["a"]
    assert entry.fields == ["auto"]
    assert "auto stands alone" in faults("fields: [exact, auto]\nbudget: {force_error: 1e-3}")
    assert "train.auto" in faults("train: {auto: {width: 8}}")


def test_all_faults_at_once_with_paths_and_suggestions():
    text = faults(
        "tarin: {}\nsamples: {surfaces: 3}\ntrain: {pandis: {step: 4, omega: fast}}\nseed: -1",
        a={"source": "a.obj", "timing": {"queries": 1}},
        b={"sorce": "b.obj"},
    )
    assert "8 faults" in text
    for line in (
        "tarin: unknown option; did you mean 'train'?",
        "samples.surfaces: unknown option; did you mean 'surface'?",
        "train.pandis.step: unknown option; did you mean 'steps'?",
        "train.pandis.omega:",
        "seed: Input should be greater than or equal to 0 (given: -1)",
        "meshes.a.timing.queries:",
        "meshes.b.source: missing",
        "meshes.b.sorce: unknown option; did you mean 'source'?",
    ):
        assert line in text
    assert "config/README.md" in text


@pytest.mark.parametrize("kind", [name for name, kind in KINDS.items() if kind.examples])
def test_the_table_of_fields_has_a_row_for_every_kind(kind):
    text = (ROOT / "config/README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`.*?) \|", text[text.index("\n## Fields\n") :], re.M)
    assert any(form in row for form in KINDS[kind].forms for row in rows)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "train: {pandis: {steps: 0}}",
            "train.pandis.steps: Input should be greater than or equal",
        ),
        ("train: {pandis: {seconds: 0}}", "train.pandis.seconds: Input should be greater than 0"),
        ("train: {pandis: {steps: 1, seconds: 2}}", "train.pandis: a budget is in steps or in"),
        (
            "fields: [exact, trilnear-64]",
            "fields.1: 'trilnear-64' is not a field; the fields are exact,",
        ),
        ("fields: [exact, trilinear-1]", "fields.1: trilinear-1: it must have 4 to 512 nodes"),
        ("fields: [exact, spline-8]", "fields.1: spline-8: it must have 32 to 320 nodes"),
        ("fields: [trilinear-auto]", "fields.0: trilinear-auto needs a target"),
        ("fields: [salisbury-tricubic-auto]", "fields.0: tricubic-auto needs a target"),
        (
            "{trajectory: {kind: spiral}, evaluation: {paths: 8}}",
            "a spiral is always the same path",
        ),
        ("fields: [salisbury-auto]", "fields.0: salisbury-auto: a contact point is tracked on"),
        ("bake: {auto: {trilinear: {}}}", "bake.auto.trilinear: name one of force_error and"),
        ("bake: {auto: {cubic: {bytes: 9}}}", "bake.auto.cubic"),
        ("bake: {inside: 0}", "bake.inside: Input should be greater than 0"),
        ("fields: [exact, exact]", "fields.1: exact is listed twice"),
        ("train: {trilinear-007: {}}", "train.trilinear-007: a recipe's name"),
        ("seed: -1\nfields: [exact, a, b]", "3 faults"),
        ("samples: {held_out: 1}", "samples.held_out:"),
        ("samples: {scales: []}", "samples.scales:"),
        ("fields: []", "fields: List should have at least 1 item"),
        ("train: {nearest-8: {}}", "train.nearest-8: a recipe's name"),
        ("train: {exact: {}}", "train.exact: a recipe's name"),
        ("device: {size: .inf}", "device.size: Input should be a finite number"),
        ("device: {size: 60}", "device.size: no device reaches that far: at most 10, in metres"),
        ("trajectory: {shallow: 0.5}", "trajectory: shallow must be less than deep"),
        ("train: {small: {loss: papr}}", "train.small: Input tag 'papr'"),
        ("samples: 3", "samples:"),
    ],
)
def test_impossible_values(text, message):
    assert message in faults(text)


def test_mesh_names_and_sources():
    for name in ("logs", "scenes"):
        assert f"meshes.{name}: this name is taken" in faults("", **{name: {"source": "a.obj"}})
    assert "meshes.A b: a mesh's name" in faults("", **{"A b": {"source": "a.obj"}})
    both = faults("", **{"A b": {"source": "a.obj", "device": {"stifness": 3}}})
    assert "meshes.A b: a mesh's name" in both
    assert "meshes.A b.device.stifness: unknown option; did you mean 'stiffness'?" in both
    assert "meshes.a: expected a mapping" in faults("", a="a.obj")
    for other in ("", "seed: abc"):  # another fault hides none
        assert "meshes.a.sha256: a URL needs" in faults(other, a={"source": "https://a.org/a.obj"})
    with pytest.raises(PandisError, match="at least one mesh"):
        load_config({})
    with pytest.raises(PandisError, match=r"meshes.False: YAML reads on, off, .* in quotes"):
        load_config({"meshes": {False: {"source": "a.obj"}}})


def test_the_error_of_a_solid_is_a_number_of_mesh_units_or_has_a_unit():
    for value in (0.2, "0.2", "0.2 mm", "0.1 %", "64 cells", "1024 cells", 3, 1e-5):
        assert MeshOptions(solid_error=value).solid_error == str(value)
    assert MeshOptions(solid_error=np.float64(0.2)).solid_error == "0.2"
    for value in (
        "3 cells",
        "5000 cells",
        "0 %",
        0,
        -1,
        "0.2 furlong",
        "fine",
        "",
        True,
        None,
        "1e400",
    ):
        assert "mesh.solid_error: " in faults(yaml.safe_dump({"mesh": {"solid_error": value}}))


def test_numbers_with_exponents():
    entry = load("train: {pandis: {learning_rate: 1e-4, steps: 1e4}}")["a"]
    assert entry.train["pandis"].learning_rate == 1e-4
    assert entry.train["pandis"].steps == 10_000


def test_overrides_merge_by_key_and_lists_replace():
    entries = load(
        "samples: {scales: [0.1, 0.2], depth: 0.5}\ntrain: {x: {loss: paper, alpha: 7}}",
        a={"source": "a.obj"},
        b={"source": "b.obj", "samples": {"scales": [0.3]}, "train": {"x": {"omega": 9}}},
    )
    assert entries["b"].samples.scales == [0.3]
    assert entries["b"].samples.depth == entries["a"].samples.depth == 0.5
    assert (entries["b"].train["x"].alpha, entries["b"].train["x"].omega) == (7, 9)
    assert entries["a"].train["x"].omega == 30
    assert merge({"a": {"b": 1}}, {"a": 2}) == {"a": 2}


def test_empty_section_and_merge_keys_are_accepted(tmp_path):
    for empty in ("train:", "train: {pandis: }", "train: {pandis: {}}"):
        assert load(empty)["a"].train["pandis"].loss == "paper"
    path = tmp_path / "c.yaml"
    path.write_text("a: &x {b: 1}\nc: {<<: *x, d: 2}\n")
    check_yaml(path)


def test_doubled_key_is_refused(tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text("meshes:\n  bunny: {source: a.obj}\n  bunny: {source: b.obj}\n")
    with pytest.raises(PandisError, match=r"c\.yaml, line 3: the key 'bunny' occurs twice"):
        check_yaml(path)


def test_stage_options_are_plain_sorted_and_of_their_stage_only():
    plan = Plan({"meshes": {"a": {"source": "analytic:sphere"}}}, ROOT / "workflow")
    for output in plan.outputs("a"):
        options = plan.options(output.stage)(output.wildcards)
        assert json.loads(json.dumps(options)) == options
        assert list(options) == sorted(options)
    assert "width" not in plan.options("sample")({"mesh": "a"})


def test_seeds_differ_by_mesh_and_stage_and_stay_the_same():
    seeds = {stage_seed(0, m, s) for m in "ab" for s in ("train", "sample")}
    assert len(seeds) == 4
    assert stage_seed(0, "bunny", "sample") == 37265513118842324  # a change restales all results


def test_generated_files_are_in_sync():
    for path, text in generate.generated().items():
        assert path.read_text() == text, f"{path}: run `make docs`"


def test_no_formula_hides_in_a_comment_of_the_docs():
    for path in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")):
        for comment in re.findall(r"<!--(.*?)-->", path.read_text(encoding="utf-8"), re.DOTALL):
            assert re.fullmatch(r" (generated: \w+|end of generated) ", comment), (path, comment)


def test_schema_accepts_the_configs_and_refuses_a_typo():
    import jsonschema

    schema = json.loads(generate.SCHEMA.read_text())
    for name in ("config", "fast"):
        config = yaml.safe_load((ROOT / "config" / f"{name}.yaml").read_text())
        jsonschema.validate(config, schema)
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(config | {"filds": []}, schema)


@pytest.mark.parametrize(
    ("sections", "said"),
    [
        ({"fields": ["auto", "tricubic-32"], "budget": {"force_error": 1e-3}}, "auto stands alone"),
        ({"fields": ["trilinaer-64"]}, "did you mean 'trilinear-64'?"),
        ({"fields": ["pandis-exakt"]}, "did you mean 'pandis-exact'?"),
        ({"budget": {"force_error": "20 kN"}}, "an amount of force is a number above zero"),
        ({"budget": {"force_error": -1}}, "an amount of force is a number above zero"),
        ({"budget": {"force_error": 1e-3, "missed": 0.02}}, "budget.missed"),
        ({"bake": {"auto": {"spline": {"force_error": "x"}}}}, "an amount of force"),
    ],
)
def test_what_a_user_may_write_wrongly_is_said_in_one_sentence(sections, said):
    with pytest.raises(PandisError) as error:
        load_config({"meshes": {"a": {"source": "analytic:box"}}} | sections)
    assert said in str(error.value)


def test_one_field_needs_no_list_and_budgets_take_newtons_and_percent():
    raw = {"fields": "tricubic-64", "meshes": {"a": {"source": "analytic:box"}}}
    assert load_config(raw)["a"].fields == ["tricubic-64"]
    raw = {"fields": "auto", "budget": {"force_error": "20 mN", "tail": "50 %"}} | {
        "meshes": {"a": {"source": "analytic:box"}}
    }
    budget = load_config(raw)["a"].budget
    assert (budget.force_error, budget.tail, budget.missed) == ("20 mN", "50 %", 0.005)


def test_a_fault_of_one_mesh_is_its_own():
    meshes = {"a": {"source": "analytic:box"}, "b": {"source": "analytic:box", "stres": {}}}
    refused = {}
    assert list(load_config({"meshes": meshes}, refused)) == ["a"]
    assert refused == {"b": "meshes.b.stres: unknown option; did you mean 'stress'?"}
    with pytest.raises(PandisError, match=r"meshes\.b\.stres"):
        load_config({"meshes": {"b": meshes["b"]}}, {})
    with pytest.raises(PandisError, match="seed: Input should be"):
        load_config({"meshes": meshes, "seed": -1}, {})  # shared: no mesh can be built
