"""Smoothing against the joint Gaussian, and on paths that are known."""

import numpy as np
import pytest

from bayesmotion.studies.voxel.smooth import LENGTHS, likeliest_length, smooth


def matern(time: np.ndarray, length: float) -> np.ndarray:
    r = np.sqrt(5) * np.abs(time[:, None] - time) / length
    return (1 + r + r**2 / 3) * np.exp(-r)


@pytest.fixture(scope="module")
def paths():
    random = np.random.default_rng(0)
    time = np.tile(np.arange(30) / 15.0, 2)
    clip = np.repeat([0, 1], 30)
    L = np.linalg.cholesky(matern(time[:30], 0.4) + 1e-9 * np.eye(30))
    true = np.concatenate([L @ random.standard_normal((30, 3)) for _ in range(2)])
    return time, clip, true


def test_the_mean_is_that_of_the_joint_gaussian(paths):
    time, clip, true = paths
    random = np.random.default_rng(1)
    variance = random.uniform(0.1, 0.5, true.shape)
    z = true + np.sqrt(variance) * random.standard_normal(true.shape)
    mean, left = smooth(z, variance, time, clip, 0.4)
    K = matern(time[:30], 0.4)
    for p in range(3):
        G = K @ np.linalg.inv(K + np.diag(variance[30:, p]))
        np.testing.assert_allclose(mean[30:, p], G @ z[30:, p], atol=1e-7)
        np.testing.assert_allclose(left[30:, p], np.diag(K - G @ K), atol=1e-7)
    assert ((mean - true) ** 2).mean() < 0.6 * ((z - true) ** 2).mean()
    held = np.abs(mean - true) < 1.645 * np.sqrt(left)
    assert 0.8 < held.mean() < 0.97


def test_the_length_is_found(paths):
    time, clip, true = paths
    assert likeliest_length(true, time, clip) == 0.4
    assert 0.4 in LENGTHS
    rough = np.random.default_rng(2).standard_normal(true.shape)
    assert likeliest_length(rough, time, clip) == LENGTHS[0]
