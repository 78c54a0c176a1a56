"""BVH files as programs of the field write them: read right, or refused for the true reason."""

import contextlib
import warnings
from pathlib import Path

import numpy as np
import pytest

from bayesmotion.errors import InputError, MotionWarning
from bayesmotion.motion import (
    Joint,
    Skeleton,
    make_motion,
    positions,
    read,
    read_bvh,
    skeleton_of,
    write_bvh,
)

THREE = "CHANNELS 3 Zrotation Xrotation Yrotation"
SIX = "CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation"
BODY = f"""\
HIERARCHY
ROOT Hips
{{
  OFFSET 0 0 0
  {SIX}
  JOINT Spine
  {{
    OFFSET 0 10 0
    {THREE}
    End Site
    {{
      OFFSET 0 5 0
    }}
  }}
}}
MOTION
Frames: 3
Frame Time: 0.033333
1 90 3 0 0 0 90 0 0
1 91 3 0 0 0 90 0 0
1 92 3 0 0 90 0 0 0
"""
PLACES = [[1, 90, 3], [1, 100, 3], [-4, 100, 3]]  # of the first frame


def frames(*rows: str) -> str:
    return BODY.split("1 90 3")[0] + "".join(f"{row}\n" for row in rows)


def swapped(*pairs: tuple[str, str], text: str = BODY) -> str:
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    return text


def six(offset: str, *bones: str) -> str:
    rows = [f"1 {90 + i} 3 0 0 0 {bone} 90 0 0" for i, bone in enumerate(bones)]
    return swapped((THREE, SIX), ("OFFSET 0 10 0", offset), text=frames(*rows))


def written(tmp_path: Path, text: str | bytes, name: str = "body.bvh") -> Path:
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
    return path


SAME = {
    "as it is": BODY,
    "six channels": six("OFFSET 0 10 0", "0 10 0", "0 10 0", "0 10 0"),
    "bones in the positions": six("OFFSET 0 0 0", "0 10 0", "0 10 0", "0 10 0"),
    "order of positions": swapped(
        ("Xposition Yposition Zposition", "Zposition Xposition Yposition"),
        ("1 90 3", "3 1 90"),
        ("1 91 3", "3 1 91"),
        ("1 92 3", "3 1 92"),
    ),
    "positions behind": swapped(
        (SIX, f"{SIX[:11]}Zrotation Xrotation Yrotation Xposition Yposition Zposition"),
        ("1 90 3 0 0 0", "0 0 0 1 90 3"),
        ("1 91 3 0 0 0", "0 0 0 1 91 3"),
        ("1 92 3 0 0 90", "0 0 90 1 92 3"),
    ),
    "root without positions": swapped(
        ("OFFSET 0 0 0", "OFFSET 1 90 3"), (SIX, THREE), text=frames("0 0 0 90 0 0")
    ).replace("Frames: 3", "Frames: 1"),
    "keywords in capitals": BODY.upper().replace("HIPS", "Hips").replace("SPINE", "Spine"),
    "keywords in small letters": BODY.lower().replace("hips", "Hips").replace("spine", "Spine"),
    "no space": swapped(("Time: 0", "Time:0")),
    "space before the colon": swapped(("Frames:", "Frames :"), ("Time:", "Time :")),
    "frame time first": swapped(
        ("Frames: 3\nFrame Time: 0.033333\n", "Frame Time: 0.033333\nFrames: 3\n")
    ),
    "frames as a float": swapped(("Frames: 3", "Frames: 3.0")),
    "one line": swapped(("\n", " "), text=BODY.split("MOTION")[0]) + "\nMOTION" +
    BODY.split("MOTION")[1],
    "comments": swapped(("MOTION", "# exported\nMOTION"), ("1 91", "# note\n1 91")),
    "Ctrl-Z": BODY + "\x1a",
    "NUL": BODY + "\0\0\0",
    "CR": BODY.replace("\n", "\r"),
    "CR LF": BODY.replace("\n", "\r\n"),
    "byte order mark": b"\xef\xbb\xbf" + BODY.encode(),
    "UTF-16": BODY.encode("utf-16"),
    "UTF-16, the other way round": b"\xfe\xff" + BODY.encode("utf-16-be"),
}  # fmt: skip


@pytest.mark.parametrize("kind", SAME)
def test_the_same_body_written_otherwise(tmp_path: Path, kind: str):
    motion = read(written(tmp_path, SAME[kind], "body.BVH"))
    assert skeleton_of(motion).names == ("Hips", "Spine", "Spine_end")
    assert motion.attrs["frame_rate"] == 30.0
    np.testing.assert_allclose(positions(motion)[0], PLACES, atol=1e-12)


REFERENCE = """\
HIERARCHY
ROOT Reference
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation
  JOINT Hips
  {
    OFFSET 0 90 0
    CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation
    JOINT Spine
    {
      OFFSET 0 10 0
      CHANNELS 3 Zrotation Yrotation Xrotation
    }
  }
}
MOTION
Frames: 3
Frame Time: 0.01
0 0 0 0 0 0 1 90 3 0 0 0 90 0 0
0 0 0 0 0 0 1 91 4 0 0 20 90 0 0
0 0 0 0 0 0 1 92 5 0 0 30 90 0 0
"""


@pytest.mark.parametrize("root", ["six channels", "none", "no line"])
def test_a_still_root_above_the_hips_is_taken_off(tmp_path: Path, root: str):
    text = REFERENCE
    if root != "six channels":
        channels = "\n  CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation"
        text = text.replace(channels, "\n  CHANNELS 0" if root == "none" else "", 1)
        text = text.replace("\n0 0 0 0 0 0 ", "\n")
    motion = read_bvh(written(tmp_path, text))
    assert skeleton_of(motion).names == ("Hips", "Spine")
    where = positions(motion)
    np.testing.assert_allclose(where.sel(joint="Hips"), [[1, 90, 3], [1, 91, 4], [1, 92, 5]])
    np.testing.assert_allclose(where.sel(joint="Spine")[0], [1, 100, 3])


def test_a_root_that_is_turned_turns_what_is_below(tmp_path: Path):
    text = REFERENCE.replace("\n0 0 0 0 0 0 ", "\n7 0 0 0 0 -90 ")  # z up to y up
    motion = read_bvh(written(tmp_path, text))
    # Rx(-90) takes (x, y, z) to (x, z, -y).
    where = positions(motion)
    np.testing.assert_allclose(
        where.sel(joint="Hips"), [[8, 3, -90], [8, 4, -91], [8, 5, -92]], atol=1e-9
    )
    np.testing.assert_allclose(where.sel(joint="Spine")[0], [8, 3, -100], atol=1e-9)


def test_bones_that_change_their_length_are_refused_by_name(tmp_path: Path):
    text = six("OFFSET 0 10 0", "0 10 0", "0 12 0", "0 14 0")
    with pytest.raises(InputError, match=r"bvh:6: 'Spine' changes its length by 4 in frame 2"):
        read_bvh(written(tmp_path, text))
    text = six("OFFSET 0 10 0", "0 10 0", "6 8 0", "0 10 0")
    with pytest.raises(InputError, match=r"bvh:6: 'Spine' moves by 6.32 against its parent"):
        read_bvh(written(tmp_path, text))


def test_positions_that_are_zero_leave_the_offset_and_are_told(tmp_path: Path):
    path = written(tmp_path, six("OFFSET 0 10 0", "0 0 0", "0 0 0", "0 0 0"))
    with pytest.warns(MotionWarning, match=r"bvh:6: the positions of 1 joints \(Spine first\)"):
        motion = read_bvh(path)
    np.testing.assert_allclose(positions(motion)[0], PLACES, atol=1e-12)


@pytest.mark.parametrize(
    ("channels", "turns"), [("CHANNELS 1 Xrotation", "90"), ("CHANNELS 0", ""), ("", "")]
)
def test_joints_with_fewer_rotations(tmp_path: Path, channels: str, turns: str):
    rows = [f"1 90 3 0 0 0 {turns}"] * 3
    motion = read_bvh(written(tmp_path, swapped((f"    {THREE}", channels), text=frames(*rows))))
    end = [1, 100, 8] if turns else [1, 105, 3]
    np.testing.assert_allclose(positions(motion).sel(joint="Spine_end")[0], end, atol=1e-12)
    assert skeleton_of(motion).joints[1].channels == (("rx",) if turns else ())


@pytest.mark.parametrize("name", ["Left Hip", "Bip01 L Thigh", "mixamorig:Spine.001", "JOINT a"])
def test_names_are_read_whole_and_written_again(tmp_path: Path, name: str):
    motion = read_bvh(written(tmp_path, swapped(("Spine", name))))
    assert skeleton_of(motion).names == ("Hips", name, f"{name}_end")
    write_bvh(motion, tmp_path / "again.bvh")
    assert skeleton_of(read_bvh(tmp_path / "again.bvh")).names == skeleton_of(motion).names


@pytest.mark.parametrize(
    ("name", "encoding"),
    [("Hüfte", "latin-1"), ("腰", "utf-8"), ("センター", "shift-jis"), ("Hüfte", "utf-16")],
)
def test_encodings(tmp_path: Path, name: str, encoding: str):
    motion = read_bvh(written(tmp_path, swapped(("Hips", name)).encode(encoding)))
    assert skeleton_of(motion).names[0] == name


def test_names_that_stand_twice_are_numbered(tmp_path: Path):
    with pytest.warns(MotionWarning, match=r"bvh:6: a second joint is called 'Hips'.*'Hips_2'"):
        motion = read_bvh(written(tmp_path, swapped(("Spine", "Hips"))))
    assert skeleton_of(motion).names == ("Hips", "Hips_2", "Hips_end")


def test_several_ends_have_names_of_their_own(tmp_path: Path):
    end = "    End Site\n    {\n      OFFSET 0 5 0\n    }\n"
    joint = f"    JOINT Spine_end\n    {{\n      OFFSET 1 5 0\n      {THREE}\n    }}\n"
    text = swapped((end, end + end + joint), text=frames(*["1 90 3 0 0 0 90 0 0 0 0 0"] * 3))
    motion = read_bvh(written(tmp_path, text))
    names = ("Hips", "Spine", "Spine_end_2", "Spine_end_3", "Spine_end")
    assert skeleton_of(motion).names == names
    write_bvh(motion, tmp_path / "again.bvh")
    again = read_bvh(tmp_path / "again.bvh")
    assert skeleton_of(again).names == names
    np.testing.assert_allclose(positions(again), positions(motion), atol=1e-5)


def test_one_frame_more_or_less_than_declared_is_told(tmp_path: Path):
    for count in (2, 4):
        path = written(tmp_path, swapped(("Frames: 3", f"Frames: {count}")))
        with pytest.warns(MotionWarning, match=rf"bvh:17: {count} frames are .* and 3 are there"):
            assert read_bvh(path).sizes["frame"] == 3


def test_the_rate_can_be_said_where_the_file_is_rounded_or_wrong(tmp_path: Path):
    for time in ("0.033", "0", "30", "1e-320", "nan", "0,033"):
        path = written(tmp_path, swapped(("0.033333", time)))
        motion = read(path, frame_rate=30.0)
        assert motion.attrs["frame_rate"] == 30.0
        np.testing.assert_allclose(motion["time"], [0.0, 1 / 30, 2 / 30])
        if time != "0.033":
            with pytest.raises(InputError, match=r"body\.bvh:18: "):
                read(path)


def test_clips_of_almost_one_rate_join_after_being_told(tmp_path: Path):
    files = [
        written(tmp_path, swapped(("0.033333", time)), f"{name}.bvh")
        for name, time in (("a", "0.00833"), ("b", "0.0083333"))
    ]
    with pytest.warns(MotionWarning, match=r"120\.048 frames a second are brought to 120"):
        motion = read(*files)
    assert motion.attrs["frame_rate"] == 120.0
    np.testing.assert_allclose(motion["time"][:3], np.arange(3) / 120.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read(*files, frame_rate=120.0).attrs["frame_rate"] == 120.0


REFUSED = {
    "ZXZ": (swapped(("3 Zrotation Xrotation Yrotation\n    E", "3 Zrotation Xrotation Zrotation\n"
            "    E")), ":9", "'Spine' turns about Z twice"),
    "cut": (BODY[:-8], ":21", "6 values for 9 channels"),
    "missing space": (swapped(("1 91 3 0", "1 91 30")), ":20", "8 values for 9 channels"),
    "extra value": (swapped(("1 90 3 0", "1 90 3 0 0")), ":19", "10 values for 9 channels"),
    "wrapped": (swapped(("0 0 0 90", "0 0 0\n90")), ":19", "6 values for 9 channels"),
    "comma": (swapped(("1 90 3", "1 90,5 3")), ":19", "it has a decimal comma"),
    "comma in the time": (swapped(("0.0333", "0,0333")), ":18", "decimal comma"),
    "IND": (swapped(("1 90 3", "-1.#IND00 90 3")), ":19", "'-1.#IND00' is not a finite"),
    "QNAN at the end": (swapped(("1 91 3 0 0 0 90 0 0", "1 91 3 0 0 0 90 0 1.#QNAN")), ":20",
            "'1.#QNAN' is not a finite"),
    "two roots": (swapped(("MOTION", "ROOT B\n{\n OFFSET 0 0 0\n}\nMOTION")), ":16",
                  "two skeletons"),
    "lost brace": (swapped(("    }\n  }\n", "    }\n")), ":2", "'{' of 'Hips' is not closed"),
    "brace too many": (swapped(("}\nMOTION", "}\n}\nMOTION")), ":16", "closes nothing"),
    "offset nan": (swapped(("OFFSET 0 10 0", "OFFSET nan 10 0")), ":8", "'nan' is not a finite"),
    "offset too large": (swapped(("OFFSET 0 10 0", "OFFSET 0 1e999 0")), ":8", "not a finite"),
    "frames lost": (swapped(("Frames: 3", "Frames: 9")), ":17", "9 frames are declared and 3"),
    "channel unknown": (swapped(("3 Zrotation", "3 Zscale")), ":9", "'Zscale' of 'Spine'"),
    "channels miscounted": (swapped(("CHANNELS 3", "CHANNELS 2")), ":9", "2 channels are declared"),
    "no motion": (BODY.split("MOTION")[0], ":15", "ends without a line MOTION"),
    "no frames": (frames(), ":17", "there are no frames"),
    "no offset": (swapped(("    OFFSET 0 10 0\n", "")), ":6", "'Spine' has no OFFSET"),
    "another file": ("a,b\n1,2\n", "", "does not start with HIERARCHY"),
}  # fmt: skip


@pytest.mark.parametrize("kind", REFUSED)
def test_what_is_refused_is_told_with_its_line(tmp_path: Path, kind: str):
    text, line, what = REFUSED[kind]
    with pytest.raises(InputError) as caught:
        read_bvh(written(tmp_path, text))
    assert caught.value.where.endswith(f"body.bvh{line}")
    assert what in caught.value.what


def test_one_pose_can_be_read(tmp_path: Path):
    text = swapped(("Frames: 3", "Frames: 1"), text=frames("1 90 3 0 0 0 0 0 0"))
    motion = read(written(tmp_path, text))
    assert motion.sizes["frame"] == 1
    write_bvh(motion, tmp_path / "again.bvh")
    assert read(tmp_path / "again.bvh").sizes["frame"] == 1


@pytest.mark.parametrize("name", ["a{b", "a\nb", " a", "", "a  b"])
def test_names_that_would_not_read_back_are_not_written(tmp_path: Path, name: str):
    body = Skeleton("odd", (Joint(name, -1, (0.0, 0.0, 0.0), channels=("rx",)),))
    motion = make_motion(body, np.zeros((2, 1)), np.zeros((2, 3)), frame_rate=30.0, clip="odd")
    with pytest.raises(InputError, match="BVH cannot hold this name"):
        write_bvh(motion, tmp_path / "odd.bvh")


def test_a_hierarchy_of_a_thousand_joints(tmp_path: Path):
    joints = [Joint("j0", -1, (0.0, 0.0, 0.0))]
    joints += [Joint(f"j{i}", i - 1, (0.0, 1.0, 0.0)) for i in range(1, 1000)]
    body = Skeleton("deep", tuple(joints))
    motion = make_motion(body, np.zeros((2, 0)), np.zeros((2, 3)), frame_rate=30.0, clip="deep")
    write_bvh(motion, tmp_path / "deep.bvh")
    assert skeleton_of(read_bvh(tmp_path / "deep.bvh")).names == body.names


def test_damaged_files_are_read_or_refused(tmp_path: Path):
    random, path = np.random.default_rng(0), tmp_path / "body.bvh"
    refused = 0
    for _ in range(300):
        content = bytearray(BODY.encode())
        for at in random.integers(len(content), size=random.integers(1, 4)):
            content[at] = random.choice([*b"0 -.{}\nxe\0\xff", random.integers(256)])
        path.write_bytes(content[: random.integers(1, len(content) + 1)] if _ % 2 else content)
        with warnings.catch_warnings(), contextlib.suppress(InputError):
            warnings.simplefilter("ignore", MotionWarning)
            refused += 1
            read_bvh(path)
            refused -= 1
    assert 100 < refused < 300
