"""The calibration study on one small model: stages are kept, and the page tells what it found."""

import json

import pytest

from bayesmotion.errors import InputError
from bayesmotion.evaluate.sbc.chains import Chains
from bayesmotion.evaluate.sbc.rank_test import Power
from bayesmotion.studies.calibration import study as study_module
from bayesmotion.studies.calibration.report import markdown
from bayesmotion.studies.calibration.study import Plan, calibrate_all, default_model, shipped_models

TINY = Plan(simulations=50, batches=2, chains=Chains(warmup=60, draws=20, thin=1, depth=3))


@pytest.fixture(scope="module")
def study(mean_cycle, tmp_path_factory):
    folder = tmp_path_factory.mktemp("calibration")
    lines: list[str] = []
    result = calibrate_all({"mean_cycle": mean_cycle()}, folder, TINY, lines.append)
    return folder, result, lines


def test_every_control_is_a_stage_that_is_not_done_again(study, mean_cycle):
    folder, result, lines = study
    one = result["models"]["mean_cycle"]
    assert one["none"]["simulations"] == 50
    assert set(one["gross"]) == {"prior", "frames", "noise"}
    for found in one["subtle"].values():
        assert found["simulations"] == 100
        assert found["power"]["simulations"] == 50
        assert 0.0 <= found["power"]["share"] <= 1.0
    assert set(one["made_with"]) == {"commits", "versions", "data"}
    assert one["settings"]["model"]["name"] == "mean_cycle"
    assert json.loads((folder / "calibration.json").read_text()) == result
    again: list[str] = []
    same = calibrate_all({"mean_cycle": mean_cycle()}, folder, TINY, again.append)
    assert len(lines) == 7
    assert again == []
    assert same == result


def test_the_page_tells_what_was_found(study):
    _, result, _ = study
    text = markdown(result)
    caught = [not one["calibrated"] for one in result["models"]["mean_cycle"]["gross"].values()]
    assert text.count("| found ") == sum(caught)
    share = result["models"]["mean_cycle"]["subtle"]["lag"]["power"]["share"]
    assert f"{share:.2f} (" in text
    assert markdown({}) == ""


@pytest.mark.parametrize("right", [True, False])
def test_a_refused_model_is_calibrated_again(mean_cycle, tmp_path, monkeypatch, right):
    """The first seed refuses it; the second says whether that was chance."""
    asked = []

    def calibrated(model, *, simulations, seed, control, chains):
        asked.append((control, simulations, seed))
        return control, simulations, seed

    def told(tree):
        control, simulations, seed = tree
        return {
            "calibrated": right and control == "none" and seed == 1,
            "simulations": simulations, "p_values": {"pace": 0.001}, "seconds": 1.0,
            "simulations_with_divergences": 0, "largest_autocorrelation": 0.1,
        }  # fmt: skip

    monkeypatch.setattr(study_module, "calibrate", calibrated)
    monkeypatch.setattr(study_module, "summary", told)
    monkeypatch.setattr(study_module, "power", lambda tree, size: Power(0.5, 0.1, size))
    result = calibrate_all({"cycle": mean_cycle()}, tmp_path, TINY, lambda line: None)
    assert asked[:2] == [("none", 50, 0), ("none", 100, 1)]
    assert len(asked) == 8
    text = markdown(result)
    assert f"| cycle | {'yes' if right else '**no**'} |" in text
    assert ("did not refuse it" if right else "refused it too") in text


def test_a_model_without_draws_is_told_and_not_calibrated(mean_cycle, tmp_path):
    class Bound(mean_cycle):
        def sbc_case(self):
            raise InputError("model 'bound'", "it has no density", "Use another")

    result = calibrate_all({"bound": Bound()}, tmp_path, TINY, lambda line: None)
    assert "no density" in result["models"]["bound"]["refused"]
    assert markdown(result) == ""


def test_models_are_taken_as_they_are_shipped(mean_cycle):
    assert shipped_models()["mean_cycle"] == default_model(mean_cycle) == mean_cycle()
