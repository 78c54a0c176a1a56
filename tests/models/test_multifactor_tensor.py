"""The tensor with its core integrated out, against brute force and known truth."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bayesmotion.models.multifactor_tensor import (
    MultifactorTensor,
    log_marginal,
    main_effects,
    tensor_data,
)
from bayesmotion.models.tensor_classes import classes, log_density
from scipy.stats import invwishart, multivariate_normal

from bayesmotion.errors import InputError

LEVEL = np.array([(0, 0), (0, 1), (1, 0), (1, 1), (1, 1), (0, 1), (2, 0)])
COUNTS = (3, 2)


def small(seed: int = 0, q: int = 2):
    y = np.random.default_rng(seed).normal(size=(len(LEVEL), q))
    return tensor_data(y, LEVEL, COUNTS)


def test_marginal_equals_the_average_over_sigma_of_gaussians():
    """With Sigma drawn from its prior and the main effects taken out by contrasts."""
    data = small()
    log_odds, log_scale, log_dof = 0.4, 0.2, np.log(8.0)
    n, q = data.y.shape
    share = 1 / (1 + np.exp(-log_odds))
    K = share * data.same + (1 - share) * np.eye(n)
    # An orthonormal basis of what the main effects leave.
    contrasts = np.linalg.svd(data.design)[0][:, data.design.shape[1] :]
    z, Kz = contrasts.T @ data.y, contrasts.T @ K @ contrasts
    draws = invwishart.rvs(
        np.exp(log_dof) + q - 1, np.exp(log_scale) * np.eye(q), size=5000, random_state=1
    )
    logs = np.array(
        [multivariate_normal.logpdf(z.T.reshape(-1), cov=np.kron(S, Kz)) for S in draws]
    )
    top = logs.max()
    weight = np.exp(logs - top)
    expected = top + np.log(weight.mean())
    error = weight.std() / weight.mean() / np.sqrt(len(draws))
    found = float(log_marginal(data, log_odds, log_scale, log_dof))
    assert abs(found - expected) < 4 * error


def test_a_density_of_a_known_cell_is_the_ratio_of_two_marginals():
    data = small(3)
    values = {"log_odds": 0.3, "log_scale": -0.1, "log_dof": 1.5}
    new = np.array([[0.4, -0.7]])
    found = classes(data, LEVEL, COUNTS, **values)
    for cell in ((0, 1), (2, 1), (1, 0)):
        row = int(np.flatnonzero((found.level == cell).all(axis=1))[0])
        more = tensor_data(np.concatenate([data.y, new]), np.vstack([LEVEL, cell]), COUNTS)
        ratio = float(log_marginal(more, **values)) - float(log_marginal(data, **values))
        # The main effects are flat: take out the scale that contrasts add to each marginal.
        sizes = [np.linalg.slogdet(d.design.T @ d.design)[1] for d in (more, data)]
        ratio -= 0.5 * data.y.shape[1] * (sizes[0] - sizes[1])
        assert log_density(found, new)[0, row] == pytest.approx(ratio, abs=1e-6)


def test_gradient_is_that_of_finite_differences():
    data = small(5)

    both = jax.jit(jax.value_and_grad(lambda v: log_marginal(data, v[0], v[1], v[2])))

    def f(v):
        return both(v)[0]

    at = np.array([0.2, 0.1, 1.7])
    gradient = np.asarray(both(jnp.asarray(at))[1])
    for i in range(3):
        step = np.zeros(3)
        step[i] = 1e-5
        expected = float(f(at + step) - f(at - step)) / 2e-5
        assert gradient[i] == pytest.approx(expected, rel=1e-4)


def test_one_segment_a_cell_says_nothing_of_the_share():
    level = np.array([(i, j) for i in range(3) for j in range(3)])
    data = tensor_data(np.random.default_rng(0).normal(size=(9, 2)), level, (3, 3))
    marginal = jax.jit(log_marginal)
    values = [float(marginal(data, odds, 0.3, 2.0)) for odds in (-2.0, 0.0, 2.0)]
    np.testing.assert_allclose(values, values[0], atol=1e-6)
    repeated = small()
    values = [float(marginal(repeated, odds, 0.3, 2.0)) for odds in (-2.0, 2.0)]
    assert abs(values[0] - values[1]) > 0.1


def test_a_new_level_is_the_mean_of_the_known_ones_and_wider():
    data = small(7)
    found = classes(data, LEVEL, COUNTS, log_odds=0.0, log_scale=0.0, log_dof=2.0)
    rows = main_effects(np.array([(0, 0), (1, 0), (2, 0), (3, 0)]), COUNTS)
    np.testing.assert_allclose(rows[:3].mean(axis=0), rows[3])
    new = (found.level[:, 0] == 3) & (found.level[:, 1] < 2)
    known = [any((cell == seen).all() for seen in LEVEL) for cell in found.level]
    assert found.log_det[new].max() < found.log_det[known].min()


def test_the_program_has_the_density_of_its_parts():
    from numpyro.infer.util import log_density as of_program
    from scipy.stats import norm

    data = small()
    values = {"log_odds": 0.1, "log_scale": 0.4, "log_dof": 2.0}
    total = float(of_program(MultifactorTensor().program, (data,), {}, values)[0])
    priors = norm.logpdf(0.1) + norm.logpdf(0.4, 0, 3) + norm.logpdf(2.0, np.log(10), 1.5)
    assert total == pytest.approx(float(log_marginal(data, **values)) + priors)


def test_too_few_segments_are_refused():
    with pytest.raises(InputError, match="do not tell"):
        tensor_data(np.zeros((3, 2)), np.array([(0, 0), (1, 1), (2, 0)]), COUNTS)
    with pytest.raises(InputError, match="single level"):
        tensor_data(np.zeros((3, 2)), np.array([(0, 0), (1, 0), (1, 0)]), (2, 1))
