"""Series without their noise: intervals hold what is simulated, the noise is found, gaps filled."""

import numpy as np
import pytest

from bayesmotion.gp.gaps import smooth_series
from bayesmotion.gp.series import noise_sd

RATE, NOISE = 60.0, 0.05


@pytest.fixture(scope="module")
def simulated():
    """Give columns that follow four smooth paths, and the same with noise."""
    random = np.random.default_rng(3)
    time = np.arange(240) / RATE
    paths = []
    for length in (0.3, 0.2, 0.5, 0.15):
        K = np.exp(-0.5 * (np.subtract.outer(time, time) / length) ** 2)
        paths.append(np.linalg.cholesky(K + 1e-8 * np.eye(len(time))) @ random.normal(size=240))
    true = np.stack(paths, axis=1) @ random.normal(size=(4, 12)) * 0.3
    return true, true + NOISE * random.normal(size=true.shape)


def test_intervals_hold_as_much_as_they_say(simulated):
    true, noisy = simulated
    made = smooth_series(noisy, RATE, NOISE)
    for mean, sd in zip(made.mean, made.sd, strict=True):
        for share, z in ((0.5, 0.6745), (0.9, 1.6449)):
            # Columns are nearly independent, the frames of one are not.
            held = (np.abs(true - mean) <= z * sd).mean(axis=0)
            error = held.std(ddof=1) / np.sqrt(len(held))
            assert abs(held.mean() - share) < 4.0 * error + 0.01
    error = np.sqrt(np.mean((made.mean.mean(axis=0) - true) ** 2))
    assert error < 0.5 * NOISE


def test_the_noise_is_found_within_a_tenth(simulated):
    _, noisy = simulated
    found = noise_sd(noisy, np.ones(noisy.shape, bool), RATE)
    assert abs(found / NOISE - 1.0) < 0.1


def test_a_gap_is_filled_from_the_columns_that_are_seen(simulated):
    true, noisy = simulated
    gappy = noisy.copy()
    gap = slice(90, 150)
    gappy[gap, :2] = np.nan
    made = smooth_series(gappy, RATE, NOISE)
    mean, sd = made.mean.mean(axis=0), made.sd.mean(axis=0)
    off = (mean - true)[gap, :2]
    ends = [np.interp(np.arange(90, 150), [89, 150], true[[89, 150], c]) for c in range(2)]
    straight = np.stack(ends, axis=1) - true[gap, :2]
    assert np.sqrt(np.mean(off**2)) < 0.5 * np.sqrt(np.mean(straight**2))
    assert np.mean(np.abs(off) <= 1.6449 * sd[gap, :2]) > 0.8
    assert sd[gap, :2].mean() > sd[:80, :2].mean()
