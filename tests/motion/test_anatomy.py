"""Sides and anatomical angles of bodies of any convention."""

from dataclasses import replace

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.motion import Joint, Skeleton, positions, skeleton_of, split
from bayesmotion.motion.anatomy import anatomical_angles
from bayesmotion.motion.sides import sides
from bayesmotion.motion.synthetic.walkers import synthetic_walkers

# How others call knees and elbows, for ltibia and lradius.
CONVENTIONS = {
    "bvh": ("LeftLeg", "RightLeg", "LeftForeArm", "RightForeArm"),
    "mixamo": ("mixamorig:LeftLeg", "mixamorig:RightLeg", "mixamorig:LeftForeArm",
               "mixamorig:RightForeArm"),
    "smpl": ("L_Knee", "R_Knee", "L_Elbow", "R_Elbow"),
    "biped": ("Bip01 L Calf", "Bip01 R Calf", "Bip01 L Forearm", "Bip01 R Forearm"),
    "unreal": ("calf_l", "calf_r", "lowerarm_l", "lowerarm_r"),
    "blender": ("shin.L", "shin.R", "forearm.L", "forearm.R"),
}  # fmt: skip
OURS = ("ltibia", "rtibia", "lradius", "rradius")


@pytest.fixture(scope="module")
def walk():
    return split(synthetic_walkers(("ann",), ("walk",), seconds=1.0))["ann-walk"]


@pytest.fixture(scope="module")
def places(walk):
    return positions(walk).sel(joint=list(skeleton_of(walk).names)).values


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("lfemur", "rfemur"), ("LeftUpLeg", "RightUpLeg"), ("LThumb", "RThumb"),
        ("l_hip", "r_hip"), ("L_Hip", "R_Hip"), ("hip_l", "hip_r"), ("Hip.L", "Hip.R"),
        ("Bip01 L Thigh", "Bip01 R Thigh"), ("mixamorig:LeftArm", "mixamorig:RightArm"),
        ("thighL", "thighR"),
    ],
)  # fmt: skip
def test_sides_go_by_name(left, right):
    names = ["root", left, "lowerback", "LowerNeck", right, "rib"]
    assert sides(names) == ("centre", "left", "centre", "centre", "right", "centre")
    assert sides([left, "root"]) == ("centre", "centre")


@pytest.mark.parametrize("names", CONVENTIONS.values(), ids=CONVENTIONS)
def test_angles_are_the_same_whoever_named_the_joints(walk, places, names):
    ours = anatomical_angles(skeleton_of(walk), places)
    called = dict(zip(OURS, names, strict=True))
    joints = [replace(joint, name=called.get(joint.name, joint.name)) for joint in
              skeleton_of(walk)]  # fmt: skip
    theirs = anatomical_angles(Skeleton("theirs", tuple(joints)), places)
    assert theirs.keys() == ours.keys()
    for name, value in ours.items():
        np.testing.assert_array_equal(theirs[name], value)


def test_the_angles_of_a_walk_are_those_of_a_walk(walk, places):
    angles = anatomical_angles(skeleton_of(walk), places)
    for side in ("left", "right"):
        knee, hip = angles[f"{side} knee flexion"], angles[f"{side} hip flexion"]
        assert knee.min() > -1.0
        assert 40.0 < knee.max() < 90.0
        assert hip.min() < -5.0
        assert hip.max() > 20.0
        assert np.abs(angles[f"{side} hip abduction"]).max() < 20.0


def test_which_way_is_flexion_and_which_abduction():
    def joint(name, parent, *offset):
        return Joint(name, parent, tuple(map(float, offset)))

    body = Skeleton("body", (
        joint("root", -1, 0, 0, 0),
        joint("LeftHip", 0, 1, 0, 0), joint("LeftKnee", 1, 0, -4, 0),
        joint("LeftAnkle", 2, 0, -4, 0),
        joint("RightHip", 0, -1, 0, 0), joint("RightKnee", 4, 0, 0, 4),
        joint("RightAnkle", 5, 0, -4, 0),
        joint("LeftShoulder", 0, 1, 5, 0), joint("LeftElbow", 7, 3, 0, 0),
        joint("LeftWrist", 8, 3, 0, 0),
        joint("RightShoulder", 0, -1, 5, 0), joint("RightElbow", 10, 0, -3, 0),
        joint("RightWrist", 11, 0, 0, 3),
    ))  # fmt: skip
    where = np.zeros((1, len(body), 3))
    for index, one in enumerate(body):
        where[0, index] = np.array(one.offset) + (where[0, one.parent] if index else 0.0)
    angles = {name: float(value[0]) for name, value in anatomical_angles(body, where).items()}
    assert angles["left hip flexion"] == pytest.approx(0.0, abs=1e-9)
    assert angles["right hip flexion"] == pytest.approx(90.0)
    assert angles["right knee flexion"] == pytest.approx(90.0)
    assert angles["left shoulder abduction"] == pytest.approx(90.0)
    assert angles["right elbow flexion"] == pytest.approx(90.0)
    assert angles["trunk flexion"] == pytest.approx(0.0, abs=1e-9)


def test_a_body_without_known_limbs_is_told(walk, places):
    joints = [replace(joint, name=joint.name.replace("tibia", "shoe").replace("radius", "cuff"))
              for joint in skeleton_of(walk)]  # fmt: skip
    with pytest.raises(InputError, match="is called as a knee or an elbow"):
        anatomical_angles(Skeleton("x", tuple(joints)), places)
