"""Networks asked for by their error: the narrowest that meets it, or none."""

import numpy as np
import pytest

from pandis.base.errors import PandisError
from pandis.base.physical import Scale
from pandis.base.progress import Context
from pandis.pipeline.geometry.points import Points
from pandis.pipeline.kinds.network.build import WIDTHS, train
from pandis.pipeline.kinds.network.training.trainer import Trainer
from pandis.pipeline.run.job.stage import silent_progress
from test_training import same, samples, task  # noqa: F401  (a fixture)

#: Takes long: `make test-slow`.
pytestmark = pytest.mark.slow


def sized(drawn, folder, log=lambda text: None, **options):
    own = task(steps=150, width=64, base=None, **options)  # the base alone is good at spheres
    loose = {"tail": 1.0, "missed": 1.0}
    own = own.model_copy(update={"recipe": own.recipe.model_copy(update=loose)})
    strata = drawn[1]
    points = Points(strata.body, Scale(0.1, 400.0), own.seed)
    return train(own, drawn, points, context=Context(folder / "train-r.0.pt", silent_progress, log))


def test_it_is_the_narrowest_and_the_one_that_training_alone_makes(samples, tmp_path):  # noqa: F811
    arrays, attributes, finish = sized(samples, tmp_path, force_error=7e-3)
    tried = attributes["sizing"]["tried"]
    width = attributes["architecture"]["width"]
    assert [one["size"] for one in tried] == [w for w in WIDTHS if w <= width]
    assert all(one["force_error"] > 7e-3 for one in tried[:-1])
    assert tried[-1]["force_error"] <= 7e-3
    assert len(tried) > 1
    assert (np.diff([one["bytes"] for one in tried]) > 0).all()
    alone = Trainer(
        task(steps=150, width=width, base=None),
        samples,
        Context(tmp_path / "a.pt", silent_progress, print),
    )
    own = {key: value for key, value in attributes.items() if key != "sizing"}
    assert same((arrays, own), alone.run())
    finish()
    assert not list(tmp_path.glob("*.pt"))


def test_a_loose_error_is_met_by_the_first(samples, tmp_path):  # noqa: F811
    _, attributes, _ = sized(samples, tmp_path, force_error=1.0)
    assert attributes["architecture"]["width"] == WIDTHS[0]


def test_it_says_that_none_did(samples, tmp_path):  # noqa: F811
    with pytest.raises(
        PandisError, match=r"train\.r: no network meets .*mN .*1e-09.*up to 64 units"
    ):
        sized(samples, tmp_path, force_error=1e-9)
    assert not list(tmp_path.glob("*.pt"))


def test_finished_networks_are_not_trained_again(samples, tmp_path, monkeypatch):  # noqa: F811
    undisturbed = sized(samples, tmp_path, force_error=7e-3)
    undisturbed[2]()
    advance, steps = Trainer._advance, []

    def counted(self, share):
        steps.append(self.shape.width)
        if len(steps) == 200:
            raise KeyboardInterrupt
        return advance(self, share)

    monkeypatch.setattr(Trainer, "_advance", counted)
    with pytest.raises(KeyboardInterrupt):
        sized(samples, tmp_path, force_error=7e-3)
    again = sized(samples, tmp_path, force_error=7e-3)
    assert steps.count(WIDTHS[0]) == 150
    assert same(again[:2], undisturbed[:2])
