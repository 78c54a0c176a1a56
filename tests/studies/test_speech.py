"""The speech study: scores with known answers, splits, sums, and the page's tables."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.studies.speech.data import TEST, TRAINING, Utterances, read_utterances
from bayesmotion.studies.speech.report import markdown
from bayesmotion.studies.speech.scores import paired, scores, summary
from bayesmotion.studies.speech.study import MODELS, PAIRS, together
from bayesmotion.tasks.speech_baselines import train_regression, train_ridge


@pytest.fixture
def true():
    random = np.random.default_rng(0)
    return {name: random.normal(size=(30, 21)) for name in ("one", "two")}


def test_scores_of_what_is_known(true):
    half = {name: 0.5 * face for name, face in true.items()}
    found = scores(half, true, {name: np.full((30, 21), 1e9) for name in true})
    every = np.concatenate(list(true.values()))
    assert found["rms_mm"] == pytest.approx(0.5 * np.sqrt(np.mean(every**2)))
    assert found["lips_rms_mm"] == pytest.approx(0.5 * np.sqrt(np.mean(every[:, :12] ** 2)))
    assert found["correlation"] == pytest.approx(1.0)
    assert found["lips_peak_to_peak"] == pytest.approx(0.5)
    assert found["coverage90"] == 1.0
    assert "coverage90" not in scores(half, true)


def test_intervals_of_normal_errors_hold_nine_of_ten():
    random = np.random.default_rng(1)
    true = {"a": random.normal(size=(2000, 21))}
    made = {"a": true["a"] + 2.0 * random.normal(size=(2000, 21))}
    found = scores(made, true, {"a": np.full((2000, 21), 2.0)})
    assert found["coverage90"] == pytest.approx(0.9, abs=0.01)


def test_paired_differences():
    found = paired([1.0, 2.0, 3.0], [0.5, 1.4, 2.6])
    assert found["mean"] == pytest.approx(0.5)
    low, high = found["interval95"]
    # 12 tested, 40 trained: repeats that share utterances count for less than three.
    assert high - 0.5 == pytest.approx(4.303 * 0.1 * np.sqrt(1 / 3 + 12 / 40), rel=1e-3)
    assert low == pytest.approx(1.0 - high)
    assert paired([2.0], [1.0]) == {"mean": 1.0}


def test_splits_are_disjoint_and_of_their_repeat(tmp_path):
    names = [f"u{i:02}" for i in range(60)]
    utterances = Utterances(dict.fromkeys(names, np.zeros((2, 20))), {})
    training, test = utterances.split(3, 0)
    assert len(training) == TRAINING
    assert len(test) == TEST
    assert not set(training) & set(test)
    assert utterances.split(3, 0) == (training, test)
    assert utterances.split(4, 0) != (training, test)
    with pytest.raises(InputError, match="it holds 0 utterances"):
        read_utterances(tmp_path)


def test_only_whole_repeats_are_summed_up():
    one = {
        "rms_mm": 2.0, "lips_rms_mm": 1.0, "correlation": 0.7, "lips_peak_to_peak": 0.9,
        "training_seconds": 3.0, "seconds_per_second": 0.01,
    }  # fmt: skip
    other = {**one, "rms_mm": 4.0, "coverage90": 0.9}
    whole = {**dict.fromkeys(MODELS, one), "sgplvm_window": other}
    found = together({"0": whole, "1": whole, "2": {"ridge": one}})
    assert found["count"] == 2
    assert found["ema"]["ridge"]["rms_mm"] == [2.0, 0.0]
    assert found["differences"]["sgplvm_window - sgplvm_a"]["mean"] == 2.0
    text = markdown(found)
    assert "| shared, window | 4.00 ± 0.00 | 1.00 ± 0.00 | 0.700 ± 0.000 |" in text
    assert text.count(" less ") == len(PAIRS)
    assert markdown({}) == ""
    assert summary([one])["rms_mm"] == [2.0, 0.0]


def test_regressions_tell_a_face_from_its_sound():
    random = np.random.default_rng(2)
    sound = [np.cumsum(random.normal(size=(60, 3)), axis=0) for _ in range(5)]
    face = [clip @ random.normal(size=(3, 2)) * 0 + np.tanh(clip[:, :2]) for clip in sound]
    ridge, process = (learn(sound[:4], face[:4]) for learn in (train_ridge, train_regression))
    mean, spread = process.speak(sound[4])
    for made in (ridge.speak(sound[4]), mean):
        assert np.sqrt(np.mean((made - face[4]) ** 2)) < 0.8 * face[4].std()
    assert (spread > 0).all()
