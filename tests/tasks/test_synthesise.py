"""Synthesis: missing cells, transitions, samples."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.motion import positions, write_bvh
from bayesmotion.motion.bvh import read_bvh
from bayesmotion.tasks.synthesise import cell, sampled, step_map, transition


def test_the_step_map_gives_back_the_training_steps(circle_fit):
    values, frames = circle_fit.values(), circle_fit.training.frames
    weights = step_map(circle_fit)
    s = values["style_subject"][frames.level["subject"]]
    g = values["style_gait"][frames.level["gait"]]
    np.testing.assert_allclose(np.einsum("sg,cs,cg->c", weights, s, g), values["step"], rtol=1e-6)


def test_a_cell_has_the_length_asked_for_and_stands_on_the_floor(circle_fit):
    made = cell(circle_fit, {"subject": "ben", "gait": "run"}, 3.0)
    assert made.motion.sizes["frame"] == 60
    height = positions(made.motion).sel(space="y")
    assert float(height.min()) == pytest.approx(0.0, abs=1e-9)
    climbed = made.motion["root_position"].sel(space="y")
    assert abs(float(climbed[-1] - climbed[0])) < 1e-9
    assert np.all(np.diff(made.phase) > 0)
    assert made.sd.shape == (60, 89)


def test_people_known_have_nothing_in_spare_entries(circle_fit, with_spare):
    one = cell(circle_fit, {"subject": "ben", "gait": "run"}, 0.5)
    other = cell(with_spare(circle_fit, 1), {"subject": "ben", "gait": "run"}, 0.5)
    np.testing.assert_allclose(other.motion["angle"], one.motion["angle"], atol=1e-9)
    np.testing.assert_allclose(other.sd, one.sd, rtol=1e-9)


def test_a_transition_begins_and_ends_in_its_gaits(circle_fit):
    made = transition(circle_fit, {"subject": "ann"}, "gait", ("walk", "run"), 2.0)
    learned = circle_fit.values()["style_gait"]
    np.testing.assert_allclose(made.styles["gait"][0], learned[0])
    np.testing.assert_allclose(made.styles["gait"][-1], learned[1])


def test_samples_differ_by_seed_and_agree_with_it(circle_fit):
    one, again = sampled(circle_fit, 1.0, 1), sampled(circle_fit, 1.0, 1)
    np.testing.assert_array_equal(one.motion["angle"], again.motion["angle"])
    other = sampled(circle_fit, 1.0, 2)
    assert np.abs(one.motion["angle"].values - other.motion["angle"].values).max() > 1e-3


def test_an_exported_motion_has_the_same_joint_positions(circle_fit, tmp_path):
    made = cell(circle_fit, {"subject": "ben", "gait": "run"}, 1.0).motion
    write_bvh(made, tmp_path / "made.bvh")
    back = positions(read_bvh(tmp_path / "made.bvh"))
    here = positions(made)
    shared = [name for name in here["joint"].values if name in back["joint"].values]
    assert len(shared) > 20
    np.testing.assert_allclose(back.sel(joint=shared), here.sel(joint=shared), atol=1e-3)


def test_what_is_not_there_gets_a_sentence(circle_fit):
    with pytest.raises(InputError, match="'swim' is not in the training clips"):
        cell(circle_fit, {"subject": "ann", "gait": "swim"}, 1.0)
    with pytest.raises(InputError, match="0 frames"):
        cell(circle_fit, {"subject": "ann", "gait": "walk"}, 0.0)
