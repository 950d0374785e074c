"""The order in which a configuration lists fields is no reason to run anything."""

import pytest
import yaml

from pandis.pipeline.run.ask.catalogue import in_order
from pandis.pipeline.run.plan.plan import Plan
from pandis.pipeline.run.plan.stages import STAGES
from support import ROOT

FIELDS = [
    "exact", "compact-auto", "nearest-64", "trilinear-64", "trilinear-box-64",
    "trilinear-normal-64", "tricubic-64", "spline-auto", "pandis", "pandis-exact",
]  # fmt: skip


def asked(fields):
    config = {"fields": fields, "meshes": {"part": {"source": "analytic:torus"}}}
    plan = Plan(config, ROOT / "workflow")
    outputs = plan.everything()
    return {o.path: plan.options(o.stage)(o.wildcards) for o in outputs}


def test_the_order_of_fields_changes_no_option():
    assert asked(FIELDS) == asked(FIELDS[::-1])
    assert len(asked(FIELDS)) > len(STAGES) / 2


def test_the_default_configuration_is_in_the_order_of_kinds():
    named = yaml.safe_load((ROOT / "config/config.yaml").read_text())["fields"]
    assert named == FIELDS == in_order(FIELDS[::-1], ("pandis", "pandis-exact"))


def test_sizes_come_in_their_order_and_auto_last():
    names = ["spline-auto", "nearest-128", "nearest-64", "exact", "nearest-auto"]
    assert in_order(names, ()) == ["exact", "nearest-64", "nearest-128", "nearest-auto",
                                   "spline-auto"]  # fmt: skip
    with pytest.raises(ValueError, match="is not a field"):
        in_order(["splines"], ())
