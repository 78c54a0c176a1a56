"""Matern processes in time: equal to the dense Gaussian process, with gaps too."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bayesmotion.gp.coupled_filter import smooth_coupled
from bayesmotion.gp.state_space import StateSpace, columns, log_density, matern, smooth

FRAMES = 40
# Order, length scale in frames, sd: quick and slow, below and far above the noise.
PROCESSES = [(1, 12.0, 50.0), (2, 60.0, 800.0), (2, 6.0, 0.5)]


def dense(order, length, sd, n=FRAMES):
    """Return the covariance of n frames."""
    d = np.abs(np.subtract.outer(np.arange(n), np.arange(n))) * np.sqrt(2 * order + 1) / length
    return sd**2 * np.exp(-d) * (1.0 + d if order == 1 else 1.0 + d + d**2 / 3.0)


def conditioned(K, y, seen):
    """Return mean and variance of f with covariance K, and the log density of what is seen."""
    S = K[np.ix_(seen, seen)] + np.eye(seen.sum())
    gain = np.linalg.solve(S, K[seen]).T
    log = -0.5 * (np.linalg.slogdet(S)[1] + y[seen] @ np.linalg.solve(S, y[seen]))
    return gain @ y[seen], np.diag(K - gain @ K[seen]), log


@pytest.fixture(scope="module")
def gappy():
    """Give columns that mix the processes, what is seen of them, and the mixing."""
    random = np.random.default_rng(0)
    jitter = 1e-8 * np.eye(FRAMES)
    f = np.stack(
        [np.linalg.cholesky(dense(*one) + jitter) @ random.normal(size=FRAMES)
         for one in PROCESSES], axis=1,
    )  # fmt: skip
    mixing = np.linalg.qr(random.normal(size=(3, 3)))[0]
    y = f @ mixing + random.normal(size=f.shape)
    seen = random.uniform(size=y.shape) > 0.2
    seen[15:28, 0] = False
    return np.where(seen, y, np.nan), seen, mixing


@pytest.mark.parametrize("process", PROCESSES)
def test_columns_with_gaps_are_smoothed_as_by_the_dense_process(gappy, process):
    y, seen, _ = gappy
    data = columns(y, seen)
    mean, variance = smooth(matern(*process, 3), data)
    log = np.asarray(log_density(matern(*process, 3), data))
    for c in range(3):
        m, v, density = conditioned(dense(*process), y[:, c], seen[:, c])
        assert_allclose(mean[:, c], m, atol=1e-5)
        assert_allclose(variance[:, data.which[c]], v, rtol=1e-5)
        assert_allclose(log[c], density, rtol=1e-6)


def test_mixed_columns_with_gaps_are_smoothed_as_by_the_dense_process(gappy):
    y, seen, mixing = gappy
    each = [matern(*one, 3) for one in PROCESSES]
    together = StateSpace(*(np.stack(part) for part in zip(*each, strict=True)))
    mean, variance = smooth_coupled(together, mixing, np.where(seen, y, 0.0), seen.astype(float))
    K = sum(
        np.kron(dense(*one), np.outer(row, row)) for one, row in zip(PROCESSES, mixing, strict=True)
    )
    m, v, _ = conditioned(K, y.ravel(), seen.ravel())
    assert_allclose(np.ravel(mean), m, atol=1e-4)
    assert_allclose(np.ravel(variance), v, rtol=1e-4)


def test_a_process_far_slower_than_a_frame_keeps_its_digits():
    process = matern(2, 1e4, 1.0, 3)
    step = np.sqrt(5.0) / 1e4
    # To leading order q (lambda dt)^5 / 20 for an integrated integrated Brownian motion, q = 16/3.
    assert_allclose(process.innovation[0, 0], 16.0 / 3.0 * step**5 / 20.0, rtol=1e-3)
    assert np.all(np.linalg.eigvalsh(process.innovation) > -1e-20)
