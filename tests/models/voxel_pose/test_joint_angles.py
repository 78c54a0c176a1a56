"""Poses as principal components of circles, and back."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.models.voxel_pose.joint_angles import (
    PAPER_JOINTS,
    absolute_degrees,
    angle_labels,
    angles_of,
    mirrored,
    posed,
    rms_degrees,
    turned_degrees,
    wrapped,
)
from bayesmotion.models.voxel_pose.pose_space import learn_space
from bayesmotion.motion import Joint, Skeleton, positions, skeleton_of
from bayesmotion.motion.io.bvh import read_bvh, write_bvh
from bayesmotion.motion.kinematics import poses
from bayesmotion.motion.synthetic.walkers import synthetic_walkers


@pytest.fixture(scope="module")
def walk():
    return synthetic_walkers(["ann"], ["walk"], seconds=2.0, seed=1)


def test_the_papers_joints_are_found(walk):
    labels = angle_labels(skeleton_of(walk))
    assert labels[:3] == ("root/heading", "root/pitch", "root/roll")
    assert {label.split("/")[0] for label in labels} == {"root", *PAPER_JOINTS}
    assert len(labels) == 42


def test_other_skeletons_give_all_their_angles():
    joints = (
        Joint("hips", -1, (0.0, 0.0, 0.0), channels=("rz", "rx", "ry")),
        Joint("spine", 0, (0.0, 1.0, 0.0), channels=("rx",)),
    )
    assert angle_labels(Skeleton("post", joints))[3:] == ("spine/z", "spine/y", "spine/x")
    joints = (Joint("hips", -1, (0.0, 0.0, 0.0), channels=("rx",)), joints[1])
    with pytest.raises(InputError, match="three axes"):
        angle_labels(Skeleton("post", joints))


def test_a_pose_comes_back_from_its_angles(walk):
    skeleton = skeleton_of(walk)
    # Turned to every heading, also those where the recorded angles' order is singular.
    angle = walk["angle"].values.copy()
    ry = skeleton.dofs.index("root/ry")
    angle[:, ry] = np.linspace(-4.0, 4.0, len(angle))
    turned = walk.assign(angle=(("frame", "dof"), angle))
    labels = angle_labels(skeleton)
    angles = angles_of(turned, labels)
    back = posed(
        angles, labels, skeleton, turned["root_position"].values, frame_rate=30.0, clip="back",
        rest=dict(zip(skeleton.dofs, angle[0], strict=True)),
    )  # fmt: skip
    known = {label.split("/")[0] for label in labels}
    kept = [i for i, dof in enumerate(skeleton.dofs) if dof.split("/")[0] in known]
    # Where the other joints stand still the bodies are the same.
    still = np.tile(angle[0], (len(angle), 1))
    still[:, kept] = angle[:, kept]
    where, _ = poses(skeleton, still, turned["root_position"].values)
    np.testing.assert_allclose(positions(back).values, where, atol=1e-9)
    assert np.abs(np.diff(angles[:, 0])).max() < 0.2


def test_angles_are_those_of_a_bvh_file(walk, tmp_path):
    """The angles that stand in a file written by `write_bvh`, up to whole turns."""
    write_bvh(walk, tmp_path / "walk.bvh")
    labels = angle_labels(skeleton_of(walk))
    written = read_bvh(tmp_path / "walk.bvh")
    for name in ("lfemur", "rradius", "lfoot"):
        own = [i for i, label in enumerate(labels) if label.startswith(name)]
        stands = written["angle"].sel(dof=[f"{name}/r{axis}" for axis in "zyx"]).values
        np.testing.assert_allclose(
            wrapped(angles_of(walk, labels)[:, own] - stands), 0.0, atol=1e-6
        )


def test_a_mirror_swaps_the_sides(walk):
    skeleton = skeleton_of(walk)
    labels = angle_labels(skeleton)
    where = []
    for angles in (angles_of(walk, labels), mirrored(angles_of(walk, labels), labels)):
        root = np.zeros((len(angles), 3))
        made = posed(angles, labels, skeleton, root, frame_rate=30.0, clip="one", rest={})
        where.append(positions(made))
    twin = {"l": "r", "r": "l"}
    for joint in ("lfemur", "rfoot", "lwrist", "rradius", "lowerneck"):
        name = joint if joint == "lowerneck" else twin[joint[0]] + joint[1:]
        seen = where[0].sel(joint=joint).values * [-1.0, 1.0, 1.0]
        np.testing.assert_allclose(where[1].sel(joint=name).values, seen, atol=1e-6)
    back = mirrored(mirrored(angles_of(walk, labels), labels), labels)
    np.testing.assert_array_equal(back, angles_of(walk, labels))


def test_all_components_give_the_angles_back():
    random = np.random.default_rng(0)
    angles = np.cumsum(0.3 * random.standard_normal((60, 4)), axis=0)
    space = learn_space(angles, list("abcd"), share=1.0)
    np.testing.assert_allclose(wrapped(space.decode(space.encode(angles)) - angles), 0, atol=1e-9)
    np.testing.assert_allclose(space.encode(angles).std(axis=0), 1.0)
    np.testing.assert_allclose(space.rest, 0.0, atol=1e-12)
    turn = learn_space(angles + 2 * np.pi, list("abcd"), share=1.0)
    np.testing.assert_allclose(turn.encode(angles), space.encode(angles), atol=1e-9)


def test_the_fewest_components_hold_the_share():
    random = np.random.default_rng(1)
    angles = random.standard_normal((500, 6)) * [0.5, 0.4, 0.3, 0.2, 0.1, 0.05]
    points = np.concatenate([np.cos(angles), np.sin(angles)], axis=1)
    total = ((points - points.mean(axis=0)) ** 2).sum()
    for share in (0.5, 0.9):
        space = learn_space(angles, list("abcdef"), share)
        held = ((space.encode(angles) * space.scale) ** 2).sum(axis=0) / total
        assert held.sum() >= share
        assert held[:-1].sum() < share
        # What is left out is what `rest` says, entry by entry.
        left = total * (1 - held.sum()) / len(angles)
        assert np.einsum("aii->", space.rest) == pytest.approx(left)


def test_spreads_are_those_of_draws():
    random = np.random.default_rng(2)
    angles = np.column_stack([random.uniform(-3, 3, 300), 0.4 * random.standard_normal(300)])
    space = learn_space(angles, ["a", "b"], share=0.97)
    z = space.encode(angles[:3])
    variance = np.full(z.shape, 0.002)
    sd = space.sd(z, variance)
    draws = z + np.sqrt(variance) * random.standard_normal((4000, *z.shape))
    points = space.mean + draws * space.scale @ space.components
    for a in range(2):
        root = np.linalg.cholesky(space.rest[a] + 1e-12 * np.eye(2))
        off = random.standard_normal((4000, 3, 2)) @ root.T
        turn = np.arctan2(points[..., 2 + a] + off[..., 1], points[..., a] + off[..., 0])
        away = wrapped(turn - space.decode(z)[:, a])
        np.testing.assert_allclose(away.std(axis=0), sd[:, a], rtol=0.15)


def test_errors_wrap_around():
    true = np.radians([[179.0, 10.0], [-179.0, 10.0]])
    found = np.radians([[-179.0, 13.0], [181.0, 6.0]])
    assert absolute_degrees(true, found) == pytest.approx((2 + 3 + 0 + 4) / 4)
    rms = (np.sqrt((2**2 + 0) / 2) + np.sqrt((3**2 + 4**2) / 2)) / 2
    assert rms_degrees(true, found) == pytest.approx(rms)


def test_turns_are_told_apart_from_their_angles():
    # Equal turns with other angles are no error; 30 degrees about any axis are 30 degrees.
    true = np.radians([[0.0, 0.0, 0.0, 20.0, 100.0, 40.0]])
    same = np.radians([[360.0, 0.0, 0.0, 200.0, 80.0, -140.0]])
    assert turned_degrees(true, same) == pytest.approx(0.0, abs=1e-6)
    off = np.radians([[0.0, 30.0, 0.0, 50.0, 100.0, 40.0]])
    assert turned_degrees(true, off) == pytest.approx(30.0)


def test_what_makes_no_sense_is_refused(walk):
    with pytest.raises(InputError, match="all the same"):
        learn_space(np.ones((5, 2)), ["a", "b"])
    with pytest.raises(InputError, match="share"):
        learn_space(np.eye(3), ["a", "b", "c"], share=0.0)
    with pytest.raises(InputError, match="no angle of lgills"):
        angles_of(walk, ("root/heading", "root/pitch", "root/roll", "lgills/x"))
