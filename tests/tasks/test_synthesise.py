"""Synthesis: missing cells, transitions, samples."""

import numpy as np
import pytest
import xarray as xr

from bayesmotion.errors import InputError
from bayesmotion.fit import Fit
from bayesmotion.motion import positions, split, write_bvh
from bayesmotion.motion.io.bvh import read_bvh
from bayesmotion.tasks.synthesise import of_styles, sampled, step_map, synthesize, transition


def test_the_step_map_gives_back_the_training_steps(circle_fit):
    values, frames = circle_fit.values(), circle_fit.training.frames
    (weights,) = step_map(circle_fit)
    s = values["style_subject"][frames.level["subject"]]
    g = values["style_gait"][frames.level["gait"]]
    np.testing.assert_allclose(np.einsum("sg,cs,cg->c", weights, s, g), values["step"], rtol=1e-6)


def test_a_cell_has_the_length_asked_for_and_stands_on_the_floor(circle_fit):
    made = synthesize(circle_fit, {"subject": "ben", "gait": "run"}, 3.0)
    assert made.motion.sizes["frame"] == 60
    height = positions(made.motion).sel(space="y")
    assert float(height.min()) == pytest.approx(0.0, abs=1e-9)
    climbed = made.motion["root_position"].sel(space="y")
    assert abs(float(climbed[-1] - climbed[0])) < 1e-9
    assert np.all(np.diff(made.phase) > 0)
    assert made.sd.shape == (60, 89)


def test_people_known_have_nothing_in_novel_dimensions(circle_fit, with_novel):
    levels = {"subject": "ben", "gait": "run"}
    one = synthesize(circle_fit, levels, 0.5)
    other = synthesize(with_novel(circle_fit, 2), levels, 0.5)
    np.testing.assert_allclose(other.motion["angle"], one.motion["angle"], atol=1e-9)
    np.testing.assert_allclose(other.sd, one.sd, rtol=1e-9)


def test_styles_may_have_novel_dimensions(circle_fit):
    one = synthesize(circle_fit, {"subject": "ben", "gait": "run"}, 0.5)
    novel = {name: np.pad(style, ((0, 0), (0, 0), (0, 1))) for name, style in one.styles.items()}
    same = of_styles(circle_fit, novel, clip="same")
    np.testing.assert_allclose(same.mean, one.mean, atol=1e-9)
    novel["subject"][..., -1] = 0.5
    other = of_styles(circle_fit, novel, clip="other")
    # Nobody known has any of it: poses stay, and are less sure.
    np.testing.assert_allclose(other.mean, one.mean, atol=1e-9)
    assert np.all(other.sd > one.sd)
    with pytest.raises(InputError, match="they have 5 entries, trained ones 3"):
        of_styles(circle_fit, {**novel, "gait": np.zeros((1, 10, 5))}, clip="none")


@pytest.mark.filterwarnings("ignore:.*the fit's draws. not converged")
def test_all_draws_count_whatever_their_order(circle_fit):
    """Two draws, the mode and one beside it: the mean of both, and less sure than either."""

    def fit_of(*pace):
        posterior = circle_fit.tree["posterior"].to_dataset()
        parts = [posterior.assign(scale=posterior["scale"] * factor) for factor in pace]
        tree = circle_fit.tree.copy()
        joined = xr.concat(parts, "draw", join="override")
        tree["posterior"] = xr.DataTree(joined.assign_coords(draw=np.arange(len(pace))))
        return Fit(circle_fit.model, circle_fit.motion, tree)

    def made(*pace):
        return synthesize(fit_of(*pace), {"subject": "ben", "gait": "run"}, 0.5)

    one, other, both, turned = made(1.0), made(0.5), made(1.0, 0.5), made(0.5, 1.0)
    assert both.styles["gait"].shape[0] == 2
    np.testing.assert_allclose(both.sd**2, 0.5 * (one.sd**2 + other.sd**2), rtol=1e-6)
    np.testing.assert_allclose(turned.mean, both.mean, atol=1e-9)
    np.testing.assert_allclose(turned.sd, both.sd, rtol=1e-9)


def test_a_transition_begins_and_ends_in_its_gaits(circle_fit):
    made = transition(circle_fit, {"subject": "ann"}, "gait", ("walk", "run"), 2.0)
    learned = circle_fit.values()["style_gait"]
    np.testing.assert_allclose(made.styles["gait"][0, 0], learned[0])
    np.testing.assert_allclose(made.styles["gait"][0, -1], learned[1])


def test_samples_differ_by_seed_and_agree_with_it(circle_fit):
    one, again = sampled(circle_fit, 1.0, 1), sampled(circle_fit, 1.0, 1)
    np.testing.assert_array_equal(one.motion["angle"], again.motion["angle"])
    other = sampled(circle_fit, 1.0, 2)
    assert np.abs(one.motion["angle"].values - other.motion["angle"].values).max() > 1e-3


def test_an_exported_motion_has_the_same_joint_positions(circle_fit, tmp_path):
    made = synthesize(circle_fit, {"subject": "ben", "gait": "run"}, 1.0).motion
    write_bvh(made, tmp_path / "made.bvh")
    back = positions(read_bvh(tmp_path / "made.bvh"))
    here = positions(made)
    shared = [name for name in here["joint"].values if name in back["joint"].values]
    assert len(shared) > 20
    np.testing.assert_allclose(back.sel(joint=shared), here.sel(joint=shared), atol=1e-3)


def test_what_is_not_there_gets_a_sentence(circle_fit):
    with pytest.raises(InputError, match="'swim' is not in the training clips"):
        synthesize(circle_fit, {"subject": "ann", "gait": "swim"}, 1.0)
    with pytest.raises(InputError, match="0 frames"):
        synthesize(circle_fit, {"subject": "ann", "gait": "walk"}, 0.0)


def test_the_skeleton_is_that_of_the_subject(circle_fit):
    made = synthesize(circle_fit, {"gait": "run", "subject": "ben"}, 0.5)
    ben = split(circle_fit.motion)["ben-walk"]
    assert set(made.motion["skeleton"].values) == set(ben["skeleton"].values)
