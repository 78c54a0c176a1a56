"""Inducing points: with all of them the process is exact, with fewer the bound is below."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_normal

from bayesmotion.gp.kernels import linear, rbf
from bayesmotion.gp.sparse import SparseProcess, explain, explain_exactly

BETA = 4.0


@pytest.fixture
def points():
    return {"x": np.random.default_rng(0).normal(size=(20, 3))}


@pytest.fixture
def y():
    return np.random.default_rng(1).normal(size=(20, 2))


def kernel():
    return rbf("x", length_scale=1.5, variance=2.0) + linear("x", variance=0.3)


def test_all_points_as_inducing_points_are_exact(points, y):
    process = SparseProcess(kernel(), points, points, jnp.array(BETA), y.shape)
    K = np.asarray(kernel().matrix(points, points)) + np.eye(20) / BETA
    exact = [multivariate_normal(np.zeros(20), K).logpdf(column) for column in y.T]
    np.testing.assert_allclose(process.log_prob_parts(y), exact, rtol=1e-6)
    assert float(process.log_prob(y)) == pytest.approx(sum(exact), rel=1e-6)


def test_fewer_bound_it_from_below(points, y):
    exact = float(SparseProcess(kernel(), points, points, jnp.array(BETA), y.shape).log_prob(y))
    bounds = []
    for count in (2, 8, 16):
        some = {"x": points["x"][:count]}
        bounds.append(
            float(SparseProcess(kernel(), points, some, jnp.array(BETA), y.shape).log_prob(y))
        )
    assert bounds[0] < bounds[1] < bounds[2] < exact


def test_predictions_are_the_textbook_ones(points, y):
    new = {"x": np.random.default_rng(2).normal(size=(5, 3))}
    K = np.asarray(kernel().matrix(points, points)) + np.eye(20) / BETA
    cross = np.asarray(kernel().matrix(new, points))
    own = np.diag(np.asarray(kernel().matrix(new, new)))
    mean = cross @ np.linalg.solve(K, y)
    variance = own - np.sum(cross * np.linalg.solve(K, cross.T).T, axis=1)
    for explained in (
        explain(kernel(), points, points, jnp.array(BETA), y),
        explain_exactly(kernel(), points, jnp.array(BETA), y),
    ):
        found = explained(new)
        np.testing.assert_allclose(found[0], mean, atol=1e-6)
        np.testing.assert_allclose(found[1], variance, atol=1e-6)


def test_draws_have_the_covariance(points):
    some = {"x": points["x"][:6]}
    process = SparseProcess(kernel(), points, some, jnp.array(BETA), (20, 1))
    draws = np.asarray(process.sample(jax.random.key(0), (20000,)))[..., 0]
    cross, inner = kernel().matrix(points, some), kernel().matrix(some, some)
    Q = np.asarray(cross @ jnp.linalg.solve(inner, cross.T)) + np.eye(20) / BETA
    spread = np.sqrt((np.outer(np.diag(Q), np.diag(Q)) + Q**2) / len(draws))
    assert (np.abs(np.cov(draws.T) - Q) < 5.0 * spread).all()
