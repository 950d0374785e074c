"""Networks asked from C++ on LibTorch."""

import shutil

import numpy as np
import pytest

from pandis.base.errors import PandisError
from pandis.base.frame import UNIT
from pandis.pipeline.judge.timing import libtorch, timing
from pandis.pipeline.kinds.network.graph import export_network
from pandis.pipeline.kinds.network.program import export_program
from pandis.pipeline.run.ask.options import TimingOptions
from pandis.pipeline.run.job.artifact import Artifact
from test_fields_and_export import FRAME, model


@pytest.mark.full
@pytest.mark.skipif(not shutil.which("g++"), reason="needs g++")
@pytest.mark.parametrize("outputs", [1, 4])
def test_program_in_cpp_answers_as_onnx_does_and_is_timed(tmp_path, outputs):
    held, _ = model(32, 3, outputs=outputs)
    path = tmp_path / "net.pt2"
    path.write_bytes(export_program("net", held, {}, log=print))
    path.with_suffix(".onnx").write_bytes(export_network("net", held, {}, log=print))
    mesh = Artifact("mesh", {}, FRAME.attributes())
    points = np.random.default_rng(0).uniform(-0.9, 0.9, (300, 3))
    found, options = {"net": {}}, TimingOptions(queries=700)
    arrays = timing.time_program(path, mesh, points, options=options, figures=found, log=print)
    assert arrays["libtorch_net"].shape == (700,)
    assert (arrays["libtorch_net"] > 0).all()
    assert 0 < found["net"]["libtorch_p50_us"] <= found["net"]["libtorch_p999_us"]
    other, _ = model(32, 3, outputs=outputs, seed=5)
    path.with_suffix(".onnx").write_bytes(export_network("net", other, {}, log=print))
    with pytest.raises(PandisError, match="differs from the ONNX model's"):
        timing.time_program(path, mesh, points, options=options, figures=found, log=print)


def test_without_a_compiler_the_option_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("CXX", "no-such-compiler")
    with pytest.raises(PandisError, match=r"timing\.libtorch: no C\+\+ compiler"):
        libtorch.ask(tmp_path / "a.pt2", np.zeros((1, 3)), 1)


def test_a_wrong_answer_is_not_reported(monkeypatch, tmp_path):
    """A program that answers something else is an error, not a figure."""
    held, _ = model(16, 2)
    path = tmp_path / "net.onnx"
    path.write_bytes(export_network("net", held, {}, log=print))
    mesh = Artifact("mesh", {}, UNIT.attributes())
    wrong = np.full(10, -0.1), np.tile([0.0, 0, 1], (10, 1)), np.ones(5)
    monkeypatch.setattr(libtorch, "ask", lambda *_, **__: wrong)
    with pytest.raises(PandisError, match=r"set timing\.libtorch to false"):
        timing.time_program(
            path.with_suffix(".pt2"),
            mesh,
            np.zeros((10, 3)),
            options=TimingOptions.model_construct(queries=5),
            figures={"net": {}},
            log=print,
        )
