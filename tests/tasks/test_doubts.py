"""What is not to be believed of a forecast is said, in a line each; nothing is, of a good one."""

import warnings

import numpy as np
import pytest

from bayesmotion.errors import MotionWarning
from bayesmotion.inference.modes import trained_model
from bayesmotion.model import TellsNovelty
from bayesmotion.motion import split
from bayesmotion.motion.synthetic.walkers import synthetic_walkers
from bayesmotion.tasks.forecast import bending, doubts, forecast, sinking

CONTEXT, HORIZON = 20, 16


@pytest.fixture(scope="module")
def clip():
    other = synthetic_walkers(
        gaits=("walk", "run"), seconds=2.0, frame_rate=20.0, noise=0.01, seed=5
    )
    walk = split(other)["ann-walk"]
    return walk.assign_coords(clip=("frame", ["new"] * walk.sizes["frame"]))


@pytest.fixture(scope="module")
def good(circle_fit, clip):
    """A forecast of a clip like a training clip; of that nothing is to be said."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", MotionWarning)
        # That is said of the fit, which is short.
        warnings.filterwarnings("ignore", "the forecast: the fit has not converged")
        return forecast(circle_fit, clip, context=CONTEXT, horizon=HORIZON)


def novelty(fit, good, **changed):
    assert isinstance(fit.model, TellsNovelty)
    (frames,) = good.prediction.data.data
    # As in the forecast, for which it was compiled.
    trained = trained_model(fit.model, *fit.training.data, fit.values())
    return fit.model.novelty(trained, frames, {**good.values, **changed})


def doubts_of(fit, good, mean, motion):
    return doubts(fit.model, fit.training, good.prediction, mean[CONTEXT:], motion, CONTEXT)


def test_a_pace_no_training_clip_has(circle_fit, good):
    assert novelty(circle_fit, good) == []
    (line,) = novelty(circle_fit, good, step=2.0 * circle_fit.values()["step"].max()[None])
    assert "pace of" in line
    assert "cycles a second lies outside" in line


def test_a_style_like_none_and_one_too_large(circle_fit, good):
    style = good.values["style_gait"]
    (line,) = novelty(circle_fit, good, style_gait=-style)
    assert "unlike that of every training clip" in line
    (line,) = novelty(circle_fit, good, style_gait=10.0 * style)
    assert "times as long" in line


def test_a_body_that_sinks_through_the_floor(circle_fit, good):
    sunk = good.motion.copy(deep=True)
    sunk["root_position"].values[CONTEXT:, 1] -= 0.5
    (line,) = sinking(sunk, CONTEXT)
    assert "below where the context frames stood" in line
    assert list(sinking(good.motion, CONTEXT)) == []
    told = doubts_of(circle_fit, good, good.mean, sunk)
    assert told == [line]


def test_joints_that_bend_as_in_no_training_clip(circle_fit, good):
    bent = good.mean.copy()
    labels = circle_fit.training.encoding.layout.labels
    bent[CONTEXT + 3, labels.index("ltibia/rx")] -= 4.0
    (line,) = bending(circle_fit.training, bent[CONTEXT:])
    assert line.count("rad") == 1
    assert "ltibia/rx" in line
    # What was bent in the context is not the forecast's.
    bent = good.mean.copy()
    bent[CONTEXT - 3] -= 4.0
    assert doubts_of(circle_fit, good, bent, good.motion) == []
    assert np.isfinite(good.mean).all()
