"""Joining Motions and taking them apart."""

import json

import numpy as np
import pytest
import xarray as xr

from bayesmotion.errors import InputError, MotionWarning
from bayesmotion.motion import (
    Joint,
    Skeleton,
    clips,
    concat,
    make_markers,
    make_motion,
    skeletons,
    split,
)
from bayesmotion.motion.joining import lengthened, shortened


@pytest.fixture
def stick() -> xr.Dataset:
    body = Skeleton(
        "stick",
        (
            Joint("root", -1, (0.0, 0.0, 0.0), channels=("rz",)),
            Joint("tip", 0, (0.0, 1.0, 0.0), channels=("rx",)),
        ),
    )
    angle = np.arange(6.0).reshape(3, 2)
    return make_motion(
        body, angle, np.ones((3, 3)), frame_rate=120.0, clip="stick", labels={"mood": "glad"}
    )


def test_joined_and_taken_apart_again(make, stick: xr.Dataset):
    parts = {"a": make("a", gait="walk"), "b": make("b", seed=1), "stick": stick}
    both = concat(list(parts.values()))
    assert clips(both) == ["a", "b", "stick"]
    assert both["frame"].values.tolist() == list(range(123))
    assert both["time"].values[120] == 0.0
    assert set(skeletons(both)) == {"body", "stick"}
    assert both["gait"].values[60] == ""
    assert both["mood"].values[[0, 122]].tolist() == ["", "glad"]
    assert json.loads(both.attrs["source"]) == {"a": "made", "b": "made", "stick": ""}
    again = split(both)
    assert list(again) == list(parts)
    for clip, part in parts.items():
        xr.testing.assert_equal(
            again[clip][["angle", "root_position"]].drop_vars(
                [name for name in again[clip].coords if name not in part.coords]
            ),
            part,
        )
        assert again[clip].attrs == part.attrs


def test_what_a_skeleton_lacks_is_missing(make, stick: xr.Dataset):
    both = concat([make(), stick])
    lacking = sorted(set(both["dof"].values.tolist()) - {"root/rz", "tip/rx"})
    assert both["angle"].sel(dof=lacking)[60:].isnull().all()
    assert both["angle"].sel(dof="tip/rx")[:60].isnull().all()
    np.testing.assert_array_equal(both["angle"].sel(dof=["root/rz", "tip/rx"])[60:], stick["angle"])
    assert both["dof"].values.tolist()[:3] == ["root/rz", "root/ry", "root/rx"]
    assert both["dof"].values.tolist()[-1] == "tip/rx"


def test_markers_join(make):
    a = make_markers(["x", "y"], np.ones((2, 2, 3)), frame_rate=9.0, clip="a", metres=0.001)
    b = make_markers(["y", "z"], np.ones((2, 2, 3)), frame_rate=9.0, clip="b", metres=0.001)
    both = concat([a, b])
    assert both["position"].sel(joint="x").isnull().values.any(axis=1).tolist() == [0, 0, 1, 1]
    assert split(both)["b"]["joint"].values.tolist() == ["y", "z"]
    with pytest.raises(InputError, match=r"clips 'a' and 'c': their units \(metres\) differ"):
        concat([a, make_markers(["x"], np.ones((2, 1, 3)), frame_rate=9.0, clip="c", metres=1.0)])
    with pytest.raises(InputError, match="their kinds of data differ"):
        concat([a.assign_attrs(frame_rate=120.0), make().assign_attrs(metres=0.001)])


def test_what_cannot_be_joined_is_told(make, skeleton: Skeleton):
    with pytest.raises(InputError, match="no motions"):
        concat([])
    with pytest.raises(InputError, match="clip 'a': two clips have this name"):
        concat([make("a"), make("a", seed=1)])
    longer = tuple(
        Joint(j.name, j.parent, tuple(2.0 * x for x in j.offset), j.axis, j.channels)
        for j in skeleton
    )
    other = Skeleton("body", longer, skeleton.metres)
    angle, root = np.zeros((2, len(other.dofs))), np.zeros((2, 3))
    second = make_motion(other, angle, root, frame_rate=120.0, clip="b")
    with pytest.raises(InputError, match="skeleton 'body' of clip 'b': a different skeleton"):
        concat([make("a"), second])


def test_rates_that_differ_by_rounding_join_after_being_told(make):
    parts = [make("a", rate=119.875), make("b", seed=1), make("c", rate=120.48)]
    with pytest.warns(MotionWarning, match=r"clips of 119\.875, 120\.48 frames .* to 120,"):
        both = concat(parts)
    assert both.attrs["frame_rate"] == 120.0
    np.testing.assert_allclose(both["time"].values[:60], np.arange(60) / 120.0)
    # 0.0083 s is 1/120 s in four digits; the other camera was slower.
    a, b, c = split(both).values()
    np.testing.assert_array_equal(b["angle"], parts[1]["angle"])
    np.testing.assert_array_equal(c["angle"], parts[2]["angle"])
    assert not np.allclose(a["angle"][1:-1], parts[0]["angle"][1:-1], atol=1e-6)
    seconds = parts[0]["time"].values
    for dof in range(3):
        then = np.interp(a["time"].values, seconds, parts[0]["root_position"].values[:, dof])
        np.testing.assert_allclose(a["root_position"].values[:, dof], then, atol=0.05)


def test_clips_of_any_rates_join_at_the_lowest(make):
    with pytest.warns(MotionWarning, match="clips of 120 frames a second are brought to 60"):
        both = concat([make("a"), make("b", rate=60.0)])
    assert both.attrs["frame_rate"] == 60.0
    assert [part.sizes["frame"] for part in split(both).values()] == [30, 60]


def test_history_that_all_share_stands_once(make):
    parts = [make(clip).assign_attrs(history="one\ntwo") for clip in ("a", "b")]
    assert concat(parts).attrs["history"] == "one\ntwo"


def test_frames_of_which_nothing_is_known_are_taken_from_the_ends_of_clips(make):
    one, other = make("one"), make("other", seed=1)
    gap = one.isel(frame=slice(20)).copy(deep=True)
    gap["angle"][5:9], gap["root_position"][5:9] = np.nan, np.nan
    both = concat([lengthened(gap, 7), other.isel(frame=slice(10))])
    found = shortened(both)
    expected = concat([gap, other.isel(frame=slice(10))])
    np.testing.assert_array_equal(found["angle"], expected["angle"])
    assert found["clip"].values.tolist() == expected["clip"].values.tolist()
    assert shortened(found) is found
    nothing = gap.assign(angle=gap["angle"] * np.nan, root_position=gap["root_position"] * np.nan)
    assert shortened(nothing).sizes["frame"] == 2
