"""Pose features of the multifactor paper, there and back."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

from bayesmotion.errors import InputError
from bayesmotion.motion import (
    Skeleton,
    concat,
    make_motion,
    read_amc,
    rotations,
    skeleton_of,
    split,
)
from bayesmotion.motion.features import (
    Layout,
    check_one_clip,
    continuous,
    decode,
    encode,
    heading_of,
    layout_of,
)
from bayesmotion.motion.synthetic.walkers import synthetic_walkers

REAL = ("cmu/02/02_02.amc", "cmu/35/35_18.amc", "cmu/08/08_07.amc")


@pytest.fixture(scope="module")
def walkers() -> xr.Dataset:
    return synthetic_walkers(["ann", "ben"], ["walk", "run"], seconds=0.7)


@pytest.fixture(scope="module")
def walk(walkers) -> xr.Dataset:
    return split(walkers)["ann-walk"]


def there_and_back(motion: xr.Dataset, heading: float = 0.0) -> xr.Dataset:
    skeleton = skeleton_of(motion)
    layout = layout_of(skeleton)
    left_out = {str(dof): 0.0 for dof in motion["dof"].values}
    return decode(
        encode(motion, layout, heading),
        layout,
        skeleton,
        frame_rate=motion.attrs["frame_rate"],
        clip="again",
        start=motion["root_position"].values[0],
        rest=left_out,
        heading=heading,
    )


def joint_rotations(motion: xr.Dataset, name: str) -> np.ndarray:
    """Matrices of one joint by its channels, left to right."""
    skeleton = skeleton_of(motion)
    turned = np.eye(3)
    for channel in skeleton.joints[skeleton.index(name)].channels:
        angle = motion["angle"].sel(dof=f"{name}/{channel}").values
        turned = turned @ Rotation.from_euler(channel[1], angle[:, None]).as_matrix()
    return turned


def same_motion(motion: xr.Dataset, again: xr.Dataset) -> None:
    layout = layout_of(skeleton_of(motion))
    for name in layout.maps:
        np.testing.assert_allclose(
            joint_rotations(again, name), joint_rotations(motion, name), atol=1e-9, err_msg=name
        )
    for dof in layout.angles:
        np.testing.assert_allclose(again["angle"].sel(dof=dof), motion["angle"].sel(dof=dof))
    np.testing.assert_allclose(again["root_position"], motion["root_position"], atol=1e-9)


@pytest.mark.parametrize("clip", ["ann-walk", "ben-run"])
@pytest.mark.parametrize("heading", [0.0, 2.5])
def test_synthetic_motions_come_back(walkers, clip: str, heading: float):
    motion = split(walkers)[clip]
    same_motion(motion, there_and_back(motion, heading))


@pytest.mark.real_data
@pytest.mark.parametrize("trial", REAL)
def test_real_motions_come_back(data_root: Path, trial: str):
    motion = read_amc(data_root / trial).isel(frame=slice(240))
    same_motion(motion, there_and_back(motion, heading_of(motion)))


def test_what_is_not_in_the_features_rests(walk):
    layout = layout_of(skeleton_of(walk))
    again = decode(
        encode(walk, layout),
        layout,
        skeleton_of(walk),
        frame_rate=30.0,
        clip="rested",
        start=np.zeros(3),
        rest={"lwrist/ry": 0.4},
        labels={"gait": "walk"},
        source="made",
    )
    np.testing.assert_array_equal(again["angle"].sel(dof="lwrist/ry"), 0.4)
    np.testing.assert_array_equal(again["angle"].sel(dof="rthumb/rx"), 0.0)
    np.testing.assert_array_equal(again["root_position"].values[0], 0.0)
    assert set(again["gait"].values) == {"walk"}


PAPER_MAPS = {
    "root",
    "lowerback",
    "upperback",
    "thorax",
    "lowerneck",
    "upperneck",
    "head",
    "lhumerus",
    "rhumerus",
    "lfemur",
    "rfemur",
}
PAPER_ANGLES = {
    f"{side}{dof}"
    for side in "lr"
    for dof in ("radius/rx", "tibia/rx", "foot/rx", "foot/rz", "toes/rx")
}


def assert_papers(layout: Layout) -> None:
    assert layout.maps[0] == "root"
    assert set(layout.maps) == PAPER_MAPS
    assert set(layout.angles) == PAPER_ANGLES
    assert layout.n_angles == 43
    assert len(layout.labels) == len(set(layout.labels)) == 89


def test_the_body_has_the_papers_89_features(walk):
    layout = layout_of(skeleton_of(walk))
    assert_papers(layout)
    features = encode(walk, layout)
    assert features.shape == (walk.sizes["frame"], 89)
    for label in PAPER_ANGLES:
        column = features[:, layout.labels.index(label)]
        np.testing.assert_array_equal(column, walk["angle"].sel(dof=label))
        velocity = features[:, layout.labels.index(f"{label}/velocity")]
        np.testing.assert_array_equal(velocity[1:], np.diff(column))
        assert velocity[0] == velocity[1]
    travel = [layout.labels.index(f"travel/{axis}") for axis in "xyz"]
    np.testing.assert_array_equal(
        features[1:, travel], np.diff(walk["root_position"].values, axis=0)
    )
    maps = [layout.labels.index(f"lfemur/map_{axis}") for axis in "xyz"]
    np.testing.assert_allclose(
        Rotation.from_rotvec(features[:, maps]).as_matrix(),
        joint_rotations(walk, "lfemur"),
        atol=1e-12,
    )


@pytest.mark.real_data
@pytest.mark.parametrize("trial", REAL)
def test_real_bodies_have_the_papers_89_features(data_root: Path, trial: str):
    assert_papers(layout_of(skeleton_of(read_amc(data_root / trial))))


def test_other_joints_may_be_left_out(walk):
    skeleton = skeleton_of(walk)
    everything = layout_of(skeleton, ())
    assert everything.n_angles == len(skeleton.dofs)
    assert "lclavicle/rz" in everything.angles
    legless = layout_of(skeleton, ("FEMUR", "tibia", "foot", "toes"))
    assert not any("femur" in label or "toes" in label for label in legless.labels)


@pytest.mark.parametrize("n", [2, 7])
def test_features_of_the_first_frames_do_not_depend_on_later_ones(walk, n: int):
    layout = layout_of(skeleton_of(walk))
    np.testing.assert_array_equal(
        encode(walk.isel(frame=slice(n)), layout), encode(walk, layout)[:n]
    )


@pytest.mark.parametrize("axis", [(0.0, 1.0, 0.0), (0.6, 0.0, -0.8)])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_exponential_maps_run_on_through_whole_turns(axis, way: float):
    angle = way * np.linspace(-1.0, 22.0, 300)  # more than three turns
    short = Rotation.from_rotvec(angle[:, None] * np.array(axis)).as_rotvec()
    assert np.abs(np.diff(short, axis=0)).max() > 3.0
    found = continuous(short)
    np.testing.assert_allclose(found, angle[:, None] * np.array(axis), atol=1e-9)
    np.testing.assert_array_equal(found[0], short[0])


def test_maps_that_run_on_are_the_same_rotations():
    random = np.random.default_rng(0)
    path = np.cumsum(0.1 * random.normal(size=(500, 3)), axis=0)
    turned = Rotation.from_rotvec(path)
    found = continuous(turned.as_rotvec())
    np.testing.assert_allclose(
        Rotation.from_rotvec(found).as_matrix(), turned.as_matrix(), atol=1e-9
    )


def test_a_turning_body_has_smooth_features_and_comes_back(walk):
    """Someone turns on the spot three times; the features know no jump."""
    turning = walk.copy(deep=True)
    frames = walk.sizes["frame"]
    turn = np.linspace(0.0, 6.0 * np.pi, frames)
    order = [str(dof) for dof in walk["dof"].values if str(dof).startswith("root/")]
    for dof in order:
        turning["angle"].loc[{"dof": dof}] = turn if dof == "root/ry" else 0.0
    features = encode(turning, layout_of(skeleton_of(turning)))
    np.testing.assert_allclose(features[:, 1], turn, atol=1e-9)
    np.testing.assert_allclose(features[:, 43 + 1], turn[1], atol=1e-9)
    same_motion(turning, there_and_back(turning))


def turned_about_the_vertical(motion: xr.Dataset, angle: float) -> xr.Dataset:
    """The same motion seen by someone who stands elsewhere."""
    turn = Rotation.from_rotvec([0.0, angle, 0.0])
    out = motion.copy(deep=True)
    out["root_position"].values[:] = turn.apply(motion["root_position"].values) + np.array(
        [3.0, 0.0, 1.0]
    )
    channels = skeleton_of(motion).joints[0].channels
    order = "".join(channel[1].upper() for channel in channels)
    root = turn * Rotation.from_matrix(joint_rotations(motion, "root"))
    for channel, column in zip(channels, root.as_euler(order).T, strict=True):
        out["angle"].loc[{"dof": f"root/{channel}"}] = column
    return out


@pytest.mark.parametrize("angle", [0.4, 3.0, -2.0])
def test_features_without_heading_are_those_of_any_turned_clip(walk, angle: float):
    layout = layout_of(skeleton_of(walk))
    turned = turned_about_the_vertical(walk, angle)
    difference = heading_of(turned) - heading_of(walk) - angle
    assert np.cos(difference) == pytest.approx(1.0, abs=1e-9)
    expected = encode(walk, layout, heading_of(walk))
    np.testing.assert_allclose(encode(turned, layout, heading_of(turned)), expected, atol=1e-9)
    assert np.abs(encode(turned, layout) - expected).max() > 0.1


def test_heading_is_where_the_walk_goes(walk):
    assert heading_of(walk) == pytest.approx(0.0, abs=0.1)  # synthetic walkers go towards +z
    assert heading_of(turned_about_the_vertical(walk, np.pi / 2)) == pytest.approx(
        np.pi / 2, abs=0.1
    )
    # Someone who begins by going the other way is judged by the frames asked for.
    back = walk.copy(deep=True)
    back["root_position"].values[5:] -= np.array([0.0, 0.0, 10.0])
    assert abs(heading_of(back)) == pytest.approx(np.pi, abs=0.1)
    assert heading_of(back, 5) == pytest.approx(heading_of(walk, 5))


def test_who_stands_is_headed_where_the_root_faces(walk):
    standing = turned_about_the_vertical(walk, 1.1)
    standing["root_position"].values[:] = 0.0
    assert heading_of(standing) == pytest.approx(1.1, abs=0.2)


def test_angles_not_measured_leave_a_gap_and_no_more(walk):
    layout = layout_of(skeleton_of(walk))
    holed = walk.copy(deep=True)
    holed["angle"].loc[{"dof": "lfemur/rx", "frame": [0, 6]}] = np.nan
    expected, found = encode(walk, layout), encode(holed, layout)
    gap = np.zeros(found.shape, bool)
    place = layout.labels.index("lfemur/map_x")
    gap[[0, 6], place : place + 3] = True
    # Frame 0 takes the velocity of frame 1, and both need frame 0.
    gap[[[0], [1], [6], [7]], 43 + place + np.arange(3)] = True
    np.testing.assert_array_equal(np.isnan(found), gap)
    np.testing.assert_allclose(found[~gap], expected[~gap], atol=1e-9)


def test_gimbal_lock_comes_back_as_a_rotation(walk):
    locked = walk.copy(deep=True)
    middle = skeleton_of(walk).joints[skeleton_of(walk).index("lhumerus")].channels[1]
    locked["angle"].loc[{"dof": f"lhumerus/{middle}", "frame": 3}] = np.pi / 2
    again = there_and_back(locked)
    np.testing.assert_allclose(
        joint_rotations(again, "lhumerus"), joint_rotations(locked, "lhumerus"), atol=1e-7
    )


def test_what_cannot_be_encoded_is_told(walkers, walk):
    skeleton, layout = skeleton_of(walk), layout_of(skeleton_of(walk))
    one_axis = tuple(replace(j, channels=("ry",)) if j.parent == -1 else j for j in skeleton.joints)
    with pytest.raises(InputError, match="its root does not turn about three axes"):
        layout_of(Skeleton("stiff", one_axis))
    body = Skeleton("root only", skeleton.joints[:1])
    lonely = make_motion(body, np.zeros((3, 3)), np.zeros((3, 3)), frame_rate=30.0, clip="lonely")
    with pytest.raises(InputError, match=r"'root only': it has no joint head, lfemur"):
        encode(lonely, layout)
    with pytest.raises(InputError, match=r"'root only': it has no joint head, lfemur"):
        decode(
            encode(walk, layout),
            layout,
            body,
            frame_rate=30.0,
            clip="again",
            start=np.zeros(3),
            rest={},
        )
    with pytest.raises(InputError, match="clips ann-walk, ben-walk: one clip is needed"):
        check_one_clip(concat([walk, split(walkers)["ben-walk"]]))
    two = concat([walk, walk.assign_coords(clip=("frame", np.full(walk.sizes["frame"], "b")))])
    with pytest.raises(InputError, match="one clip is needed"):
        encode(two, layout)
    with pytest.raises(InputError, match="'ann-walk': it has one frame"):
        encode(walk.isel(frame=slice(1)), layout)
    assert check_one_clip(walk) == "ann-walk"


def test_rotations_of_the_whole_body_come_back(walk):
    """Forward kinematics sees the same body, where the joints left out rest alike."""
    rested = walk.copy(deep=True)
    for dof in map(str, walk["dof"].values):
        if dof.split("/")[0] not in PAPER_MAPS and dof not in PAPER_ANGLES:
            rested["angle"].loc[{"dof": dof}] = 0.0
    again = there_and_back(rested, 0.8)
    skeleton = skeleton_of(walk)
    np.testing.assert_allclose(
        rotations(skeleton, again["angle"].values),
        rotations(skeleton, rested["angle"].values),
        atol=1e-9,
    )
