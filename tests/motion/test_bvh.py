"""Reading and writing BVH."""

from pathlib import Path

import numpy as np
import pybvh
import pytest
import xarray as xr

from bayesmotion.errors import InputError
from bayesmotion.motion import (
    Joint,
    Skeleton,
    concat,
    make_motion,
    positions,
    read_amc,
    read_bvh,
    skeleton_of,
    write_bvh,
)

BVH = """\
HIERARCHY
ROOT Hips
{
  OFFSET 1 2 3
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Leg
  {
    OFFSET 0 -4 0
    CHANNELS 3 Yrotation Zrotation Xrotation
    End Site
    {
      OFFSET 0 -3 1
    }
  }
}
MOTION
Frames: 3
Frame Time: 0.0083333
0 10 0 0 0 0 0 0 0
1 10 0 10 20 30 40 50 60
2 10 0 10 20 30 40 50 60
"""


@pytest.fixture
def bvh(tmp_path: Path) -> Path:
    path = tmp_path / "leg.bvh"
    path.write_text(BVH)
    return path


def by_pybvh(path: Path) -> np.ndarray:
    return pybvh.read_bvh_file(path, world_up="+y").node_positions()


def test_what_is_read(bvh: Path):
    motion = read_bvh(bvh, labels={"gait": "walk"})
    skeleton = skeleton_of(motion)
    assert skeleton.names == ("Hips", "Leg", "Leg_end")
    assert skeleton.metres is None
    assert skeleton.joints[1].channels == ("ry", "rz", "rx")
    assert motion.attrs["frame_rate"] == 120.0
    assert np.degrees(motion["angle"].sel(dof="Leg/rz").values[1]) == pytest.approx(50.0)
    assert motion["gait"].values[0] == "walk"
    np.testing.assert_allclose(positions(motion), by_pybvh(bvh), atol=1e-12)
    assert motion.attrs["history"] == ""


def test_the_first_frame_can_be_left_out(bvh: Path):
    motion = read_bvh(bvh, skip_first_frame=True)
    assert motion["root_position"].values[:, 0].tolist() == [1.0, 2.0]
    assert motion["time"].values[0] == 0.0
    assert motion.attrs["history"] == "read_bvh: without the first frame"


def test_bvh_written_reads_back(bvh: Path, tmp_path: Path):
    motion = read_bvh(bvh)
    write_bvh(motion, tmp_path / "out" / "leg.bvh")
    xr.testing.assert_allclose(read_bvh(tmp_path / "out" / "leg.bvh"), motion, atol=1e-8)


def test_asf_bones_written_are_in_the_same_places(make, tmp_path: Path):
    motion = make(frames=200)
    motion["angle"] = 6.0 * motion["angle"]  # over the poles and around
    write_bvh(motion, tmp_path / "walk.bvh")
    assert skeleton_of(read_bvh(tmp_path / "walk.bvh")).names == skeleton_of(motion).names
    np.testing.assert_allclose(by_pybvh(tmp_path / "walk.bvh"), positions(motion), atol=1e-5)


def test_angles_run_on_from_frame_to_frame(make, tmp_path: Path):
    motion = make(frames=200)
    write_bvh(motion, tmp_path / "walk.bvh")
    steps = np.abs(np.diff(read_bvh(tmp_path / "walk.bvh")["angle"], axis=0))
    assert np.degrees(steps).max() < 20.0


def test_gimbal_lock_and_a_root_with_an_offset(tmp_path: Path):
    body = Skeleton(
        "odd",
        (
            Joint("root", -1, (1.0, 2.0, 3.0), channels=("ry",)),
            Joint("arm", 0, (0.0, 1.0, 0.0), (0.3, 0.0, 0.0), ("rx", "ry", "rz")),
            Joint("hand", 1, (0.0, 1.0, 0.5)),
            Joint("nail", 2, (0.0, 1.0, 0.5)),
            Joint("nail_end", 3, (0.0, 0.0, 0.0)),
        ),
    )
    angle = np.zeros((3, 4))
    angle[:, 2] = np.pi / 2
    angle[1, 0] = 0.4
    motion = make_motion(body, angle, np.zeros((3, 3)), frame_rate=60.0, clip="odd")
    write_bvh(motion, tmp_path / "odd.bvh")
    np.testing.assert_allclose(by_pybvh(tmp_path / "odd.bvh"), positions(motion), atol=1e-5)
    assert skeleton_of(read_bvh(tmp_path / "odd.bvh")).names == body.names


def test_the_rate_can_be_given(make, tmp_path: Path):
    write_bvh(make(), tmp_path / "walk.bvh", frame_rate=30.0)
    assert read_bvh(tmp_path / "walk.bvh").attrs["frame_rate"] == 30.0


@pytest.mark.real_data
@pytest.mark.parametrize("trial", ["02/02_02", "49/49_04"])
def test_real_amc_written_as_bvh_is_in_the_same_places(data_root: Path, tmp_path: Path, trial: str):
    motion = read_amc(data_root / "cmu" / f"{trial}.amc")
    write_bvh(motion, tmp_path / "out.bvh")
    np.testing.assert_allclose(by_pybvh(tmp_path / "out.bvh"), positions(motion), atol=1e-5)


BAD_BVH = {
    "empty": ("HIERARCHY", None, "", "empty"),
    "no text": ("ROOT", "RO\x00OT", ":2", "not text"),
    "channels": ("CHANNELS 3 Yrotation", "CHANNELS 4 Yscale Yrotation", ":9", "'Yscale'"),
    "offset": ("OFFSET 0 -4 0", "OFFSET 0 -4", ":8", "not three numbers"),
    "offset word": ("OFFSET 0 -4 0", "OFFSET 0 -4 x", ":8", "'x' is not a finite number"),
    "no root": ("ROOT Hips", "JOINT Hips", ":2", "outside of a ROOT"),
    "no name": ("ROOT Hips", "ROOT", ":2", "ROOT has no name"),
    "count": ("Frames: 3", "Frames: 5", ":17", "5 frames are declared and 3 are there"),
    "no count": ("Frames: 3\n", "", "", "no line 'Frames:'"),
    "no number": ("2 10 0 10 20 30", "2 10 0 10 20 drei", ":21", "drei"),
    "truncated": ("2 10 0 10 20 30 40 50 60", "2 10 0", ":21", "3 values for 9 channels"),
    "nan": ("1 10 0 10 20 30", "1 10 0 nan 20 30", ":20", "not a finite number"),
}


@pytest.mark.parametrize("case", BAD_BVH)
def test_bad_bvh_is_told_with_file_and_line(tmp_path: Path, case: str):
    old, new, line, what = BAD_BVH[case]
    text = "" if new is None else BVH.replace(old, new, 1)
    path = tmp_path / "bad.bvh"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_bvh(path)
    assert caught.value.where.endswith(f"bad.bvh{line}")
    assert what in caught.value.what


def test_a_missing_file_is_told(tmp_path: Path):
    with pytest.raises(InputError, match=r"none\.bvh: it cannot be read"):
        read_bvh(tmp_path / "none.bvh")


def test_skipping_must_leave_a_frame(tmp_path: Path):
    path = tmp_path / "one.bvh"
    path.write_text(BVH.replace("Frames: 3", "Frames: 1").split("\n1 10", 1)[0] + "\n")
    assert read_bvh(path).sizes["frame"] == 1
    with pytest.raises(InputError, match=r"one\.bvh: there is only one frame"):
        read_bvh(path, skip_first_frame=True)


def test_what_bvh_cannot_say_is_told(make, tmp_path: Path):
    with pytest.raises(InputError, match="one clip"):
        write_bvh(concat([make("a"), make("b", seed=1)]), tmp_path / "out.bvh")
    with pytest.raises(InputError, match=r"out\.txt"):
        write_bvh(make(), tmp_path / "out.txt")
    hole = make()
    hole["root_position"][3, 1] = np.nan
    with pytest.raises(InputError, match="frame 3"):
        write_bvh(hole, tmp_path / "out.bvh")
    with pytest.raises(InputError, match="root/rx missing"):
        write_bvh(make().drop_sel(dof="root/rx"), tmp_path / "out.bvh")
    assert not list(tmp_path.glob("out*"))
