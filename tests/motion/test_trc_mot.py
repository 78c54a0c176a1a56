"""Markers in TRC, joint angles in MOT, and rotations in AMASS files."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

from bayesmotion.errors import InputError, MotionWarning
from bayesmotion.motion import (
    check,
    concat,
    make_markers,
    positions,
    read,
    rotations,
    skeleton_of,
    write,
)

TRC = """\
PathFileType\t4\t(X/Y/Z)\twalk.trc
DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames
59.9999\t60\t3\t2\tm\t60\t1\t3
Frame#\tTime\tLeft Knee\t\t\tRKNE\t\t\t
\t\tX1\tY1\tZ1\tX2\tY2\tZ2

1\t0.000\t1\t2\t3\t4\t5\t6
2\t0.017\t\t\t\t4\t5\t6
3\t0.033\t1\t2\t3\tnan\tNaN\tnan
"""
MOT = """\
walk
version=1
nRows=3
nColumns=7
inDegrees=yes
endheader
time\tpelvis_tilt\tpelvis_tx\tpelvis_ty\tpelvis_tz\tarm_rx\tarm_ry
0.00\t90\t1\t2\t3\t10\t20
0.01\t90\t1\t2\t4\t10\t20
0.02\t90\t1\t2\t5\t10\t20
"""


def written(tmp_path: Path, name: str, text: str) -> Path:
    (tmp_path / name).write_text(text)
    return tmp_path / name


def test_what_is_read_of_trc(tmp_path: Path):
    motion = read(written(tmp_path, "walk.trc", TRC))
    assert motion["joint"].values.tolist() == ["Left Knee", "RKNE"]
    assert motion.attrs["frame_rate"] == 60.0
    assert motion.attrs["metres"] == 1.0
    expected = np.tile(np.arange(1.0, 7.0).reshape(2, 3), (3, 1, 1))
    expected[1, 0] = expected[2, 1] = np.nan
    np.testing.assert_array_equal(motion["position"], expected)
    spaced = TRC.replace("Left Knee", "LKNE").replace("2\t0.017\t\t\t", "2\t0.017\t1\t2\t3")
    spaced = spaced.replace("\t", " ").replace("0.017 1 2 3 4", "0.017 1 2 3 4")
    spaced = spaced.replace("3  4 5 6", "3 4 5 6")
    again = read(written(tmp_path, "spaced.trc", spaced), frame_rate=50.0)
    assert again["joint"].values.tolist() == ["LKNE", "RKNE"]
    assert again.attrs["frame_rate"] == 50.0
    with pytest.warns(MotionWarning, match=r"walk\.trc:4: .* were numbered: RKNE_2"):
        read(written(tmp_path, "walk.trc", TRC.replace("Left Knee", "RKNE")))


def test_trc_written_reads_back(tmp_path: Path):
    position = np.random.default_rng(0).normal(size=(4, 3, 3))
    position[1, 2] = np.nan
    motion = make_markers(["a b", "c", "d"], position, frame_rate=59.94, clip="c", metres=0.001)
    write(motion, tmp_path / "c.trc")
    xr.testing.assert_equal(read(tmp_path / "c.trc"), motion)


def test_what_trc_cannot_hold_is_told(make, tmp_path: Path):
    markers = make_markers(["a"], np.ones((2, 1, 3)), frame_rate=9.0, clip="c")
    with pytest.raises(InputError, match=r"the unit of length is not known.*metres=0\.001"):
        write(markers, tmp_path / "c.trc")
    for motion in (make(), concat([markers, markers.assign_coords(clip=("frame", ["d", "d"]))])):
        with pytest.raises(InputError, match="a TRC file holds the markers of one clip"):
            write(motion, tmp_path / "c.trc")
    tab = markers.assign_coords(joint=["a\tb"]).assign_attrs(metres=1.0)
    with pytest.raises(InputError, match="TRC cannot hold this name"):
        write(tab, tmp_path / "c.trc")
    assert not list(tmp_path.glob("*.trc"))


@pytest.mark.parametrize(
    ("old", "new", "line", "what"),
    [
        ("PathFileType", "Path", "", "no TRC file"),
        ("59.9999", "x", ":3", "'x' is not a finite number"),
        ("59.9999", "0", ":3", "DataRate 0 is no frame rate"),
        ("60\t3\t2", "60\t9\t2", ":3", "9 frames are declared and 3 are there"),
        ("\t4\t5\t6\n2", "\t4\t5\n2", ":7", "7 columns for 2 markers"),
        ("1\t0.000\t1", "1\t0.000\tx", ":7", "'x' is not a finite number"),
        ("1\t0.000\t1", "1\t0.000\t1,5", ":7", "decimal comma"),
        ("Left Knee\t\t\tRKNE", "", ":4", "no markers are named"),
    ],
)
def test_bad_trc_is_told(tmp_path: Path, old: str, new: str, line: str, what: str):
    assert old in TRC
    with pytest.raises(InputError) as caught:
        read(written(tmp_path, "bad.trc", TRC.replace(old, new)))
    assert caught.value.where.endswith(f"bad.trc{line}")
    assert what in caught.value.what


def test_what_is_read_of_mot(tmp_path: Path):
    motion = read(written(tmp_path, "walk.mot", MOT))
    assert motion["dof"].values.tolist() == ["pelvis_tilt/rz", "arm/rx", "arm/ry"]
    np.testing.assert_allclose(np.degrees(motion["angle"]), np.tile([90.0, 10.0, 20.0], (3, 1)))
    assert motion["root_position"].values.tolist() == [[1, 2, 3], [1, 2, 4], [1, 2, 5]]
    assert motion.attrs["frame_rate"] == 100.0
    radians = written(tmp_path, "rad.mot", MOT.replace("=yes", " = no").replace("\t90", "\t1.5"))
    assert read(radians)["angle"].values[0, 0] == 1.5
    assert read(radians, frame_rate=50.0).attrs["frame_rate"] == 50.0
    more = MOT.replace("arm_rx", "knee_tx")
    with pytest.warns(MotionWarning, match=r"walk\.mot:7: knee_tx left out: only the root moves"):
        assert read(written(tmp_path, "walk.mot", more))["dof"].values[-1] == "arm/ry"
    assert check(motion) == []


def test_mot_written_reads_back(make, tmp_path: Path):
    motion = make(frames=6)
    write(motion, tmp_path / "walk.mot")
    again = read(tmp_path / "walk.mot", skeleton=skeleton_of(motion))
    np.testing.assert_allclose(again["angle"], motion["angle"], atol=1e-12)
    np.testing.assert_array_equal(again["root_position"], motion["root_position"])
    np.testing.assert_allclose(positions(again), positions(motion), atol=1e-9)
    free = read(tmp_path / "walk.mot")
    assert free["dof"].values.tolist() == motion["dof"].values.tolist()
    write(read(written(tmp_path, "a.mot", MOT)), tmp_path / "b.mot")
    columns = (tmp_path / "b.mot").read_text().splitlines()[6].split("\t")
    assert sorted(columns) == sorted(MOT.splitlines()[6].split("\t"))


@pytest.mark.parametrize(
    ("old", "new", "line", "what"),
    [
        ("endheader", "end", "", "no MOT file"),
        ("inDegrees=yes\n", "", ":1", "no line above endheader says inDegrees="),
        ("=yes", "=perhaps", ":5", "none of yes, no"),
        ("pelvis_tilt", "ground_force_vx", ":7", "'ground_force_vx' is a force"),
        ("arm_ry", "arm_rx", ":7", "the column 'arm_rx' stands twice"),
        ("time\t", "frame\t", ":7", "the first column is not 'time'"),
        ("0.01\t90", "0.01\t", ":9", "'' is not a finite number"),
        ("\t10\t20\n0.01", "\t10\n0.01", ":8", "6 values for 7 columns"),
        ("0.02", "0.05", ":7", "the times do not rise evenly"),
    ],
)
def test_bad_mot_is_told(tmp_path: Path, old: str, new: str, line: str, what: str):
    assert old in MOT
    with pytest.raises(InputError) as caught:
        read(written(tmp_path, "bad.mot", MOT.replace(old, new)))
    assert caught.value.where.endswith(f"bad.mot{line}")
    assert what in caught.value.what


@pytest.mark.parametrize("joints", [22, 24, 52, 55])
def test_the_rotations_of_amass_are_those_of_the_file(tmp_path: Path, joints: int):
    random = np.random.default_rng(joints)
    poses, trans = random.normal(size=(3, 3 * joints)), random.normal(size=(3, 3))
    path = tmp_path / "walk_poses.npz"
    np.savez(path, poses=poses, trans=trans, mocap_framerate=120.0, gender=np.array("x", object))
    motion = read(path)
    skeleton = skeleton_of(motion)
    assert skeleton.names[:4] == ("pelvis", "left_hip", "right_hip", "spine1")
    assert motion.attrs["frame_rate"] == 120.0
    np.testing.assert_array_equal(motion["root_position"], trans)
    turned = np.asarray(rotations(skeleton, motion["angle"].values))
    own = Rotation.from_rotvec(poses.reshape(-1, 3)).as_matrix().reshape(3, joints, 3, 3)
    for index, joint in enumerate(skeleton):
        above = turned[:, joint.parent] if joint.parent >= 0 else np.eye(3)
        np.testing.assert_allclose(turned[:, index], above @ own[:, index], atol=1e-12)
    # Nothing is longer than an average adult.
    assert np.ptp(positions(motion).values[0], axis=0).max() < 2.0


def test_bad_amass_files_are_told(tmp_path: Path):
    path = tmp_path / "bad.npz"
    with pytest.raises(InputError, match=r"bad\.npz: it cannot be read \(No such"):
        read(path)
    path.write_bytes(b"no archive")
    with pytest.raises(InputError, match=r"bad\.npz: it is no \.npz file of AMASS"):
        read(path)
    np.savez(path, poses=np.zeros((4, 7)))
    with pytest.raises(InputError, match=r"its poses have the shape \(4, 7\)"):
        read(path)
    np.savez(path, poses=np.array([{}, {}], dtype=object))
    with pytest.raises(InputError, match=r"bad\.npz: it is no \.npz file of AMASS"):
        read(path)
    np.savez(path, poses=np.zeros((4, 66)))
    with pytest.raises(InputError, match=r"mocap_framerate 0 is no frame rate.*frame_rate=30"):
        read(path)
    assert read(path, frame_rate=30.0).sizes["frame"] == 4
    np.savez(path, poses=np.full((4, 66), np.nan), mocap_framerate=30.0)
    with pytest.raises(InputError, match=r"bad\.npz, frame 0: a pose is not finite"):
        read(path)
