"""The schema of a Motion."""

import json

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.motion import (
    Skeleton,
    clips,
    concat,
    label_names,
    make_markers,
    make_motion,
    skeleton_of,
    skeletons,
)


def arrays(skeleton: Skeleton, frames: int = 4) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros((frames, len(skeleton.dofs))), np.zeros((frames, 3))


def test_what_a_motion_is(skeleton: Skeleton):
    motion = make_motion(
        skeleton,
        *arrays(skeleton),
        frame_rate=50.0,
        clip="c",
        labels={"subject": "s", "gait": "run"},
        source="file",
        history="made",
    )
    assert motion["angle"].dims == ("frame", "dof")
    assert motion["root_position"].dims == ("frame", "space")
    assert motion["dof"].values.tolist() == list(skeleton.dofs)
    assert motion["space"].values.tolist() == ["x", "y", "z"]
    assert motion["frame"].values.tolist() == [0, 1, 2, 3]
    np.testing.assert_allclose(motion["time"], [0.0, 0.02, 0.04, 0.06])
    assert clips(motion) == ["c"]
    assert label_names(motion) == ["subject", "gait"]
    assert motion["gait"].values.tolist() == ["run"] * 4
    assert skeletons(motion) == {"body": skeleton}
    assert skeleton_of(motion) == skeleton
    assert json.loads(motion.attrs["source"]) == {"c": "file"}
    assert motion.attrs["history"] == "made"


def test_the_arrays_are_copied(skeleton: Skeleton):
    angle, root = arrays(skeleton)
    motion = make_motion(skeleton, angle, root, frame_rate=50.0, clip="c")
    angle[0, 0] = 7.0
    assert motion["angle"].values[0, 0] == 0.0
    assert motion["subject"].values[0] == ""


@pytest.mark.parametrize(
    ("change", "where", "what"),
    [
        ({"angle": np.zeros((4, 2))}, "clip 'c'", "2 columns of angles"),
        ({"root_position": np.zeros((3, 3))}, "clip 'c'", "4 frames of angles"),
        ({"root_position": np.zeros((4, 2))}, "clip 'c'", "4 frames of angles"),
        ({"frame_rate": 0.0}, "clip 'c'", "frame rate is 0"),
        ({"frame_rate": np.nan}, "clip 'c'", "frame rate is nan"),
        ({"clip": ""}, "clip ''", "no name"),
        ({"labels": {"time": "noon"}}, "clip 'c'", "time"),
    ],
)
def test_what_does_not_fit_is_told(skeleton: Skeleton, change: dict, where: str, what: str):
    angle, root = arrays(skeleton)
    given = {"angle": angle, "root_position": root, "frame_rate": 9.0, "clip": "c"} | change
    with pytest.raises(InputError) as caught:
        make_motion(skeleton, **given)
    assert caught.value.where == where
    assert what in caught.value.what


def test_one_pose_is_enough_and_none_is_not(skeleton: Skeleton):
    motion = make_motion(skeleton, *arrays(skeleton, 1), frame_rate=9.0, clip="c")
    assert motion["time"].values.tolist() == [0.0]
    with pytest.raises(InputError, match="at least one"):
        make_motion(skeleton, *arrays(skeleton, 0), frame_rate=9.0, clip="c")


def test_missing_values_only_where_allowed(skeleton: Skeleton):
    angle, root = arrays(skeleton)
    angle[2, 1] = np.nan
    with pytest.raises(InputError, match=r"clip 'c', frame 2: the angle is nan"):
        make_motion(skeleton, angle, root, frame_rate=9.0, clip="c")
    motion = make_motion(skeleton, angle, root, frame_rate=9.0, clip="c", allow_missing=True)
    assert motion["angle"].isnull().sum() == 1
    root[1, 0] = np.inf
    with pytest.raises(InputError, match=r"frame 1: the root position is inf"):
        make_motion(skeleton, angle, root, frame_rate=9.0, clip="c", allow_missing=True)


def test_markers():
    motion = make_markers(["a", "b"], np.zeros((3, 2, 3)), frame_rate=9.0, clip="c", metres=0.001)
    assert motion["position"].dims == ("frame", "joint", "space")
    assert motion.attrs["metres"] == 0.001
    assert skeletons(motion) == {}
    with pytest.raises(InputError, match="clips c: they have positions of markers alone"):
        skeleton_of(motion)
    with pytest.raises(InputError, match="for 1 markers"):
        make_markers(["a"], np.zeros((3, 2, 3)), frame_rate=9.0, clip="c")


def test_several_skeletons_are_not_one(make, skeleton: Skeleton):
    other = Skeleton("other", skeleton.joints, skeleton.metres)
    second = make_motion(other, *arrays(other), frame_rate=120.0, clip="second")
    with pytest.raises(InputError, match="clips walk, second: one skeleton is needed, there are 2"):
        skeleton_of(concat([make(), second]))
