"""The generative keypose program: NUTS and emcee agree, and known values are found."""

import numpy as np
import pytest
from bayesmotion.models.energy import Minima
from bayesmotion.models.keypose_program import SITES, Minimums, labels, minimums, probability

from bayesmotion.tasks.keyposes import posterior, probabilities

TRUE = {"deep_global": 0.3, "deep_body": 1.0, "log_slope": 1.3, "lag": 0.05, "log_width": -2.0}


@pytest.fixture(scope="module")
def data():
    random = np.random.default_rng(0)
    n = 200
    minima = Minimums(
        random.normal(size=n), random.normal(size=n), 0.1 * random.normal(size=n), np.arange(n)
    )
    p = np.asarray(probability(minima, **{k: np.asarray(v) for k, v in TRUE.items()}))
    return minima, (random.random(n) < p).astype(float), p


@pytest.fixture(scope="module")
def nuts(data):
    return posterior(data[0], data[1], seed=0, draws=300, warmup=200, chains=2)


def test_probability_is_high_only_for_deep_minima_near_the_lag():
    one = Minimums(np.array([3.0, -4.0, 3.0]), np.array([-4.0, -4.0, 3.0]),
                   np.array([0.05, 0.05, 0.6]), np.arange(3))  # fmt: skip
    p = np.asarray(probability(one, **{k: np.asarray(v) for k, v in TRUE.items()}))
    assert p[0] > 0.95
    assert p[1] < 0.01
    assert p[2] < 0.01


def test_nuts_and_emcee_agree_within_their_errors(data, nuts):
    ensemble = posterior(data[0], data[1], method="emcee", seed=1, draws=3000, warmup=500)
    time = ensemble["sample_stats"]["autocorrelation_time"].values
    for i, name in enumerate(SITES):
        a, b = nuts["posterior"][name], ensemble["posterior"][name]
        size = [a.size / 4, b.size / time[i]]
        error = np.sqrt(float(a.var()) / size[0] + float(b.var()) / size[1])
        assert abs(float(a.mean() - b.mean())) < 4 * error
        assert float(a.std() / b.std()) == pytest.approx(1.0, abs=0.15)


def test_the_truth_is_in_the_posterior_and_probabilities_beat_the_share(data, nuts):
    minima, answer, p = data
    for name in SITES:
        draws = nuts["posterior"][name]
        assert abs(float(draws.mean()) - TRUE[name]) < 3.5 * float(draws.std())
    found = probabilities(nuts, minima)
    # Twice as near to the truth as the share of keyposes, which knows nothing of the minima.
    assert np.abs(found - p).mean() < 0.5 * np.abs(answer.mean() - p).mean()
    log = np.log(np.where(answer > 0, found, 1 - found)).mean()
    share = answer.mean()
    assert log > share * np.log(share) + (1 - share) * np.log(1 - share) + 0.1


def test_rows_are_the_beats_with_a_minimum():
    one = Minima(
        np.array([10, -1, -1]), np.array([1, np.nan, np.nan]), np.array([2, np.nan, np.nan])
    )
    two = Minima(np.array([11, 20, -1]), np.array([1, 1, np.nan]), np.array([1, 4, np.nan]))
    rows = minimums(one, two, np.array([9.0, 22.0, 40.0]), 10.0)
    assert np.asarray(rows.frame).tolist() == [10, 20]
    np.testing.assert_allclose(rows.offset, [0.1, -0.2])
    assert np.asarray(rows.in_global)[1] == -4.0
    assert labels(rows, [19], 1).tolist() == [0.0, 1.0]
