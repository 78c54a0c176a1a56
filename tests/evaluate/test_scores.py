"""Scores of forecasts against their definitions, by quadrature and by draws."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from bayesmotion.prediction import Mixture, score, stacked

Y = np.array([[0.3, -1.0], [2.0, 0.1], [0.0, 0.0]])


@pytest.fixture(scope="module")
def mixture():
    random = np.random.default_rng(0)
    weight = np.array([0.2, 0.5, 0.3])
    return Mixture(random.normal(size=(3, 3, 2)), random.uniform(0.3, 2.0, (3, 3, 2)), weight)


def test_the_crps_is_the_integral_of_its_definition(mixture):
    found = mixture.crps(Y)
    for n in range(3):
        for d in range(2):

            def squared(x, n=n, d=d):
                at = np.full((3, 2), x)
                return (mixture.probability(at)[n, d] - (x >= Y[n, d])) ** 2

            expected = quad(squared, -12, Y[n, d])[0] + quad(squared, Y[n, d], 12)[0]
            np.testing.assert_allclose(found[n, d], expected, rtol=1e-6)


def test_mean_spread_and_density_are_those_of_draws(mixture):
    random = np.random.default_rng(1)
    which = random.choice(3, p=mixture.weight, size=200_000)
    draws = random.normal(mixture.mean[which, 1, 0], mixture.sd[which, 1, 0])
    error = draws.std() / np.sqrt(len(draws))
    assert abs(draws.mean() - mixture.means()[1, 0]) < 4 * error
    np.testing.assert_allclose(draws.std(), mixture.sds()[1, 0], rtol=0.01)
    density = sum(
        w * norm.pdf(Y[1, 0], m, s)
        for w, m, s in zip(mixture.weight, mixture.mean[:, 1, 0], mixture.sd[:, 1, 0], strict=True)
    )
    np.testing.assert_allclose(mixture.log_density(Y)[1, 0], np.log(density), rtol=1e-12)


def test_copies_of_one_draw_are_one_draw():
    one = Mixture(np.zeros((1, 3, 2)), np.ones((1, 3, 2)), np.ones(1))
    both = stacked([one, one], np.array([0.25, 0.75]))
    np.testing.assert_allclose(both.crps(Y), one.crps(Y), rtol=1e-12)
    np.testing.assert_allclose(both.sds(), one.sds(), rtol=1e-12)
    found, expected = score(both, Y), score(one, Y)
    assert found.coverage == expected.coverage
    for name in ("error", "crps", "log_score"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name))


def test_intervals_hold_as_often_as_they_say_and_narrow_ones_do_not():
    random = np.random.default_rng(2)
    true = random.normal(size=(400, 10))
    honest = Mixture(np.zeros((1, 400, 10)), np.ones((1, 400, 10)), np.ones(1))
    narrow = Mixture(honest.mean, 0.5 * honest.sd, honest.weight)
    error = np.sqrt(0.09 / true.size)
    assert abs(score(honest, true).coverage90 - 0.9) < 4 * error
    assert score(narrow, true).coverage90 < 0.7
    assert score(narrow, true).crps > score(honest, true).crps
    assert score(narrow, true).log_score < score(honest, true).log_score
