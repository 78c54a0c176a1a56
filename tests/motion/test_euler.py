"""Euler angles that run on from frame to frame."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bayesmotion.motion import Joint
from bayesmotion.motion.euler import continuous_angles, zyx_angles


@pytest.mark.parametrize(("channel", "column"), [("rz", 0), ("ry", 1), ("rx", 2)])
def test_two_turns_about_one_axis_stay_about_that_axis(channel: str, column: int):
    joint = Joint("j", 0, (0.0, 0.0, 0.0), tuple(0.3 * np.eye(3)[2 - column]), (channel,))
    # The little bit more keeps all frames off the poles.
    turns = 4.0 * np.pi * np.arange(200) / 200.0 + 0.001
    triple = zyx_angles(joint, turns[:, None])
    np.testing.assert_allclose(triple, turns[:, None] * np.eye(3)[column], atol=1e-6)


def test_the_rotation_is_that_of_the_joint():
    axis, angle = (0.4, -1.1, 2.0), np.random.default_rng(0).uniform(-6, 6, (50, 3))
    joint = Joint("j", 0, (0.0, 0.0, 0.0), axis, ("rx", "rz", "ry"))
    frame = Rotation.from_euler("xyz", axis)  # fixed axes: Rz Ry Rx
    expected = frame * Rotation.from_euler("XZY", angle) * frame.inv()
    given = Rotation.from_euler("ZYX", zyx_angles(joint, angle))
    np.testing.assert_allclose(given.as_matrix(), expected.as_matrix(), atol=1e-12)


def test_angles_run_on_over_frames_that_are_missing():
    turns = np.linspace(0.0, 4.0 * np.pi, 400)[:, None] * [0.0, 0.0, 1.0] + 0.01
    gap = turns.copy()
    gap[[0, 1, 100, 101]] = np.nan
    made = continuous_angles(Rotation.from_euler("ZYX", gap), "ZYX")
    known = np.isfinite(gap[:, 0])
    np.testing.assert_allclose(made[known], turns[known], atol=1e-6)
    assert np.isnan(made[~known]).all()
