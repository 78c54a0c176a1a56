"""Pieces of the keypose study: shares, splits, going on, and its report."""

import json

import numpy as np
import pytest
import xarray as xr

from bayesmotion.studies.keypose import novelty as keypose_novelty
from bayesmotion.studies.keypose import study as keypose
from bayesmotion.studies.keypose.models import first_repetitions, last_repetitions, nearest
from bayesmotion.studies.keypose.scores import accuracies, calibration, interval


def labelled(people, tasks):
    rows = np.arange(float(len(people)))[:, None, None]
    return xr.DataArray(
        rows,
        dims=("clip", "channel", "coefficient"),
        coords={"clip": list(range(len(people))), "subject": ("clip", people),
                "task": ("clip", tasks)},
    )  # fmt: skip


def test_interval_is_that_of_clopper_and_pearson():
    # Both ends leave 2.5 % of a binomial beyond what was seen.
    from scipy.stats import binom

    low, high = interval(42, 48)
    assert binom.sf(41, 48, low) == pytest.approx(0.025)
    assert binom.cdf(42, 48, high) == pytest.approx(0.025)
    assert interval(0, 10)[0] == 0.0
    assert interval(10, 10)[1] == 1.0


def test_first_and_last_repetitions():
    x = labelled(["a", "a", "b", "a", "b"], ["t", "t", "t", "u", "t"])
    assert first_repetitions(x).tolist() == [True, False, True, True, False]
    assert last_repetitions(x).tolist() == [False, True, False, True, True]


def test_nearest_takes_labels_of_the_nearest_training_segment():
    x = labelled(["a", "a", "b", "b"], ["t", "u", "t", "u"])
    trained = np.array([True, False, False, True])
    assert nearest(x, trained, ~trained) == {"subject": ["a", "b"], "task": ["t", "u"]}


def test_accuracies_and_calibration_count_what_is_right():
    x = labelled(["a", "a", "b", "b"], ["t"] * 4)
    p = np.array([[0.95, 0.05], [0.45, 0.55], [0.45, 0.55], [0.45, 0.55]])
    found = xr.Dataset(
        {"p_subject": (("clip", "subject"), p)}, {"clip": x["clip"], "subject": ["a", "b"]}
    )
    one = calibration(found, x, "subject")
    assert one["confidence"] == pytest.approx([0.55, 0.95])
    assert one["right"] == pytest.approx([2 / 3, 1.0])
    assert one["expected_error"] == pytest.approx((3 * (2 / 3 - 0.55) + 0.05) / 4)
    named = {"m": {"subject": ["a", "b", "b", "b"], "task": ["t"] * 4}}
    shares = accuracies(named, x)
    assert (shares["person"]["m"], shares["task"]["m"], shares["n"]) == (0.75, 1.0, 4)


def test_levels_left_out_are_added_up():
    calls = {"found": (3, 4), "false_alarms": (0, 5)}
    row = {"channels": "both", "tensor_bayes": calls, "tensor_paper": calls,
           "positions_only": calls}  # fmt: skip
    other = row | {"channels": "rotations", "tensor_bayes": {**calls, "found": (6, 6)}}
    pooled = keypose_novelty.pooled({"a": row, "b": other})
    assert pooled["tensor_bayes"]["found"]["share"] == pytest.approx(0.9)
    assert pooled["tensor_paper"]["found"]["n"] == 8
    assert pooled["chosen"] == {"a": "both", "b": "rotations"}


def test_an_interrupted_run_goes_on_and_another_seed_begins_anew(tmp_path, monkeypatch):
    calls = []

    def stage(name, broken=False):
        def run():
            calls.append(name)
            if broken and calls.count(name) == 1:
                raise KeyboardInterrupt
            return {"name": name}

        return run

    stages = {"one": stage("one"), "two/a": stage("two", broken=True)}
    monkeypatch.setattr(keypose, "_stages", lambda *_: stages.items())
    monkeypatch.setattr(keypose, "draw_figures", lambda result, out: None)
    with pytest.raises(KeyboardInterrupt):
        keypose.reproduce(None, tmp_path, lambda _: None)
    keypose.reproduce(None, tmp_path, lambda _: None)
    assert calls == ["one", "two", "two"]
    found = json.loads((tmp_path / "keypose.json").read_text())
    assert (found["one"], found["two"]) == ({"name": "one"}, {"a": {"name": "two"}})
    assert set(found["seconds"]) == {"one", "two a"}
    keypose.reproduce(None, tmp_path, lambda _: None, seed=1)
    assert calls[3:] == ["one", "two"]


def test_labels_of_every_probe_are_left_out_of_the_results():
    row = {"named": 0, "true": 0, "task": 1.0, "ms_per_probe": {}, "ms_one_probe": 1.0}
    stages = {"choice": {"chosen": 1}, "known": row, "dances": {"beats": {}}, "music": {"m": 2}}
    made = {"settings": {"seed": 3}, "made_with": {"commits": ["c"]}, "seconds": {}}
    whole = keypose.assembled({**made, **stages})
    found = keypose.without_labels(whole)
    assert found["known"] == {"task": 1.0}
    assert (found["chosen"], found["ms_one_probe"]) == (1, 1.0)
    assert {name: found[name] for name in made} == made
    assert found["beats"] == {"music": {"m": 2}}
    assert whole["known"]["named"] == 0
    assert row["ms_one_probe"] == 1.0
