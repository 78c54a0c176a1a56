"""Reading and writing ASF/AMC: what is read is what is meant, and nothing wrong passes."""

from pathlib import Path

import numpy as np
import pytest

from bayesmotion.errors import InputError, MotionWarning
from bayesmotion.motion import (
    Joint,
    Skeleton,
    concat,
    make_motion,
    positions,
    read_amc,
    read_asf,
    skeleton_of,
    write_amc,
    write_asf,
)

HEAD = ":FULLY-SPECIFIED\n:DEGREES\n"
FRAME = """\
{n}
root 1 17 {n} 5 6 7
femur 10 20 30
foot 4 5
spine 1 2 3
larm 40 50
head 3 2 1
"""


def frames(count: int, start: int = 1) -> str:
    return "".join(FRAME.format(n=n) for n in range(start, start + count))


def elementary(axis: str, degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


def by_hand(asf_text: str, values: dict[str, list[float]]) -> dict[str, np.ndarray]:
    """Bone ends from the text of an ASF file and one AMC frame, bone by bone in NumPy."""
    bones, tree = {}, []
    for block in asf_text.split(":bonedata")[1].split(":hierarchy")[0].split("begin")[1:]:
        rows = {r.split()[0]: r.split()[1:] for r in block.strip().splitlines() if r.strip()}
        bones[rows["name"][0]] = rows
    for row in asf_text.split(":hierarchy")[1].splitlines():
        if len(row.split()) > 1:
            tree.append(row.split())
    root = values["root"]
    turn = elementary("z", root[5]) @ elementary("y", root[4]) @ elementary("x", root[3])
    ends, turns = {"root": np.array(root[:3])}, {"root": turn}
    for parent, *children in tree:
        for child in children:
            rows = bones[child]
            ax, ay, az = (float(word) for word in rows["axis"][:3])
            c = elementary("z", az) @ elementary("y", ay) @ elementary("x", ax)
            b = np.eye(3)
            for dof, value in zip(rows.get("dof", []), values.get(child, []), strict=True):
                b = elementary(dof[1], value) @ b
            turns[child] = turns[parent] @ c @ b @ c.T
            along = np.array([float(word) for word in rows["direction"]])
            ends[child] = ends[parent] + turns[child] @ along * float(rows["length"][0])
    return ends


def compare(motion, asf_text: str, amc_text: str, frame: int) -> None:
    lines = amc_text.splitlines()
    start = lines.index(str(frame + 1)) + 1
    rows = {}
    for line in lines[start:]:
        if len(line.split()) == 1:
            break
        rows[line.split()[0]] = [float(word) for word in line.split()[1:]]
    ends = by_hand(asf_text, rows)
    skeleton = skeleton_of(motion)
    where = positions(motion).isel(frame=frame)
    for index, joint in enumerate(skeleton):
        if index == 0 or joint.name.endswith("_end"):
            bone = joint.name.removesuffix("_end")
        else:  # a joint is where its parent's bone ends
            bone = skeleton.joints[joint.parent].name
        np.testing.assert_allclose(where.sel(joint=joint.name), ends[bone], atol=1e-9)


def test_positions_are_those_worked_out_by_hand(asf: Path, asf_text: str, tmp_path: Path):
    amc = tmp_path / "body_1.amc"
    amc.write_text(HEAD + frames(3))
    compare(read_amc(amc), asf_text, amc.read_text(), 1)


@pytest.mark.real_data
@pytest.mark.parametrize("trial", ["02/02_02", "35/35_18"])
def test_real_positions_are_those_worked_out_by_hand(data_root: Path, trial: str):
    amc = data_root / "cmu" / f"{trial}.amc"
    asf = next(amc.parent.glob("*.asf"))
    compare(read_amc(amc), asf.read_text(), amc.read_text(), 100)


def test_what_is_read(asf: Path, tmp_path: Path):
    amc = tmp_path / "body_1.amc"
    amc.write_text(HEAD + frames(3))
    motion = read_amc(amc, labels={"gait": "walk"})
    skeleton = skeleton_of(motion)
    assert skeleton.metres == pytest.approx(0.0254 / 0.45)
    assert motion.attrs["frame_rate"] == 120.0
    assert motion["gait"].values.tolist() == ["walk"] * 3
    assert motion["subject"].values.tolist() == ["body"] * 3
    assert np.degrees(motion["angle"].sel(dof="femur/ry").values) == pytest.approx(20.0)
    assert np.degrees(motion["angle"].sel(dof="root/rz").values) == pytest.approx(7.0)
    assert skeleton.joints[skeleton.index("femur")].channels == ("rz", "ry", "rx")
    np.testing.assert_allclose(skeleton.joints[skeleton.index("femur")].offset, [1.5, -2.0, 0.0])


def test_radians_and_rate(asf: Path, tmp_path: Path):
    amc = tmp_path / "body_1.amc"
    amc.write_text(":RADIANS\r\n" + frames(2).replace("\n", "\r\n"))
    motion = read_amc(amc, asf, frame_rate=60.0, clip="c")
    assert motion["angle"].sel(dof="femur/ry").values[0] == 20.0
    assert motion["time"].values.tolist() == [0.0, 1 / 60]


def test_frames_of_a_cut_clip_may_start_anywhere(asf: Path, tmp_path: Path):
    amc = tmp_path / "body_1.amc"
    amc.write_text(HEAD + frames(2, start=57))
    assert read_amc(amc).sizes["frame"] == 2


@pytest.mark.parametrize(
    ("stem", "found"), [("a_1", "a"), ("HDM_b_run_1", "HDM_b"), ("unlike", None)]
)
def test_which_skeleton_is_found(asf_text: str, tmp_path: Path, stem: str, found: str | None):
    for name in ("a", "HDM_b", "HDM"):
        (tmp_path / f"{name}.asf").write_text(asf_text)
    amc = tmp_path / f"{stem}.amc"
    amc.write_text(HEAD + frames(2))
    if found is None:
        with pytest.raises(InputError, match=r"unlike\.amc.*skeleton is not known"):
            read_amc(amc)
    else:
        motion = read_amc(amc)
        assert skeleton_of(motion).name == found
        assert motion["subject"].values[0] == found.removeprefix("HDM_")


def test_the_only_skeleton_is_found_and_told(asf: Path, tmp_path: Path):
    amc = tmp_path / "unlike.amc"
    amc.write_text(HEAD + frames(2))
    with pytest.warns(MotionWarning, match=r"unlike\.amc: body\.asf is taken for its skeleton"):
        assert skeleton_of(read_amc(amc)).name == "body"
    amc.write_text("#!OML:ASF C:\\data\\BODY.ASF\n" + HEAD + frames(2))
    assert skeleton_of(read_amc(amc)).name == "body"


def test_the_skeleton_of_another_person_is_not_taken(asf_text: str, tmp_path: Path):
    (tmp_path / "02.asf").write_text(asf_text)
    amc = tmp_path / "35_01.amc"
    amc.write_text(HEAD + frames(2))
    with pytest.raises(InputError, match=r"no 35\.asf beside it"):
        read_amc(amc)


def swap(old: str, new: str) -> str:
    text = HEAD + frames(3)
    assert old in text
    return text.replace(old, new, 1)


BAD_AMC = {
    "empty": ("", "", "empty"),
    "header only": (HEAD, "", "no frames"),
    "truncated": ((HEAD + frames(3)).split("larm 40 50\nhead 3 2 1\n3")[0] + "", ":10", "larm"),
    "breaks off": ((HEAD + frames(3))[: -len("larm 40 50\nhead 3 2 1\n")], ":17", "breaks off"),
    "unknown bone": (swap("foot 4 5", "fuss 4 5"), ":6", "no bone 'fuss'"),
    "bone without dof": (swap("foot 4 5", "hip 4 5"), ":6", "no bone 'hip'"),
    "bone missing": (swap("foot 4 5\n", ""), ":3", "foot"),
    "bone twice": (swap("foot 4 5", "femur 1 2 3"), ":6", "twice"),
    "too few values": (swap("foot 4 5", "foot 4"), ":6", "1 values where 2"),
    "too many values": (swap("foot 4 5", "foot 4 5 6"), ":6", "3 values where 2"),
    "no values": (swap("foot 4 5", "foot"), ":6", "0 values where 2"),
    "nan": (swap("foot 4 5", "foot nan 5"), ":6", "'nan' is not a finite"),
    "inf": (swap("foot 4 5", "foot 4 -inf"), ":6", "'-inf' is not a finite"),
    "no number": (swap("foot 4 5", "foot 4 5,0"), ":6", "'5,0' is not a finite"),
    "underscore": (swap("foot 4 5", "foot 4 5_0"), ":6", "'5_0' is not a finite"),
    "no text": (swap("foot 4 5", "foot \x004 5"), ":6", "not text"),
    "frame left out": (
        HEAD + frames(2) + frames(1, start=5),
        ":17",
        "frame 5 stands where frame 3",
    ),
    "frame twice": (HEAD + frames(2) + frames(1, start=2), ":17", "frame 2 stands where frame 3"),
    "no unit": (swap(":DEGREES\n", ""), ":2", "neither :DEGREES nor :RADIANS"),
    "unknown keyword": (swap(":DEGREES", ":GRADS"), ":2", ":GRADS is not known"),
    "no frame number": (HEAD + frames(2)[2:], ":3", "before the first frame number"),
}


@pytest.mark.parametrize("case", BAD_AMC)
def test_bad_amc_is_told_with_file_and_line(asf: Path, tmp_path: Path, case: str):
    text, line, what = BAD_AMC[case]
    amc = tmp_path / "body_1.amc"
    amc.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError) as caught:
        read_amc(amc)
    assert f"body_1.amc{line}" in caught.value.where
    assert caught.value.where.endswith(line or ".amc")
    assert what in caught.value.what
    assert caught.value.mend


def test_a_bone_that_no_frame_has_is_missing(asf: Path, tmp_path: Path):
    amc = tmp_path / "body_1.amc"
    text = HEAD + frames(3)
    amc.write_text(text)
    whole = read_amc(amc)
    amc.write_text(text.replace("larm 40 50\n", ""))
    with pytest.warns(MotionWarning, match="no frame has values for larm"):
        motion = read_amc(amc)
    lost = motion["dof"].str.startswith("larm/")
    assert lost.sum() == 2
    assert np.isnan(motion["angle"].values[:, lost]).all()
    np.testing.assert_array_equal(motion["angle"].values[:, ~lost], whole["angle"].values[:, ~lost])
    # The path of the root is no joint's: without it there is no recording.
    amc.write_text("\n".join(line for line in text.splitlines() if not line.startswith("root")))
    with pytest.raises(InputError, match="no values for root"):
        read_amc(amc)


def test_missing_files_are_told(tmp_path: Path, asf: Path):
    with pytest.raises(InputError, match=r"nowhere\.amc: it cannot be read"):
        read_amc(tmp_path / "nowhere.amc")
    amc = tmp_path / "body_1.amc"
    amc.write_text(HEAD + frames(2))
    with pytest.raises(InputError, match=r"other\.asf: it cannot be read"):
        read_amc(amc, tmp_path / "other.asf")


BAD_ASF = {
    "unknown section": (":documentation", ":flesh", 8, ":flesh is not known"),
    "unknown unit": ("mass 1.0", "mess 1.0", 5, "'mess 1.0' is not known"),
    "unit of angle": ("angle deg", "angle grad", 7, "'angle grad'"),
    "length": ("length 0.45", "length 0", 6, "not positive"),
    "root keyword": ("  position 0", "  posture 0", 13, "'posture' is not known"),
    "root order": ("TX TY TZ RX RY RZ", "TX TY RX RY RZ", 11, "the root's order"),
    "root axis": ("  axis XYZ\n  pos", "  axis ZY\n  pos", 14, "an order such as XYZ"),
    "root incomplete": ("  order TX TY TZ RX RY RZ\n", "", 10, "no order"),
    "root position": ("position 0 0 0", "position 0 0", 13, "2 values where 3"),
    "bone keyword": ("id 2", "ident 2", 24, "'ident' is not known"),
    "axis order": ("axis 10 -15 20 XYZ", "axis 10 -15 20 ZYZ", 28, "an order such as XYZ"),
    "direction": ("0.6 -0.8 0", "0.6 -0.8 o", 19, "'o' is not a finite"),
    "moving bone": ("dof rx ry rz\n    lim", "dof rx ry tz\n    lim", 29, "rx ry tz"),
    "limits": (
        "    limits (-45.0 90.0)\n",
        "    limits (-45.0 90.0)\n (0 1)\n",
        34,
        "3 limits for 2",
    ),
    "no length": ("     length 2.2\n", "", 34, "no length"),
    "no end": ("    dof ry rz\n  end\n", "    dof ry rz\n", 59, "'begin' is out of place"),
    "bone twice": ("name head", "name larm", 60, "stands twice"),
    "hierarchy": ("femur foot", "femur fuss", 72, "no bone 'fuss'"),
    "two parents": ("spine larm head", "spine larm foot", 73, "already has a parent"),
    "not connected": ("    hip femur\n", "", 23, "'femur' has no parent"),
    "in a circle": (
        "    root hip spine\n    hip femur\n    femur foot\n",
        "    root spine\n    hip femur\n    femur foot\n    foot hip\n",
        16,
        "'hip' has no way up to the root",
    ),
    "orphan": ("spine larm head", "spine larm", 60, "'head' has no parent"),
    "stray line": ("# a leg and an arm", "a leg and an arm", 1, "before the first section"),
}


@pytest.mark.parametrize("case", BAD_ASF)
def test_bad_asf_is_told_with_file_and_line(tmp_path: Path, asf_text: str, case: str):
    old, new, line, what = BAD_ASF[case]
    assert asf_text.count(old) == 1
    path = tmp_path / "bad.asf"
    path.write_text(asf_text.replace(old, new))
    with pytest.raises(InputError) as caught:
        read_asf(path)
    assert caught.value.where.endswith(f"bad.asf:{line}")
    assert what in caught.value.what


@pytest.mark.parametrize("section", [":bonedata", ":root", ":hierarchy"])
def test_a_missing_section_is_told(tmp_path: Path, asf_text: str, section: str):
    blocks = asf_text.split("\n:")
    path = tmp_path / "bad.asf"
    path.write_text("\n:".join(block for block in blocks if not block.startswith(section[1:])))
    with pytest.raises(InputError, match=r"bad\.asf"):
        read_asf(path)


def test_an_angle_unit_of_radians(tmp_path: Path, asf_text: str):
    path = tmp_path / "body.asf"
    path.write_text(asf_text.replace("angle deg", "angle rad"))
    assert read_asf(path).joints[2].axis == (10.0, -15.0, 20.0)


def test_written_files_read_back(make, skeleton: Skeleton, tmp_path: Path):
    motion = make(frames=5)
    write_asf(skeleton, tmp_path / "out" / "body.asf")
    write_amc(motion, tmp_path / "out" / "body_1.amc")
    again = read_amc(tmp_path / "out" / "body_1.amc")
    np.testing.assert_allclose(again["angle"], motion["angle"], atol=1e-12, rtol=0)
    np.testing.assert_array_equal(again["root_position"], motion["root_position"])
    body = skeleton_of(again)
    assert body.names == skeleton.names
    assert body.dofs == skeleton.dofs
    assert body.metres == pytest.approx(skeleton.metres, abs=1e-15)
    for joint, other in zip(body, skeleton, strict=True):
        np.testing.assert_allclose(joint.offset, other.offset, atol=1e-12)
        np.testing.assert_allclose(joint.axis, other.axis, atol=1e-12)
    assert not list(tmp_path.glob("out/.*"))


@pytest.mark.real_data
def test_real_files_written_read_back(data_root: Path, tmp_path: Path):
    motion = read_amc(data_root / "cmu/02/02_02.amc")
    write_asf(skeleton_of(motion), tmp_path / "02.asf")
    write_amc(motion, tmp_path / "02_02.amc")
    again = read_amc(tmp_path / "02_02.amc")
    np.testing.assert_allclose(again["angle"], motion["angle"], atol=1e-9, rtol=0)
    np.testing.assert_allclose(positions(again), positions(motion), atol=1e-9, rtol=0)


def test_what_amc_cannot_say_is_told(make, tmp_path: Path, skeleton: Skeleton):
    path = tmp_path / "out.amc"
    hole = make()
    hole["angle"][3, 1] = np.nan
    with pytest.raises(InputError, match=r"clip 'walk', frame 3: 1 frames have missing values"):
        write_amc(hole, path)
    with pytest.raises(InputError, match=r"clips a, b: a AMC file|one clip"):
        write_amc(concat([make("a"), make("b", seed=1)]), path)
    root = Joint("root", -1, (0.0, 0.0, 0.0), channels=("rz", "ry", "rx"))
    forked = (
        root,
        Joint("spine", 0, (0.0, 0.0, 0.0), channels=("rx",)),
        Joint("left", 1, (1.0, 0.0, 0.0)),
        Joint("right", 1, (-1.0, 0.0, 0.0)),
    )
    for joints, metres in (
        ((root, Joint("leg", 0, (1.0, 0.0, 0.0))), 1.0),
        (forked, 1.0),
        (forked[:3], 1.0),
        (skeleton.joints, None),
        ((root, Joint("leg", 0, (0.0, 0.0, 0.0), channels=("rx",))), 1.0),
    ):
        body = Skeleton("odd", joints, metres)
        angle, place = np.zeros((2, len(body.dofs))), np.zeros((2, 3))
        motion = make_motion(body, angle, place, frame_rate=1.0, clip="c")
        with pytest.raises(InputError, match="skeleton 'odd': ASF cannot say it"):
            write_amc(motion, path)
        with pytest.raises(InputError, match="Write it as BVH"):
            write_asf(body, tmp_path / "out.asf")
    assert not path.exists()
