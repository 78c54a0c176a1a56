"""Leaving out is the same as conditioning on the rest, for entries and for blocks."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from bayesmotion.gp.leave_out import (
    leave_out_blocks,
    leave_out_each,
    leave_out_rows,
    normal_log_density,
)
from bayesmotion.gp.matrix_normal import patterns

N, D = 7, 4


@pytest.fixture(scope="module")
def problem():
    random = np.random.default_rng(5)
    A = random.normal(size=(N, N))
    K = A @ A.T + 0.5 * np.eye(N)
    y = random.normal(size=(N, D))
    seen = np.ones((N, D), bool)
    seen[1:3, 2] = False
    seen[6, 3] = False
    scale = np.array([0.5, 1.0, 2.0, 1.5])
    return y, K, scale, seen


def by_hand(y, K, w, rest, block):
    """Condition the entries `block` of one column on the entries `rest`."""
    gain = np.linalg.solve(K[np.ix_(rest, rest)], K[np.ix_(rest, block)]).T
    covariance = (K[np.ix_(block, block)] - gain @ K[np.ix_(rest, block)]) / w**2
    return gain @ y[rest], covariance


def rows_of(*blocks) -> np.ndarray:
    """Give the rows of each block as ones."""
    return np.stack([np.isin(np.arange(N), block).astype(float) for block in blocks])


def test_each_entry_left_out_is_conditioned_on_all_others_seen(problem):
    y, K, scale, seen = problem
    mean, variance = leave_out_each(np.where(seen, y, 0.0), K, scale, patterns(seen))
    for d in range(D):
        for i in np.flatnonzero(seen[:, d]):
            rest = np.setdiff1d(np.flatnonzero(seen[:, d]), [i])
            expected, covariance = by_hand(y[:, d], K, scale[d], rest, [i])
            np.testing.assert_allclose(mean[i, d], expected[0], rtol=1e-7)
            np.testing.assert_allclose(variance[i, d], covariance[0, 0], rtol=1e-7)


def test_a_block_left_out_is_conditioned_on_the_rest(problem):
    y, K, scale, seen = problem
    block = np.array([2, 3, 6])
    left = leave_out_blocks(
        np.where(seen, y, 0.0), K, scale, patterns(seen), rows_of([0, 5], block)
    )
    for d in range(D):
        rows = np.flatnonzero(seen[:, d])
        own = np.intersect1d(block, rows)
        expected, covariance = by_hand(y[:, d], K, scale[d], np.setdiff1d(rows, block), own)
        np.testing.assert_allclose(left.mean[1, own, d], expected, rtol=1e-7)
        np.testing.assert_allclose(left.variance[1, own, d], np.diagonal(covariance), rtol=1e-7)
        density = multivariate_normal.logpdf(y[own, d], expected, covariance)
        np.testing.assert_allclose(left.log_density[1, d], density, rtol=1e-7)


def test_a_block_of_one_row_is_an_entry(problem):
    y, K, scale, _ = problem
    whole = patterns(np.ones((N, D), bool))
    mean, variance = leave_out_each(y, K, scale, whole)
    left = leave_out_blocks(y, K, scale, whole, rows_of([4]))
    np.testing.assert_allclose(left.mean[0, 4], mean[4], rtol=1e-7)
    single = normal_log_density(y[4], mean[4], variance[4])
    np.testing.assert_allclose(left.log_density[0], single, rtol=1e-7)


def test_the_wrong_covariance_is_noticed(problem):
    y, K, scale, _ = problem
    whole = patterns(np.ones((N, D), bool))
    right, _ = leave_out_each(y, K, scale, whole)
    wrong, _ = leave_out_each(y, K + np.eye(N), scale, whole)
    assert np.abs(right - wrong).max() > 1e-3


def test_few_rows_left_out_are_blocks(problem):
    y, K, scale, seen = problem
    blocks = np.array([[0, 4], [1, 6], [2, 3]])
    arguments = (np.where(seen, y, 0.0), K, scale, patterns(seen))
    expected = leave_out_blocks(*arguments, rows_of(*blocks)).log_density
    np.testing.assert_allclose(leave_out_rows(*arguments, blocks), expected, rtol=1e-8)
    # Of a row that no column has seen nothing is said.
    nothing = np.where(np.arange(N)[:, None] == 2, False, seen)
    found = leave_out_rows(np.where(nothing, y, 0.0), K, scale, patterns(nothing), np.array([[2]]))
    np.testing.assert_allclose(found, 0.0, atol=1e-8)
