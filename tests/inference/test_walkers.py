"""Ensembles against densities whose moments are known, several modes among them."""

import numpy as np
import pytest

from bayesmotion.errors import InputError, NumericalError
from bayesmotion.inference.sampling import walkers
from bayesmotion.inference.sampling.walkers import EnsembleRun, sample_ensemble

COVARIANCE = np.array([[2.0, 0.9, 0.0], [0.9, 1.0, -0.3], [0.0, -0.3, 0.5]])
MEAN = np.array([1.0, -2.0, 3.0])


def gaussian(x):
    centred = x - MEAN
    return -0.5 * np.einsum("wi,ij,wj->w", centred, np.linalg.inv(COVARIANCE), centred)


def scattered(count: int, n: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, n))


def test_moments_of_a_gaussian_within_monte_carlo_error():
    found = sample_ensemble(gaussian, scattered(20, 3), warmup=300, steps=2000, seed=2)
    assert found.values.shape == (2000, 20, 3)
    assert found.trusted
    assert 0.2 < found.acceptance < 0.8
    error = np.sqrt(np.diag(COVARIANCE) / found.ess)
    flat = found.values.reshape(-1, 3)
    assert np.all(np.abs(flat.mean(axis=0) - MEAN) < 4.0 * error)
    # A variance's relative standard error is about sqrt(2 / ESS); its own tau is like the mean's.
    assert np.all(
        np.abs(flat.var(axis=0) / np.diag(COVARIANCE) - 1.0) < 4.0 * np.sqrt(3.0 / found.ess)
    )
    np.testing.assert_allclose(found.log_density, gaussian(flat).reshape(2000, 20))


def test_walkers_are_worth_less_than_their_number():
    found = sample_ensemble(gaussian, scattered(20, 3), warmup=300, steps=2000, seed=2)
    assert np.all(found.ess < 0.5 * 2000 * 20)
    assert np.all(found.autocorrelation > 2.0)


def test_draws_come_from_all_walkers_and_from_steps_far_apart():
    found = sample_ensemble(gaussian, scattered(8, 3), warmup=0, steps=100, seed=2)
    step, walker = np.divmod(found.places(40), 8)
    np.testing.assert_array_equal(np.unique(step), [0, 25, 50, 74, 99])
    np.testing.assert_array_equal(np.bincount(walker), 5)
    assert found.draws(33).shape == (33, 3)
    assert len(set(found.places(800))) == 800


def test_modes_are_weighed():
    """Two modes, ten standard deviations apart, of weights 1 to 3."""

    def modes(x):
        first = -0.5 * np.sum((x + 5.0) ** 2, axis=1)
        second = -0.5 * np.sum((x - 5.0) ** 2, axis=1)
        return np.logaddexp(first + np.log(0.25), second + np.log(0.75))

    starts = scattered(40, 2) + np.where(np.arange(40) % 2, 5.0, -5.0)[:, None]
    found = sample_ensemble(modes, starts, warmup=500, steps=4000, seed=5)
    share = np.mean(found.values[..., 0] > 0.0)
    error = np.sqrt(0.25 * 0.75 / found.ess.min())
    assert abs(share - 0.75) < 4.0 * error
    assert 4.0 * error < 0.2


def test_equal_seeds_give_equal_draws_and_a_run_goes_on_where_it_stood():
    whole = sample_ensemble(gaussian, scattered(8, 3), warmup=0, steps=30, seed=7)
    other = sample_ensemble(gaussian, scattered(8, 3), warmup=0, steps=30, seed=8)
    assert not np.array_equal(whole.values, other.values)
    run = EnsembleRun(gaussian, (8, 3))
    state = run.begin(scattered(8, 3), 7)
    state, _ = run.advance(state, 10)
    # Through arrays, as a checkpoint keeps it, and with a sampler of its own.
    kept = walkers.random_state(walkers.random_arrays(state.random))
    state, run = state._replace(random=kept), EnsembleRun(gaussian, (8, 3))
    state, steps = run.advance(state, 20)
    np.testing.assert_array_equal(steps.values, whole.values[10:])
    np.testing.assert_array_equal(state.walkers, whole.values[-1])


def test_a_chain_that_stands_still_is_worth_nothing():
    still = np.repeat(scattered(6, 2)[None], 50, axis=0)
    assert np.all(np.isinf(walkers.autocorrelation_time(still)))


def test_what_cannot_be_sampled_gets_a_sentence():
    with pytest.raises(InputError, match="61 unknowns"):
        EnsembleRun(gaussian, (200, 61))
    with pytest.raises(InputError, match="5 walkers for 3"):
        EnsembleRun(gaussian, (5, 3))
    with pytest.raises(NumericalError, match="6 of 6 starts"):
        sample_ensemble(
            lambda x: np.full(len(x), np.nan), scattered(6, 3), warmup=1, steps=1, seed=0
        )
