"""Gait cycles: found where the phase says, cut without bending a bone, scaled by eq. 5."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bayesmotion.errors import InputError
from bayesmotion.motion import make_motion, positions, read, split
from bayesmotion.motion.cycles import (
    cut_cycle,
    cycles_of,
    diversified,
    find_cycles,
    joint_positions,
    rotation_vectors,
)
from bayesmotion.motion.gait_skeleton import (
    gait_skeleton,
    source_joints,
    still_joints,
    turning_joints,
    without_joints,
)
from bayesmotion.motion.synthetic.anthropometry import adult_skeleton
from bayesmotion.motion.synthetic.walkers import synthetic_truth

PEOPLE = ("ann", "ben", "cas")


@pytest.fixture(scope="module")
def truth():
    return synthetic_truth(PEOPLE, ("walk",), seconds=4.0, frame_rate=60.0)


def test_cycles_are_as_long_as_the_phase_says_and_begin_alike(truth):
    first = []
    for person in PEOPLE:
        walk = truth.cell(person, "walk")
        found = find_cycles(walk)
        assert len(found) >= 2
        step = float(truth.step.sel(subject=person, gait="walk"))
        phase = truth.phase.where(truth.phase["clip"] == f"{person}-walk", drop=True).values
        for cycle in found:
            assert cycle.end - cycle.start == pytest.approx(2 * np.pi / step, rel=0.01)
            assert abs(cycle.heading) < 0.02
            assert abs(cycle.turned) < 0.15
            first.append(phase[0] + step * cycle.start)
    # Left heel strikes are at phase zero; the feet are farthest apart just about then.
    off = (np.array(first) + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(off).max() < 0.35
    assert np.ptp(off) < 0.15


def test_bones_point_where_they_did(truth):
    walk = truth.cell("ben", "walk")
    cycle = find_cycles(walk)[0]
    cut = cut_cycle(walk, cycle, "ben#1")
    sources = source_joints(adult_skeleton("ben", 1.8))
    recorded = positions(walk).interp(frame=cycle.start + np.arange(30) / 30 * 1.0 * (
        cycle.end - cycle.start
    ))  # fmt: skip
    made = positions(cut)
    back = Rotation.from_rotvec([0.0, -cycle.heading, 0.0])
    for joint, end in (("lfemur", "ltibia"), ("rtibia", "rfoot"), ("lhumerus", "lradius"),
                       ("thorax", "neck")):  # fmt: skip
        own = made.sel(joint=end).values - made.sel(joint=joint).values
        turns, points = sources[joint]
        theirs = recorded.sel(joint=points).values - recorded.sel(joint=turns).values
        cosine = np.sum(own * back.apply(theirs), axis=1)
        cosine /= np.linalg.norm(own, axis=1) * np.linalg.norm(theirs, axis=1)
        assert cosine.min() > np.cos(np.deg2rad(1.0)), joint


def test_scaling_is_equation_five_and_comes_back_from_the_angles(truth):
    cycle = cycles_of(truth.cell("ann", "walk"), 1)
    vectors = rotation_vectors(cycle)
    mean = vectors.mean(axis=0)
    scaled = diversified(cycle, 0.4)
    np.testing.assert_allclose(rotation_vectors(scaled), mean + 0.4 * (vectors - mean), atol=1e-9)
    assert set(scaled["scale"].values) == {"0.4"}
    assert list(split(scaled)) == ["ann-walk#1 x0.4"]
    assert set(scaled["gait"].values) == {"ann-walk#1"}
    np.testing.assert_allclose(rotation_vectors(diversified(cycle, 1.0)), vectors, atol=1e-12)
    with pytest.raises(InputError, match="above zero"):
        diversified(cycle, 0.0)


def test_positions_of_vectors_are_those_of_the_motion(truth):
    cycle = cycles_of(truth.cell("cas", "walk"), 1)
    where = joint_positions(rotation_vectors(cycle), gait_skeleton())
    expected = positions(cycle).values - positions(cycle).sel(joint="root").values[:, None]
    np.testing.assert_allclose(where, expected, atol=1e-6)


def test_the_body_stands_upright_at_its_height():
    skeleton = gait_skeleton()
    assert len(turning_joints(skeleton)) == 18
    rest = joint_positions(np.zeros((1, 18, 3)), skeleton)[0]
    top, sole = rest[skeleton.index("head_end")], rest[skeleton.index("lfoot_end")]
    assert top[1] - sole[1] == pytest.approx(1750.0)
    left, right = rest[skeleton.index("lwrist")], rest[skeleton.index("rwrist")]
    np.testing.assert_allclose(left * [-1, 1, 1], right)


def test_clips_without_a_cycle_or_without_the_joints_are_refused(truth):
    walk = truth.cell("ann", "walk")
    with pytest.raises(InputError, match="no whole straight gait cycle"):
        cycles_of(walk.isel(frame=slice(30)).assign_attrs(walk.attrs))
    with pytest.raises(InputError, match="turns about"):
        rotation_vectors(walk)
    stranger = make_motion(
        adult_skeleton("x", 1.7).__class__("x", adult_skeleton("x", 1.7).joints[:1], 1.0),
        np.zeros((4, 3)),
        np.zeros((4, 3)),
        frame_rate=30.0,
        clip="x",
    )
    with pytest.raises(InputError, match="no joint"):
        find_cycles(stranger)


def test_walking_backwards_is_no_walk(truth):
    walk = truth.cell("ann", "walk")
    assert find_cycles(walk)
    # A walk from its last frame to its first has all steps of one, but the way it faces.
    back = walk.copy(deep=True)
    for name in ("angle", "root_position"):
        back[name].values = walk[name].values[::-1]
    assert find_cycles(back) == []


def test_what_is_missing_takes_what_hangs_on_it_and_nothing_else(truth):
    walk = truth.cell("ben", "walk")
    whole, cut = cycles_of(walk), cycles_of(without_joints(walk, ["lhumerus"]))
    vectors, known = rotation_vectors(cut), rotation_vectors(whole)
    turning = turning_joints(gait_skeleton())
    lost = [turning.index(name) for name in ("lhumerus", "lradius", "lwrist")]
    assert np.isnan(vectors[:, lost]).all()
    others = np.setdiff1d(np.arange(len(turning)), lost)
    np.testing.assert_array_equal(vectors[:, others], known[:, others])
    where = positions(cut)
    assert np.isfinite(where.sel(joint="lhumerus")).all()
    assert np.isnan(where.sel(joint=["lradius", "lwrist", "lwrist_end"])).all()
    assert np.isfinite(where.sel(joint=["rwrist", "lfoot", "head"])).all()


def test_frames_that_are_missing_cost_the_poses_beside_them(truth):
    walk = truth.cell("ben", "walk")
    cycle = find_cycles(walk)[0]
    gone = int(cycle.start) + 20
    gap = walk.copy(deep=True)
    gap["angle"].loc[{"dof": ["lradius/rx"], "frame": walk["frame"][gone : gone + 5]}] = np.nan
    assert find_cycles(gap) == find_cycles(walk)
    cut, whole = (rotation_vectors(cut_cycle(one, cycle, "ben#1")) for one in (gap, walk))
    at = cycle.start + np.arange(30) * (cycle.end - cycle.start) / 30
    lost = (np.ceil(at) >= gone) & (np.floor(at) < gone + 5)
    elbow = turning_joints(gait_skeleton()).index("lradius")
    np.testing.assert_array_equal(np.isnan(cut[:, elbow, 0]), lost)
    assert 0 < lost.sum() < 10
    np.testing.assert_allclose(cut[~lost], whole[~lost], atol=1e-12)


@pytest.mark.parametrize("side", ["l", "r"])
def test_one_leg_tells_the_cycles_of_both(truth, side):
    leg = [f"{side}{part}" for part in ("femur", "tibia", "foot")]
    for person in PEOPLE:
        walk = truth.cell(person, "walk")
        both, one = find_cycles(walk), find_cycles(without_joints(walk, leg))
        assert len(one) == len(both)
        for cycle, other in zip(one, both, strict=True):
            assert abs(cycle.start - other.start) < 0.02 * (other.end - other.start)


def test_without_any_foot_there_are_no_cycles(truth):
    walk = truth.cell("ann", "walk")
    for joints in (["lfemur", "rtibia"], ["root"]):
        with pytest.raises(InputError, match="root or both feet are missing"):
            find_cycles(without_joints(walk, joints))


def test_joints_at_rest_are_told(truth):
    walk = truth.cell("ann", "walk")
    arm = ["lhumerus", "lradius"]
    rest = walk.copy(deep=True)
    rest["angle"].loc[{"dof": ["lhumerus/rz", "lhumerus/ry", "lhumerus/rx"]}] = 0.3
    assert still_joints(walk, arm) == ()
    assert still_joints(rest, arm) == ("lhumerus",)
    assert still_joints(without_joints(walk, arm), arm) == ()


@pytest.mark.real_data
@pytest.mark.parametrize("name", ["02_01", "12_02", "16_15"])
def test_one_real_leg_tells_the_cycles_of_both(data_root, name):
    walk = read(data_root / "cmu" / name[:2] / f"{name}.amc")
    both = find_cycles(walk)
    for side in "lr":
        one = find_cycles(without_joints(walk, [f"{side}femur", f"{side}tibia", f"{side}foot"]))
        assert len(one) == len(both)
        for cycle, other in zip(one, both, strict=True):
            assert abs(cycle.start - other.start) < 0.02 * (other.end - other.start)


@pytest.mark.real_data
def test_two_files_of_one_trial_give_one_cycle(data_root):
    """ASF/AMC and BVH have different axes and names; on the one body they are the same."""
    amc = read(data_root / "cmu/02/02_02.amc")
    bvh = read(data_root / "cmu/02/02_02.bvh").isel(frame=slice(1, None))
    bvh = bvh.assign_attrs(frame_rate=120.0)
    one, other = (cycles_of(motion, 1) for motion in (amc, bvh))
    apart = joint_positions(rotation_vectors(one), gait_skeleton()) - joint_positions(
        rotation_vectors(other), gait_skeleton()
    )
    # The BVH release leaves out where the thorax points: shoulders may differ, legs may not.
    skeleton = gait_skeleton()
    legs = [skeleton.index(f"{side}{part}") for side in "lr" for part in ("tibia", "foot")]
    assert np.linalg.norm(apart[:, legs], axis=-1).max() < 5.0
    assert np.linalg.norm(apart, axis=-1).max() < 60.0
