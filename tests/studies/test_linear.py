"""Linear forecasts go on as training clips say, and hold the pose where none is long enough."""

import numpy as np
import pytest

from bayesmotion.studies.boards.baselines import hold
from bayesmotion.studies.boards.linear import autoregression, ridge

PERIOD, CONTEXT, HORIZON = 20.0, 12, 15


def wave(phase, frames=80):
    """A vector that turns, without noise: any frame follows from the two before it."""
    theta = phase + 2 * np.pi * np.arange(frames) / PERIOD
    return np.stack([3.0 + np.cos(theta), np.sin(theta), -1.0 + 2.0 * np.cos(theta)], axis=1)


TRAIN = {f"train {i}": wave(float(i)) for i in range(4)}


@pytest.mark.parametrize("forecast", [autoregression, ridge])
def test_what_the_training_clips_say_exactly_is_forecast(forecast):
    clip = wave(0.4)
    told = forecast(TRAIN, clip[:CONTEXT], HORIZON)
    error = np.abs(told - clip[CONTEXT : CONTEXT + HORIZON]).max()
    held = np.abs(hold(TRAIN, clip[:CONTEXT], HORIZON) - clip[CONTEXT : CONTEXT + HORIZON]).max()
    assert told.shape == (HORIZON, 3)
    assert error < 0.15
    assert held > 1.0


def test_a_horizon_longer_than_any_clip_holds_the_pose():
    context = wave(0.4)[:CONTEXT]
    np.testing.assert_array_equal(ridge(TRAIN, context, 100), np.repeat(context[-1:], 100, axis=0))


def test_a_longer_horizon_begins_as_a_shorter_one():
    context = wave(0.4)[:CONTEXT]
    np.testing.assert_allclose(
        autoregression(TRAIN, context, HORIZON)[:5], autoregression(TRAIN, context, 5), rtol=1e-12
    )
