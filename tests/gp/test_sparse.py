"""Inducing points: with all of them the process is exact, with fewer the bound is below."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_normal

from bayesmotion.gp.kernels import linear, rbf
from bayesmotion.gp.matrix_normal import complete, patterns
from bayesmotion.gp.sparse import collapsed_bound, condition_sparse

BETA = 4.0


@pytest.fixture
def points():
    return {"x": np.random.default_rng(0).normal(size=(20, 3))}


@pytest.fixture
def y():
    """Of the second column some rows are missing."""
    made = np.random.default_rng(1).normal(size=(20, 2))
    made[[2, 3, 11], 1] = np.nan
    return made


def kernel():
    return rbf("x", length_scale=1.5, variance=2.0) + linear("x", variance=0.3)


def bound(points, some, y):
    return collapsed_bound(kernel(), points, some, jnp.array(BETA), y, patterns(~np.isnan(y)))


def exact(points, y):
    K = np.asarray(kernel().matrix(points, points)) + np.eye(20) / BETA
    for column in y.T:
        seen = np.flatnonzero(~np.isnan(column))
        yield multivariate_normal(np.zeros(len(seen)), K[np.ix_(seen, seen)]).logpdf(column[seen])


def test_all_points_as_inducing_points_are_exact(points, y):
    np.testing.assert_allclose(bound(points, points, y), [*exact(points, y)], rtol=1e-6)


def test_fewer_bound_it_from_below(points, y):
    bounds = []
    for count in (2, 8, 16):
        bounds.append(float(bound(points, {"x": points["x"][:count]}, y).sum()))
    assert bounds[0] < bounds[1] < bounds[2] < sum(exact(points, y))


def test_predictions_are_the_textbook_ones(points, y):
    new = {"x": np.random.default_rng(2).normal(size=(5, 3))}
    K = np.asarray(kernel().matrix(points, points)) + np.eye(20) / BETA
    own = np.diag(np.asarray(kernel().matrix(new, new)))
    missing = patterns(~np.isnan(y))
    mean, variance = condition_sparse(kernel(), points, points, jnp.array(BETA), y, missing)(new)
    for d, column in enumerate(y.T):
        seen = np.flatnonzero(~np.isnan(column))
        cross = np.asarray(kernel().matrix(new, points))[:, seen]
        gain = np.linalg.solve(K[np.ix_(seen, seen)], cross.T).T
        np.testing.assert_allclose(mean[:, d], gain @ column[seen], atol=1e-6)
        which = int(np.argmax(missing.columns[:, d]))
        expected = own - np.sum(gain * cross, axis=1)
        np.testing.assert_allclose(variance[which], expected, atol=1e-6)


def test_columns_without_missing_rows_share_one_variance(points, y):
    whole = np.nan_to_num(y)
    posterior = condition_sparse(
        kernel(), points, {"x": points["x"][:6]}, jnp.array(BETA), whole, complete(20, 2)
    )
    assert posterior(points)[1].shape == (1, 20)
