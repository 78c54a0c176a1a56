"""Scales integrated out: against quadrature over each scale, with missing entries."""

import jax
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import halfnorm, kstest, multivariate_normal, t

from bayesmotion.gp.collapsed import CollapsedProcess, draw_scale
from bayesmotion.gp.matrix_normal import patterns


@pytest.fixture(scope="module")
def problem():
    random = np.random.default_rng(5)
    root = random.normal(size=(5, 5))
    K = root @ root.T + 0.5 * np.eye(5)
    y = 2.0 * random.normal(size=(5, 3))
    y[1:3, 1] = np.nan
    y[:, 2] = np.nan
    return K, y


def test_the_density_is_the_integral_over_the_scales(problem):
    K, y = problem
    seen = np.isfinite(y)
    expected = 0.0
    for d in range(2):
        rows = seen[:, d]
        own, column = K[np.ix_(rows, rows)], y[rows, d]
        normal = multivariate_normal(np.zeros(len(own)), own)

        def joint(w, normal=normal, column=column):
            return np.exp(normal.logpdf(column * w)) * w ** len(column) * halfnorm.pdf(w)

        expected += np.log(quad(joint, 0, 8)[0])
    process = CollapsedProcess(K, 3, patterns(seen))
    np.testing.assert_allclose(process.log_prob(np.where(seen, y, 0.0)), expected, rtol=1e-6)


def test_the_gradient_is_that_of_finite_differences(problem):
    K, y = problem
    seen = np.isfinite(y)
    filled, missing = np.where(seen, y, 0.0), patterns(seen)

    def density(K):
        return CollapsedProcess(K, 3, missing).log_prob(filled)

    step = np.zeros((5, 5))
    step[1, 3] = step[3, 1] = 1e-5
    slope = (density(K + step) - density(K - step)) / 2e-5
    gradient = jax.grad(density)(K)
    np.testing.assert_allclose(gradient[1, 3] + gradient[3, 1], slope, rtol=1e-6)


def test_draws_are_cauchy_in_every_entry(problem):
    K, _ = problem
    draws = np.asarray(CollapsedProcess(K, 2).sample(jax.random.key(0), (3000,)))
    assert draws.shape == (3000, 5, 2)
    for row, column in ((0, 0), (3, 1)):
        standard = draws[:, row, column] / np.sqrt(K[row, row])
        assert kstest(standard, t(1).cdf).pvalue > 1e-3


def test_a_column_nothing_is_seen_of_has_the_prior_scale(problem):
    K, y = problem
    seen = np.isfinite(y)
    keys = jax.random.split(jax.random.key(1), 2000)
    filled = np.where(seen, y, 0.0)
    draws = jax.vmap(lambda key: draw_scale(key, filled, K, patterns(seen)))(keys)
    assert kstest(np.asarray(draws[:, 2]), halfnorm.cdf).pvalue > 1e-3
