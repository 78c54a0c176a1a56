"""The pose tasks on a multifactor model: the same process, and features filled in."""

import numpy as np

from bayesmotion.models.multifactor_poses import multifactor_poses
from bayesmotion.tasks.latent import PoseModel, measured, represent
from bayesmotion.tasks.pose_posterior import pose_given, white_deviation

LENGTH = 20


def test_features_that_are_missing_are_filled_in(circle_fit):
    frames, given = circle_fit.training.frames, circle_fit.given
    process = multifactor_poses(circle_fit.model, frames, given, LENGTH, every=7)
    assert isinstance(process, PoseModel)
    assert process.candidates.shape[1:] == (LENGTH, 2 + 3 + 3)
    # At training points it predicts what the model's own kernel does.
    cross = circle_fit.model.kernel(given.hyper).matrix(given.points, given.points)
    expected = given.conditioned(cross, cross)[0]
    mean, variance = process.predict(process.candidates[0])
    np.testing.assert_allclose(mean, expected[:LENGTH], atol=1e-6)
    assert (np.asarray(variance) >= 0.0).all()
    y = np.asarray(frames.y)[3 : 3 + LENGTH]
    n = circle_fit.training.encoding.n_angles
    moving = np.argsort(-y[:, :n].std(axis=0))[:6]
    hidden = y.copy()
    hidden[:, moving] = np.nan
    white = np.full(y.shape[1], 0.02)
    found = represent(process, measured(hidden), white)
    pose = pose_given(found, measured(hidden), white_deviation(white, LENGTH))
    error = np.sqrt(np.mean((pose.mean - y)[:, moving] ** 2))
    assert error < 0.5 * y[:, moving].std()
