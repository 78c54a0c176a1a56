"""Forecasts: better than plain ones, blind to the future, on any trained model."""

import warnings

import numpy as np
import pytest

from bayesmotion.errors import InputError, MotionWarning
from bayesmotion.inference.map import fit_map
from bayesmotion.models.factors import SUBJECT_AND_GAIT
from bayesmotion.models.multifactor import Multifactor
from bayesmotion.motion import downsample, split
from bayesmotion.motion.synthetic import synthetic_truth
from bayesmotion.tasks import baselines
from bayesmotion.tasks.forecast import angle_error, forecast, truth

GIVEN, HORIZON = 16, 20


@pytest.fixture(scope="module")
def unseen():
    """The clip that was left out of the training, without noise."""
    known = synthetic_truth(gaits=("walk", "run"), seconds=2.0, frame_rate=20.0)
    return known.cell("ben", "run")


def mean_error(fit, clip, predicted):
    true = truth(fit, clip, predicted.given, predicted.horizon)
    angles = fit.training.encoding.n_angles
    return angle_error(predicted.mean[predicted.given :], true, angles).mean()


def test_an_unrecorded_cell_is_forecast_better_than_by_holding_the_pose(circle_fit, unseen):
    predicted = forecast(circle_fit, unseen, given=GIVEN, horizon=HORIZON)
    encoding = circle_fit.training.encoding
    features = encoding.features(unseen, 0.0)
    held = baselines.hold(features[:GIVEN], HORIZON)
    true = features[GIVEN : GIVEN + HORIZON]
    plain = angle_error(held, true, encoding.n_angles).mean()
    assert mean_error(circle_fit, unseen, predicted) < 0.5 * plain
    assert predicted.motion.sizes["frame"] == GIVEN + HORIZON
    assert np.all(predicted.sd > 0)


def test_a_forecast_does_not_look_at_the_future(circle_fit, unseen):
    short = unseen.isel(frame=slice(GIVEN))
    whole = forecast(circle_fit, unseen, given=GIVEN, horizon=5)
    blind = forecast(circle_fit, short, given=GIVEN, horizon=5)
    np.testing.assert_array_equal(whole.mean, blind.mean)


def test_uncertainty_grows_away_from_the_frames_given(circle_fit, unseen):
    predicted = forecast(circle_fit, unseen, given=GIVEN, horizon=HORIZON)
    angles = circle_fit.training.encoding.n_angles
    near, far = predicted.sd[GIVEN, :angles], predicted.sd[GIVEN + 8, :angles]
    assert np.all(far > near)


def test_a_known_label_is_used(circle_fit, unseen):
    known = forecast(
        circle_fit, unseen, given=GIVEN, horizon=5, labels={"subject": "ben", "gait": "run"}
    )
    assert "style_subject" not in known.values
    assert "style_gait" not in known.values


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"given": 1, "horizon": 5}, "at least 2 frames"),
        ({"given": 400, "horizon": 5}, "the clip has 40"),
        ({"given": 10, "horizon": 0}, "at least 1"),
        ({"given": 10, "horizon": 5, "labels": {"gait": "fly"}}, "'fly' is not in the training"),
    ],
)
def test_bad_questions_get_a_sentence(circle_fit, unseen, settings, said):
    with pytest.raises(InputError, match=said):
        forecast(circle_fit, unseen, **settings)


def test_another_frame_rate_is_refused(circle_fit, unseen):
    with pytest.raises(InputError, match="10 frames a second"):
        forecast(circle_fit, downsample(unseen, 2), given=8, horizon=5)


@pytest.mark.parametrize(("dynamics", "factors"), [("gp", SUBJECT_AND_GAIT), ("balanced", ())])
def test_paths_with_gaussian_process_dynamics_go_on(walkers, unseen, dynamics, factors):
    model = Multifactor(dynamics, factors=factors)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MotionWarning)
        fit = fit_map(model, walkers, starts=1, keep=1, max_steps=20)
    predicted = forecast(fit, unseen, given=GIVEN, horizon=6, max_steps=40)
    assert predicted.mean.shape[0] == GIVEN + 6
    assert predicted.values["x"].shape == (GIVEN, 3)
    assert np.all(np.isfinite(predicted.mean))
    moved = np.abs(np.diff(predicted.mean[GIVEN - 1 :, :10], axis=0)).max(axis=1)
    assert np.all(moved > 0)


def test_plain_forecasts():
    y = np.arange(12.0).reshape(6, 2)
    np.testing.assert_array_equal(baselines.hold(y, 2), [[10.0, 11.0]] * 2)
    np.testing.assert_array_equal(baselines.constant_velocity(y, 2), [[12.0, 13.0], [14.0, 15.0]])
    wave = np.sin(np.arange(40.0) / 3.0)[:, None]
    going_on = baselines.nearest(wave[5:15], 8, {"a": -wave, "b": wave})
    np.testing.assert_array_equal(going_on, wave[15:23])


def test_the_nearest_stretch_is_held_where_its_clip_ends():
    wave = np.sin(np.arange(14.0) / 3.0)[:, None]
    going_on = baselines.nearest(wave[:10], 8, {"a": wave})
    np.testing.assert_array_equal(going_on[:4], wave[10:])
    np.testing.assert_array_equal(going_on[4:], np.repeat(wave[-1:], 4, axis=0))


@pytest.mark.real_data
def test_the_paper_s_protocol_on_one_clip(data_root):
    from bayesmotion.studies import multifactor as study

    motion = study.training_motion(data_root)
    assert motion.sizes["frame"] == 395
    clips = split(motion)
    assert set(clips) == set(study.TRAINING)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MotionWarning)
        fit = fit_map(Multifactor(), motion, starts=1, max_steps=150)
    clip = study.read_clips(["07_02"], data_root)["07_02"]
    found = study.score(fit, clip, 25, 40)
    assert found.error < 0.5 < min(found.baselines.values())
    assert found.coverage90 > 0.6
