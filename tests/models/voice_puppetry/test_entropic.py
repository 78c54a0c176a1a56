"""The entropic prior: its constant, its draws, and the mode of the M-step."""

import jax
import numpy as np
import pytest
from scipy.special import gammaln

from bayesmotion.models.voice_puppetry.entropic import EntropicSimplex, entropic, log_normaliser


def log_prior(theta):
    return np.sum(theta * np.log(np.maximum(theta, 1e-300)), axis=-1)


@pytest.mark.thorough
@pytest.mark.parametrize("size", [2, 3, 6])
def test_the_prior_is_a_density_and_draws_are_its_own(size):
    uniform = np.random.default_rng(0).dirichlet(np.ones(size), 100_000)
    weight = np.exp(log_prior(uniform))
    found = np.exp(log_normaliser(size) + gammaln(size))
    assert found == pytest.approx(weight.mean(), abs=4.0 * weight.std() / np.sqrt(len(weight)))
    prior = EntropicSimplex(size).expand([3]).to_event(1)
    draws = np.asarray(prior.sample(jax.random.key(0), (5000,))).reshape(-1, size)
    np.testing.assert_allclose(draws.sum(axis=1), 1.0)
    entropy, expected = -log_prior(draws), -np.sum(weight * log_prior(uniform)) / weight.sum()
    assert entropy.mean() == pytest.approx(expected, abs=5.0 * entropy.std() / np.sqrt(15000))
    # A uniform draw says less: what is drawn is not that.
    assert entropy.mean() < -log_prior(uniform).mean() - 0.02
    whole = prior.log_prob(draws[:3])
    assert float(whole) == pytest.approx(np.sum(log_prior(draws[:3]) - log_normaliser(size)))


def test_probabilities_of_the_m_step_are_the_mode():
    random = np.random.default_rng(0)
    for trial in range(120):
        size = int(random.integers(2, 5))
        counts = random.gamma(0.5, 3.0 if trial % 2 else 60.0, size=size)
        counts = counts * (random.random(size) > 0.2)
        if counts.max() < 1e-3:
            continue
        theta, seen = entropic(counts[None])[0], counts > 0

        def height(p, counts=counts, seen=seen):
            return log_prior(p) + np.log(np.maximum(p[..., seen], 1e-300)) @ counts[seen]

        other = random.dirichlet(np.maximum(counts, 0.02) + 0.05, 2000) * seen
        other = np.concatenate([other, theta * np.exp(0.05 * random.normal(size=(200, size)))])
        other = other[other.sum(axis=1) > 0]
        other /= other.sum(axis=1, keepdims=True)
        assert height(other).max() <= height(theta) + 1e-6, counts


def test_rare_transitions_lose_most():
    theta = entropic(np.array([[50.0, 1.0], [0.0, 0.0]]))
    assert theta[0, 1] < 0.95 / 51.0
    assert theta[1].tolist() == [0.5, 0.5]
