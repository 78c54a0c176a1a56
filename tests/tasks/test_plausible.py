"""What is not to be believed of a forecast is said, in a line each; nothing is, of a good one."""

import warnings

import numpy as np
import pytest

from bayesmotion.errors import MotionWarning
from bayesmotion.motion import split
from bayesmotion.motion.synthetic import synthetic_walkers
from bayesmotion.tasks.forecast import forecast, new_clip
from bayesmotion.tasks.plausible import warn_of_forecast

GIVEN, HORIZON = 20, 16


@pytest.fixture(scope="module")
def clip():
    other = synthetic_walkers(
        gaits=("walk", "run"), seconds=2.0, frame_rate=20.0, noise=0.01, seed=0
    )
    return split(other)["ann-walk"]


@pytest.fixture(scope="module")
def good(circle_fit, clip):
    """A forecast of a clip like a training clip; it warns of nothing."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", MotionWarning)
        return forecast(circle_fit, clip, given=GIVEN, horizon=HORIZON)


def told(fit, clip, good, *, values=None, mean=None, motion=None):
    seen = new_clip(fit, clip, given=GIVEN, horizon=HORIZON).seen
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warn_of_forecast(
            fit,
            seen,
            good.values if values is None else values,
            good.mean if mean is None else mean,
            good.motion if motion is None else motion,
            GIVEN,
        )
    assert all(one.category is MotionWarning for one in caught)
    return [str(one.message) for one in caught]


def test_a_pace_no_training_clip_has(circle_fit, clip, good):
    fast = good.values | {"step": 2.0 * circle_fit.values()["step"].max()[None]}
    (line,) = told(circle_fit, clip, good, values=fast)
    assert "pace of" in line
    assert "cycles a second lies outside" in line


def test_a_style_like_none_and_one_too_large(circle_fit, clip, good):
    upside_down = good.values | {"style_gait": -good.values["style_gait"]}
    (line,) = told(circle_fit, clip, good, values=upside_down)
    assert "unlike that of every training clip" in line
    large = good.values | {"style_gait": 10.0 * good.values["style_gait"]}
    (line,) = told(circle_fit, clip, good, values=large)
    assert "times as long" in line


def test_a_body_that_sinks_through_the_floor(circle_fit, clip, good):
    sunk = good.motion.copy(deep=True)
    sunk["root_position"].values[GIVEN:, 1] -= 0.5
    (line,) = told(circle_fit, clip, good, motion=sunk)
    assert "sinks" in line
    assert "below where the frames given stood" in line


def test_joints_that_bend_as_in_no_training_clip(circle_fit, clip, good):
    bent = good.mean.copy()
    labels = circle_fit.training.encoding.layout.labels
    bent[GIVEN + 3, labels.index("ltibia/rx")] -= 4.0
    (line,) = told(circle_fit, clip, good, mean=bent)
    assert line.count("rad") == 1
    assert "ltibia/rx" in line
    # What was bent in the frames given is not the forecast's.
    bent = good.mean.copy()
    bent[GIVEN - 3] -= 4.0
    assert told(circle_fit, clip, good, mean=bent) == []
    assert np.isfinite(good.mean).all()
