"""Walks of which a limb is missing: NaN, zeros, or nothing to judge by."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.motion import read, split
from bayesmotion.motion.gait_skeleton import still_joints, without_joints
from bayesmotion.prediction import Mixture
from bayesmotion.tasks import gait
from bayesmotion.tasks.incomplete import baselines, incomplete_cycle, missing_joints, score

ARM = gait.LIMBS["larm"]


@pytest.fixture(scope="module")
def walk(gait_clips):
    return split(gait_clips)["new-walk"]


def at_zero(walk, joints):
    """Give a clip in which joints are zero in all frames, as some write what is missing."""
    hidden = without_joints(walk, joints)
    return hidden.assign(angle=hidden["angle"].fillna(0.0))


def known(value):
    """Give a number or a sentence that is there."""
    assert value is not None
    return value


def reconstructed(ready, found):
    encoding = ready.training.encoding
    u = encoding.scaled(found.motion)
    pose = gait.reconstruct(ready, u)
    return pose, score(ready, u, pose, encoding.scaled(found.truth), found.still)


def test_nan_zeros_and_a_named_limb_are_reconstructed_alike(trained_gait, walk):
    _, ready = trained_gait
    poses = ready.training.poses
    recordings = {
        "named": incomplete_cycle(walk, poses, missing=ARM),
        "nan": incomplete_cycle(without_joints(walk, ARM), poses),
        "zero": incomplete_cycle(at_zero(walk, ARM), poses, missing=ARM),
    }
    made = {name: reconstructed(ready, found) for name, found in recordings.items()}
    for pose, _ in made.values():
        np.testing.assert_array_equal(pose.means(), made["named"][0].means())
    # Only the recording that has the arm can tell an error.
    assert made["nan"][1].error_mm is None
    assert "no values" in known(made["nan"][1].why)
    assert made["zero"][1].error_mm is None
    assert made["zero"][1].coverage90 is None
    assert made["zero"][1].baselines_mm == {}
    assert "still" in known(made["zero"][1].why)
    told = made["named"][1]
    assert told.why is None
    assert 0.5 < known(told.coverage90) <= 1.0
    assert set(told.baselines_mm) == {"mean_cycle", "pca", "nearest_pose"}
    assert 0.0 < known(told.error_mm) < 2.0 * told.baselines_mm["mean_cycle"]


def test_errors_are_distances_of_the_joints_that_move(trained_gait, walk):
    _, ready = trained_gait
    encoding = ready.training.encoding
    found = incomplete_cycle(walk, ready.training.poses, missing=ARM)
    u, truth = encoding.scaled(found.motion), encoding.scaled(found.truth)
    pose, told = reconstructed(ready, found)
    joints = gait.moved_joints(gait.missing_in(u))
    for made, error in (
        (pose.means(), told.error_mm),
        *((made, told.baselines_mm[name]) for name, made in baselines(ready, u).items()),
    ):
        filled = np.where(np.isnan(u), made, truth)
        apart = np.linalg.norm(encoding.positions(filled) - encoding.positions(truth), axis=-1)
        assert error == pytest.approx(apart[:, joints].mean())
    # Who is told the truth is nowhere off.
    exact = Mixture(truth[None], np.ones_like(truth)[None], np.ones(1))
    assert score(ready, u, exact, truth).error_mm == pytest.approx(0.0, abs=1e-9)


def test_without_a_truth_there_is_no_error(trained_gait, walk):
    _, ready = trained_gait
    found = incomplete_cycle(walk, ready.training.poses, missing=ARM)
    u = ready.training.encoding.scaled(found.motion)
    told = score(ready, u, gait.reconstruct(ready, u))
    assert told.error_mm is None
    assert told.why == "no truth was given"


def test_part_of_a_limb_at_rest_is_no_truth_for_what_hangs_on_it(trained_gait, walk):
    _, ready = trained_gait
    found = incomplete_cycle(at_zero(walk, ["lradius"]), ready.training.poses, missing=ARM)
    assert found.still == ("lradius",)
    truth = ready.training.encoding.scaled(found.truth)
    assert missing_joints(ready, truth) == ["lradius", "lwrist"]
    # The elbow, which the upper arm moves, is told; the wrist is not.
    _, told = reconstructed(ready, found)
    elbow = incomplete_cycle(walk, ready.training.poses, missing=ARM)
    assert known(told.why).startswith("the recording holds lradius still")
    assert known(told.error_mm) < known(reconstructed(ready, elbow)[1].error_mm)


def test_joints_that_move_nothing_have_no_distance(trained_gait, walk):
    _, ready = trained_gait
    found = incomplete_cycle(walk, ready.training.poses, missing=["lwrist"])
    _, told = reconstructed(ready, found)
    assert told.error_mm is None
    assert told.coverage90 is not None
    assert "hangs" in known(told.why)


def test_a_gap_in_time_is_filled_in(trained_gait, walk):
    _, ready = trained_gait
    whole = incomplete_cycle(walk, ready.training.poses)
    gap = without_joints(walk, ARM)
    middle = walk.sizes["frame"] // 2
    frames = walk["frame"].values
    here = (frames > middle - 10) & (frames < middle)
    gap = walk.assign(angle=walk["angle"].where(~walk["frame"].isin(frames[here]), gap["angle"]))
    found = incomplete_cycle(gap, ready.training.poses)
    u, truth = (ready.training.encoding.scaled(one) for one in (found.motion, whole.motion))
    lost = np.isnan(u)
    assert 0 < lost.any(axis=1).sum() < len(u)
    assert missing_joints(ready, u) == list(ARM)
    np.testing.assert_allclose(u[~lost], truth[~lost], atol=1e-9)
    told = score(ready, u, gait.reconstruct(ready, u), truth)
    assert known(told.error_mm) < told.baselines_mm["mean_cycle"]


def test_limbs_at_rest_that_nobody_named_are_told(walk):
    found = incomplete_cycle(at_zero(walk, ARM), 12)
    assert found.limbs_at_rest == ("larm",)
    assert still_joints(walk, ARM) == ()
    assert incomplete_cycle(walk, 12).limbs_at_rest == ()


def test_a_cycle_that_is_not_there_is_refused(walk):
    with pytest.raises(InputError, match="straight cycles"):
        incomplete_cycle(walk, 12, number=9)


@pytest.mark.thorough
@pytest.mark.real_data
def test_a_real_arm_and_a_real_leg_are_filled_in(data_root):
    from bayesmotion.inference.methods import LocalLearning, fit
    from bayesmotion.models.gait_pose import VARIANTS
    from bayesmotion.motion.cycles import cycles_of
    from bayesmotion.motion.joining import concat

    def trial(name):
        subject = name.split("_")[0]
        return read(data_root / "cmu" / subject / f"{name}.amc")

    motion = concat([cycles_of(trial(name), 3) for name in ("02_01", "05_01", "12_02", "49_01")])
    ready = gait.trained_of(fit(VARIANTS["torus3"], motion, method=LocalLearning(10)))
    walk = trial("16_15")
    for limb, most in (("larm", 70.0), ("lleg", 75.0)):
        joints = gait.LIMBS[limb]
        pose, told = reconstructed(ready, incomplete_cycle(walk, 30, missing=joints))
        assert known(told.error_mm) < most
        assert known(told.error_mm) < told.baselines_mm["mean_cycle"]
        assert known(told.coverage90) > 0.6
        gone, nothing = reconstructed(ready, incomplete_cycle(without_joints(walk, joints), 30))
        np.testing.assert_array_equal(gone.means(), pose.means())
        assert nothing.error_mm is None
        _, zero = reconstructed(ready, incomplete_cycle(at_zero(walk, joints), 30, missing=joints))
        assert zero.error_mm is None
