"""ASF and AMC files as others write them: optional parts, other orders, other cases."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bayesmotion.errors import InputError
from bayesmotion.motion import positions, read, read_asf, skeleton_of

ASF = """\
:version 1.10
:name t
:units
  mass 1.0
  length 0.45
  angle deg
:documentation
  made by hand
:root
  order TX TY TZ RX RY RZ
  axis XYZ
  position 0 0 0
  orientation 0 0 0
:bonedata
  begin
    id 1
    name a
    direction 0 1 0
    length 10
    axis 0 0 0 XYZ
    dof rx ry rz
    limits (-180 180)
           (-180 180)
           (-180 180)
  end
  begin
    id 2
    name b
    direction 0 1 0
    length 5
    axis 0 0 0 XYZ
    dof rx
    limits (-180 180)
  end
:hierarchy
  begin
    root a
    a b
  end
"""
AMC = """\
:FULLY-SPECIFIED
:DEGREES
1
root 1 2 3 0 0 0
a 0 0 90
b 0
2
root 1 2 3 0 0 0
a 0 0 90
b 90
"""
# root, a, b and the end of b in the second frame: b, turned about its x, points along z.
PLACES = [[1, 2, 3], [1, 2, 3], [-9, 2, 3], [-9, 2, 8]]


def written(tmp_path: Path, asf: str, amc: str, name: str = "t_1.amc") -> Path:
    (tmp_path / "t.asf").write_text(asf)
    (tmp_path / name).write_text(amc)
    return tmp_path / name


# What is changed in the two files.
SAME = {
    "as it is": ("", "", "", ""),
    "axis in small letters": ("axis XYZ", "axis xyz", "", ""),
    "bones' axis": ("0 0 0 XYZ", "0 0 0 ZYX", "", ""),
    "no order of the axis": ("0 0 0 XYZ", "0 0 0", "", ""),
    "root's axis": ("axis XYZ\n  pos", "axis YZX\n  pos", "", ""),
    "root without rest": ("  axis XYZ\n  position 0 0 0\n  orientation 0 0 0\n", "", "", ""),
    "root order": ("TX TY TZ RX RY RZ", "RZ TY RX TX RY TZ",
                   "root 1 2 3 0 0 0", "root 0 2 0 1 0 3"),
    "hierarchy": ("    root a\n    a b\n", "    a b\n    root a\n", "", ""),
    "angle in degrees": ("angle deg", "angle degrees", "", ""),
    "no unit of angle": ("  angle deg\n", "", "", ""),
    "skin": (":hierarchy", ":skin file.obj\n:hierarchy", "", ""),
    "sections in capitals": (":bonedata", ":BONEDATA", "", ""),
    "hierarchy first": (":units", ":hierarchy\n root a\n a b\n:units", "", ""),
    "limits on one line": ("(-180 180)\n           (", "(-180 180) (", "", ""),
    "comments": ("length 10", "length 10 # inches", "a 0 0 90", "a 0 0 90 # elbow"),
    "all three": ("", "", ":DEGREES", ":FORCE-ALL-JOINTS-BE-3DOF\n:DEGREES"),
}  # fmt: skip


@pytest.mark.parametrize("kind", SAME)
def test_the_same_body_written_otherwise(tmp_path: Path, kind: str):
    old, new, before, after = SAME[kind]
    asf, amc = (ASF.replace(old, new) if old else ASF), (AMC.replace(before, after))
    if kind == "hierarchy first":
        asf = asf.rsplit(":hierarchy", 1)[0]
    if kind == "all three":
        amc = amc.replace("b 0", "b 0 0 0").replace("b 90", "b 90 0 0")
    assert not old or asf != ASF
    motion = read(written(tmp_path, asf, amc))
    np.testing.assert_allclose(positions(motion)[1], PLACES, atol=1e-12)
    assert motion.attrs["frame_rate"] == 120.0
    channels = ("rz", "ry", "rx") if kind == "all three" else ("rx",)
    assert skeleton_of(motion).joints[2].channels == channels


def test_the_order_of_a_bones_axis_counts(tmp_path: Path):
    path = tmp_path / "t.asf"
    path.write_text(ASF.replace("axis 0 0 0 XYZ\n    dof rx\n", "axis 10 20 30 ZXY\n    dof rx\n"))
    x, y, z = read_asf(path).joints[2].axis
    expected = Rotation.from_euler("zxy", [30, 10, 20], degrees=True)
    found = Rotation.from_euler("xyz", [x, y, z])
    np.testing.assert_allclose(found.as_matrix(), expected.as_matrix(), atol=1e-12)


def test_a_length_that_is_not_said_is_not_known(tmp_path: Path):
    path = tmp_path / "t.asf"
    path.write_text(ASF.replace("  length 0.45\n", ""))
    assert read_asf(path).metres is None


def test_the_rate_of_the_file_and_another(tmp_path: Path):
    path = written(tmp_path, ASF, ":SAMPLES-PER-SECOND 60\n" + AMC)
    assert read(path).attrs["frame_rate"] == 60.0
    assert read(path, frame_rate=59.94).attrs["frame_rate"] == 59.94
    written(tmp_path, ASF, ":SAMPLES-PER-SECOND 0\n" + AMC)
    with pytest.raises(InputError, match=r"t_1\.amc:1: :SAMPLES-PER-SECOND 0 is no frame rate"):
        read(path)


def test_the_case_of_suffixes_does_not_count(tmp_path: Path):
    path = written(tmp_path, ASF, AMC, "T_1.AMC")
    (tmp_path / "t.asf").rename(tmp_path / "T.ASF")
    assert skeleton_of(read(path)).name == "T"


def test_one_pose_can_be_read(tmp_path: Path):
    assert read(written(tmp_path, ASF, AMC.split("2\nroot")[0])).sizes["frame"] == 1


def test_bones_that_move_along_are_refused(tmp_path: Path):
    path = written(tmp_path, ASF.replace("dof rx\n", "dof rx l\n"), AMC)
    with pytest.raises(InputError, match=r"t\.asf:32: the degrees of freedom are rx l"):
        read(path)
