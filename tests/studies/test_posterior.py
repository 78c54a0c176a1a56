"""Parts of the posterior study that need no recordings."""

import json

import numpy as np
import pytest

from bayesmotion.prediction import Mixture
from bayesmotion.studies.posterior.compare import ranks_agree, stacking_weights
from bayesmotion.studies.posterior.forecasts import kept, means
from bayesmotion.studies.stages import Stages


def test_a_stage_is_done_once_and_again_for_other_settings(tmp_path):
    done = []

    def stages(settings):
        return Stages(tmp_path / "found.json", settings, lambda text: None)

    def work():
        done.append(1)
        return {"found": len(done)}

    assert stages({"seed": 0, "clips": ("a", "b")}).do("one", "two", work=work) == {"found": 1}
    assert stages({"seed": 0, "clips": ("a", "b")}).do("one", "two", work=work) == {"found": 1}
    on_disk = json.loads((tmp_path / "found.json").read_text())
    assert on_disk["one"] == {"two": {"found": 1}}
    assert set(on_disk["seconds"]) == {"one two"}
    assert stages({"seed": 1, "clips": ("a", "b")}).do("one", "two", work=work) == {"found": 2}


def test_a_stage_that_fails_leaves_the_others(tmp_path):
    stages = Stages(tmp_path / "found.json", {}, lambda text: None)
    stages.do("good", work=lambda: 1)
    with pytest.raises(ZeroDivisionError):
        stages.do("bad", work=lambda: 1 // 0)
    again = Stages(tmp_path / "found.json", {}, lambda text: None)
    assert again.result["good"] == 1
    assert "bad" not in again.result


def test_a_forecast_is_made_once(tmp_path):
    first = Mixture(np.zeros((2, 3, 4)), np.ones((2, 3, 4)), np.array([0.25, 0.75]))
    path = tmp_path / "forecasts" / "one.npz"
    kept(path, lambda: first)
    again = kept(path, lambda: pytest.fail("it is there"))
    for name in ("mean", "sd", "weight"):
        np.testing.assert_array_equal(getattr(again, name), getattr(first, name))


def test_scores_are_averaged_over_clips():
    one = {"error": 1.0, "crps": 0.1, "log_score": -1.0, "coverage90": 0.8}
    other = {"error": 2.0, "crps": 0.3, "log_score": 1.0, "coverage90": 1.0}
    found = means({"a": {"mode": one}, "b": {"mode": other}})
    assert found["mean_error"] == {"mode": 1.5}
    assert found["coverage90"] == {"mode": pytest.approx(0.9)}


def test_weights_and_ranks():
    names = ("cdm_style", "gpdm_style", "bgpdm_style", "gpdm", "bgpdm")
    table = [
        {"fit": name, "elpd": -float(i), "weight": w}
        for i, (name, w) in enumerate(zip(names, (0.6, 0.2, 0.0, 0.1, 0.1), strict=True))
    ]
    weights = stacking_weights(table)
    assert weights == dict(zip(names, (0.6, 0.2, 0.0, 0.1, 0.1), strict=True))
    agree = ranks_agree(table, {name: float(i) for i, name in enumerate(names)})
    assert agree == pytest.approx(1.0)
    against = ranks_agree(table, {name: -float(i) for i, name in enumerate(names)})
    assert against == pytest.approx(-1.0)
