"""Finding defects of recordings, and only those."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bayesmotion.errors import InputError
from bayesmotion.motion import (
    Finding,
    Joint,
    Skeleton,
    check,
    concat,
    describe,
    drop,
    make_markers,
    make_motion,
    read_amc,
    read_bvh,
)


def changed(motion: xr.Dataset, frames, **columns) -> xr.Dataset:
    """Overwrite some frames of some degrees of freedom (or all, or the root)."""
    motion = motion.copy(deep=True)
    for name, value in columns.items():
        if name == "root":
            motion["root_position"][frames] += value
        elif name == "all":
            motion["angle"][frames] = value
        else:
            motion["angle"].loc[{"dof": name.replace("_", "/")}][frames] = value
    return motion


def found(motion: xr.Dataset) -> list[tuple[str, tuple[int, int], int]]:
    return [(f.kind, f.frames, len(f.drop)) for f in check(motion)]


def test_a_sound_motion_has_no_findings(make):
    assert check(concat([make("a"), make("b", seed=1)])) == []
    assert describe([]) == "Nothing found.\n"


def test_leading_rest_pose(make):
    motion = changed(make("a"), slice(0, 2), all=0.0)
    assert found(motion) == [("rest pose", (0, 1), 2)]
    assert "a: rest pose: " in describe(check(motion))
    assert "Leaving out 2 frames mends it." in describe(check(motion))


def test_a_limb_solved_late(make):
    motion = changed(make("a"), slice(0, 5), larm_ry=0.0, larm_rz=0.0)
    (finding,) = check(motion)
    assert (finding.kind, finding.frames, finding.drop) == ("rest pose", (0, 4), (0, 1, 2, 3, 4))
    assert finding.sentence.startswith("larm in")


def test_long_rest_is_told_but_not_dropped(make):
    motion = changed(make("a", frames=200), slice(0, 80), larm_ry=0.0, larm_rz=0.0)
    assert found(motion) == [("rest pose", (0, 79), 0)]


def test_starting_from_zero_gradually_is_no_finding(make):
    motion = make("a")
    motion["angle"] = motion["angle"] * np.minimum(np.arange(60) / 30.0, 1.0)[:, None]
    assert check(motion) == []


@pytest.mark.parametrize(
    ("start", "frames", "dropped"),
    [(30, (29, 30), 0), (3, (2, 3), 3), (57, (56, 57), 3)],
)
def test_a_jump_of_the_whole_body(make, start: int, frames: tuple, dropped: int):
    motion = changed(make("a"), slice(start, None), root=np.array([5.0, 0.0, 0.0]))
    assert found(motion) == [("jump", frames, dropped)]


def test_a_jump_there_and_back_is_one_finding(make):
    motion = changed(make("a"), slice(30, 33), root=np.array([5.0, 0.0, 0.0]))
    assert found(motion) == [("jump", (29, 33), 0)]


def test_a_flip_is_not_a_whole_turn(make):
    flipped = changed(make("a"), slice(30, None), head_ry=3.0)
    assert ("flip", (29, 30), 0) in found(flipped)
    turned = make("a")
    turned["angle"][30:] += 2.0 * np.pi
    assert check(turned) == []


def test_frozen_stretches(make):
    motion = make("a")
    motion["root_position"] = 0.1 * motion["root_position"]
    for frames in (slice(0, 4), slice(20, 23), slice(40, 42)):
        for name in motion.data_vars:
            motion[name][frames] = motion[name][frames][0].values
    assert found(motion) == [("frozen", (0, 3), 4), ("frozen", (20, 22), 0)]


def test_below_the_floor(make):
    motion = make("a", frames=200)
    dip = np.zeros(200)
    dip[80:120] = -8.0 * np.sin(np.linspace(0.0, np.pi, 40))
    motion["root_position"][:, 1] += dip
    (finding,) = check(motion)
    assert finding.kind == "floor"
    assert 80 <= finding.frames[0] < finding.frames[1] <= 120
    assert "leg lengths" in finding.sentence


def test_missing_values(make):
    motion = changed(make("a"), slice(0, 2), larm_ry=np.nan)
    motion = changed(motion, slice(30, 31), root=np.nan)
    assert found(motion) == [("missing", (0, 1), 2), ("missing", (30, 30), 0)]


def test_what_a_skeleton_lacks_is_not_missing(make):
    markers = np.random.default_rng(0).normal(size=(5, 2, 3))
    markers[:] = markers[0] + 0.001 * np.arange(5)[:, None, None]
    assert check(make_markers(["a", "b"], markers, frame_rate=9.0, clip="m")) == []
    markers[3] += 1000.0
    markers[1, 0] = np.nan
    motion = make_markers(["a", "b"], markers, frame_rate=9.0, clip="m")
    assert found(motion) == [("jump", (2, 4), 0), ("missing", (1, 1), 0)]


@pytest.mark.parametrize("leg", [0.0, 0.5])
def test_a_body_without_legs_stands_on_no_floor(leg: float):
    joints = (
        Joint("hips", -1, (0.0, 0.0, 0.0), channels=("rz",)),
        Joint("spine", 0, (0.0, 10.0, 0.0), channels=("rz",)),
        Joint("tail", 0, (0.0, -leg, 0.0)),
    )
    path = np.zeros((60, 3))
    path[:, 1] = np.sin(np.arange(60) / 4.0)
    angle = 0.1 * np.sin(np.arange(60) / 3.0)[:, None] * np.ones(2)
    body = Skeleton("upper", joints)
    assert check(make_motion(body, angle, path, frame_rate=30.0, clip="a")) == []


def test_a_limb_that_hangs_from_the_other_side(skeleton: Skeleton):
    names = ("Hips", "LeftUpLeg", "RightUpLeg", "Spine", "LeftArm", "RightArm")
    for parents, found in (
        ((-1, 0, 0, 0, 3, 3), []),
        ((-1, 0, 1, 0, 3, 3), ["RightUpLeg hangs below LeftUpLeg"]),
        ((-1, 0, 0, 2, 3, 3), ["LeftArm hangs below RightUpLeg"]),
    ):
        joints = tuple(
            Joint(name, parent, (0.0, 1.0, 0.0), channels=("rx",))
            for name, parent in zip(names, parents, strict=True)
        )
        angle = 0.1 * np.sin(np.arange(9.0)[:, None] + np.arange(6.0))
        body = Skeleton("body", joints)
        findings = check(make_motion(body, angle, np.zeros((9, 3)), frame_rate=9.0, clip="a"))
        assert [finding.sentence.split(",")[0] for finding in findings] == found


@pytest.mark.filterwarnings("error")
def test_bodies_without_extent_and_markers_that_were_never_seen():
    point = Skeleton("point", (Joint("a", -1, (0.0, 0.0, 0.0), channels=("rx",)),))
    angle = np.arange(3.0)[:, None]
    assert check(make_motion(point, angle, np.zeros((3, 3)), frame_rate=9.0, clip="a")) == []
    never = np.full((3, 2, 3), np.nan)
    never[1, 0] = 1.0
    (finding,) = check(make_markers(["a", "b"], never, frame_rate=9.0, clip="m"))[:1]
    assert finding.kind == "missing"


def test_a_jump_is_found_though_some_marker_is_always_hidden():
    markers = np.tile(np.eye(3), (30, 1, 1)) + 0.001 * np.arange(30)[:, None, None]
    markers[::2, 0] = np.nan
    markers[1::2, 1] = np.nan
    markers[15:, 2] += 50.0
    findings = check(make_markers(["a", "b", "c"], markers, frame_rate=9.0, clip="m"))
    assert ("jump", (14, 15)) in [(finding.kind, finding.frames) for finding in findings]


def test_dropping_mends(make):
    both = concat([make("a"), changed(make("b", seed=1), slice(0, 2), all=0.0)])
    findings = check(both)
    assert [finding.clip for finding in findings] == ["b"]
    mended = drop(both, findings)
    assert check(mended) == []
    assert mended.sizes["frame"] == 118
    assert mended["time"].values[60] == 0.0
    np.testing.assert_array_equal(mended["angle"][60:], both["angle"][62:])
    assert mended["dof"].equals(both["dof"])
    assert mended.attrs["history"] == "drop: 2 frames at the ends of clip b"
    xr.testing.assert_identical(drop(both, []), both)


def test_what_cannot_be_dropped_is_told(make):
    motion = make("a")
    for frames in ((3,), tuple(range(59))):
        with pytest.raises(InputError, match="clip 'a': without"):
            drop(motion, [Finding("a", "jump", (3, 3), "", frames)])
    with pytest.raises(InputError, match="clip 'b': there is no such clip"):
        drop(motion, [Finding("b", "jump", (3, 3), "", (0,))])


@pytest.mark.real_data
@pytest.mark.parametrize(
    "trial", ["02/02_01", "16/16_01", "16/16_35", "35/35_01", "35/35_17", "35/35_18", "49/49_12"]
)
def test_ordinary_clips_have_no_findings(data_root: Path, trial: str):
    assert describe(check(read_amc(data_root / "cmu" / f"{trial}.amc"))) == "Nothing found.\n"


@pytest.mark.real_data
def test_the_t_pose_of_the_bvh_release(data_root: Path):
    motion = read_bvh(data_root / "cmu/02/02_02.bvh")
    assert found(motion) == [("rest pose", (0, 0), 1)]
    assert check(drop(motion, check(motion))) == []


@pytest.mark.real_data
def test_defects_of_real_recordings(data_root: Path):
    cmu = data_root / "cmu"
    assert found(read_amc(cmu / "16/16_15.amc"))[:1] == [("rest pose", (0, 1), 2)]
    assert ("jump", (5, 6), 6) in found(read_amc(cmu / "08/08_07.amc"))
    assert found(read_amc(cmu / "49/49_04.amc"))[-1] == ("frozen", (244, 250), 7)
    late = read_amc(cmu / "03/03_02.amc")
    assert ("rest pose", (0, 49), 50) in found(late)
    assert "lowerneck, upperneck, head" in describe(check(late))
