"""Entropic chains: the prior's mode, the recursions against sums over all paths, learning."""

from itertools import pairwise, product

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from bayesmotion.models.entropic_hmm import (
    HMM,
    entropic,
    learn,
    log_emissions,
    log_entropic,
    posterior_states,
)


@pytest.mark.parametrize(
    "counts",
    [[3.0, 8.0, 1.0], [100.0, 2.0, 0.5], [0.5, 0.2, 0.1], [0.3, 0.3], [5.0, 5.0], [4.0, 0.0, 3.0]],
)
def test_entropic_probabilities_are_the_mode(counts):
    counts = np.array(counts)
    theta = entropic(np.array([counts, np.ones(len(counts))]))[0]
    assert theta.sum() == pytest.approx(1.0)

    def height(p):
        seen = counts > 0
        return np.sum(counts[seen] * np.log(p[seen])) + log_entropic(p)

    random = np.random.default_rng(0)
    for _ in range(200):
        other = theta * np.exp(0.05 * random.normal(size=len(theta)))
        assert height(other / other.sum()) <= height(theta) + 1e-9
    wild = random.dirichlet(np.ones(len(counts)), 500)
    assert max(height(p) for p in np.maximum(wild, 1e-12)) <= height(theta) + 1e-6


def test_rare_transitions_lose_most():
    theta = entropic(np.array([[50.0, 1.0], [0.0, 0.0]]))
    assert theta[0, 1] < 0.95 / 51.0
    assert theta[1].tolist() == [0.5, 0.5]


@pytest.fixture
def chain():
    random = np.random.default_rng(1)
    roots = random.normal(size=(2, 2, 2))
    covariance = roots @ roots.transpose(0, 2, 1) + np.eye(2)
    transition = np.array([[0.8, 0.2], [0.3, 0.7]])
    return HMM(np.array([0.6, 0.4]), transition, random.normal(size=(2, 2)), covariance)


def test_recursions_against_all_paths(chain):
    o = np.random.default_rng(2).normal(size=(4, 2))
    emission = log_emissions(chain.mean, chain.covariance, o)
    for k in range(2):
        normal = multivariate_normal(chain.mean[k], chain.covariance[k])
        np.testing.assert_allclose(emission[:, k], normal.logpdf(o))
    total, states, moves = 0.0, np.zeros((4, 2)), np.zeros((2, 2))
    for path in product(range(2), repeat=4):
        p = chain.initial[path[0]] * np.exp(sum(emission[t, s] for t, s in enumerate(path)))
        p *= np.prod([chain.transition[a, b] for a, b in pairwise(path)])
        total += p
        for t, s in enumerate(path):
            states[t, s] += p
        for a, b in pairwise(path):
            moves[a, b] += p
    found = posterior_states(chain.initial, chain.transition, emission)
    np.testing.assert_allclose(found[0], states / total)
    np.testing.assert_allclose(found[1], moves / total)
    assert found[2] == pytest.approx(np.log(total))


def test_learning_climbs_and_finds_the_chain():
    random = np.random.default_rng(3)
    mean = np.array([[-3.0, 0.0], [0.0, 3.0], [3.0, 0.0]])
    transition = np.array([[0.9, 0.1, 0.0], [0.0, 0.9, 0.1], [0.1, 0.0, 0.9]])
    clips = []
    for _ in range(6):
        state, path = 0, []
        for _ in range(80):
            path.append(state)
            state = random.choice(3, p=transition[state])
        clips.append(mean[path] + 0.5 * random.normal(size=(80, 2)))
    learned = learn(clips, 3, seed=0)
    assert (np.diff(learned.log_posterior) > -1e-6).all()
    order = np.argsort(learned.hmm.mean[:, 0])
    np.testing.assert_allclose(learned.hmm.mean[order], mean, atol=0.15)
    found = learned.hmm.transition[np.ix_(order, order)]
    np.testing.assert_allclose(found, transition, atol=0.06)
    # What does not happen dies out.
    assert found[0, 2] < 1e-4
