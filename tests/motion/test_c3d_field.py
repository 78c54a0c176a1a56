"""C3D files as programs of the field write them, made here byte by byte."""

import contextlib
import struct
import warnings
from pathlib import Path

import numpy as np
import pytest

from bayesmotion.errors import InputError, MotionWarning
from bayesmotion.motion import check, read, read_c3d

INTEL, DEC, SGI = 84, 85, 86
NAMES = ("HEAD", "LKNE", "RKNE")


def places(frames: int = 4, markers: int = 3) -> np.ndarray:
    """Give x, y, z and residual: marker m in frame f is at (10 m + f, 20 m + f, 30 m + f)."""
    values = np.zeros((frames, markers, 4))
    for axis in range(3):
        marker = 10.0 * (axis + 1) * np.arange(1, markers + 1)
        values[..., axis] = marker + np.arange(frames)[:, None]
    return values


def texts(*words: str, width: int = 12) -> tuple:
    return -1, [width, len(words)], "".join(word.ljust(width) for word in words).encode("latin-1")


def number(value: float, kind: str = "f") -> tuple:
    return kind, [], [value]


def c3d(
    path: Path,
    values: np.ndarray,
    parameters: dict[str, tuple] | None = None,
    *,
    processor: int = INTEL,
    analog: np.ndarray | None = None,
    scale: float = -1.0,
    last: int | None = None,
    points: int | None = None,
) -> Path:
    """Write a C3D file; `parameters` are added to the usual ones, or take their place."""
    order = ">" if processor == SGI else "<"

    def packed(kind: str, numbers) -> bytes:
        data = np.asarray(numbers, dtype=np.float32 if kind == "f" else np.int16)
        if kind == "f" and processor == DEC:
            return (data * 4).astype("<f4").view("<u2").reshape(-1, 2)[:, ::-1].tobytes()
        return data.astype(f"{order}{'f4' if kind == 'f' else 'i2'}").tobytes()

    frames, count = values.shape[:2]
    samples = np.zeros((frames, 0)) if analog is None else analog
    usual = {
        "POINT:USED": number(count, "h"),
        "POINT:FRAMES": number(frames, "h"),
        "POINT:SCALE": number(scale),
        "POINT:RATE": number(100.0),
        "POINT:UNITS": texts("mm", width=2),
        "POINT:LABELS": texts(*NAMES[:count]),
    }
    groups: list[str] = []
    records = b""
    for key, value in {**usual, **(parameters or {})}.items():
        if not value:
            continue
        group, name = key.split(":")
        if group not in groups:
            groups.append(group)
            records += struct.pack("bb", len(group), -len(groups)) + group.encode()
            records += struct.pack(f"{order}hb", 3, 0)
        kind, dims, data = value
        body = struct.pack("bB", {-1: -1, "h": 2, "f": 4}[kind], len(dims)) + bytes(dims)
        body += data if kind == -1 else packed(kind, data)
        records += struct.pack("bb", len(name), groups.index(group) + 1) + name.encode()
        records += struct.pack(f"{order}h", len(body) + 3) + body + b"\0"
    blocks = -(-(len(records) + 5) // 512)
    section = (bytes([1, 80, blocks, processor]) + records).ljust(512 * blocks, b"\0")
    head = b"\x02P" + struct.pack(
        f"{order}5H", count if points is None else points, samples.shape[1], 1,
        frames if last is None else last, 10,
    )  # fmt: skip
    head += packed("f", [scale]) + struct.pack(f"{order}2H", 2 + blocks, 1) + packed("f", [100.0])
    if scale > 0:
        values = np.concatenate([values[..., :3] / scale, values[..., 3:]], axis=-1)
    rows = np.hstack([values.reshape(frames, -1), samples])
    data = packed("f" if scale < 0 else "h", rows)
    path.write_bytes(
        head.ljust(512, b"\0") + section + data.ljust(-(-len(data) // 512) * 512, b"\0")
    )
    return path


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "walk.c3d"


@pytest.mark.parametrize("processor", [INTEL, DEC, SGI])
@pytest.mark.parametrize("scale", [-1.0, 0.5])
def test_every_processor_and_format(path: Path, processor: int, scale: float):
    motion = read(c3d(path, places(), processor=processor, scale=scale))
    np.testing.assert_array_equal(motion["position"], places()[..., :3])
    assert motion["joint"].values.tolist() == list(NAMES)
    assert motion.attrs["frame_rate"] == 100.0
    assert motion.attrs["metres"] == 0.001


@pytest.mark.parametrize(
    "parameters",
    [
        {"ANALOG:USED": number(2, "h")},  # no rate
        {"ANALOG:USED": number(2, "h"), "ANALOG:RATE": number(100.0), "ANALOG:OFFSET":
         ("f", [2], [0.0, 0.0])},
        {},
    ],
)  # fmt: skip
def test_analog_samples_shift_no_frame(path: Path, parameters: dict):
    motion = read(c3d(path, places(), parameters, analog=np.full((4, 2), 100.0)))
    np.testing.assert_array_equal(motion["position"], places()[..., :3])


def test_results_of_a_model_are_no_markers(path: Path):
    results = {
        "POINT:LABELS": texts("HEAD", "LHipAngles", "LKNE", "LHipPower"),
        "POINT:ANGLES": texts("LHipAngles"),
        "POINT:POWERS": texts("LHipPower", "RHipPower"),
    }
    motion = read(c3d(path, places(markers=4), results))
    assert motion["joint"].values.tolist() == ["HEAD", "LKNE"]
    np.testing.assert_array_equal(motion["position"], places(markers=4)[:, [0, 2], :3])
    assert "without 2 results of a model" in motion.attrs["history"]
    only = {"POINT:LABELS": texts("M"), "POINT:MOMENTS": texts("M")}
    with pytest.raises(InputError, match=r"no markers, but 1 results of a model \(M"):
        read(c3d(path, places(markers=1), only))


def test_a_result_does_not_hide_a_jump(path: Path):
    values = np.repeat(places(1, 4), 40, axis=0)
    values[..., 0] += 0.1 * np.arange(40)[:, None]
    values[20:, 1, 0] += 400.0
    values[:, 3] = 1e5 * np.random.default_rng(0).normal(size=(40, 4))
    values[:, 3, 3] = 0.0
    labels = {"POINT:LABELS": texts(*NAMES, "LHipMoment"), "POINT:MOMENTS": texts("LHipMoment")}
    (finding,) = check(read(c3d(path, values, labels)))
    assert (finding.kind, finding.frames) == ("jump", (19, 20))
    assert finding.sentence.startswith("LKNE at up to")


def test_what_was_not_seen_is_missing(path: Path):
    values = places()
    values[1, 0] = 0.0  # as most programs write a gap
    values[2, 1, 3] = -1.0
    values[3, 2, :3] = np.nan
    values[0, 2, 1] = np.inf
    motion = read(c3d(path, values))
    lost = motion["position"].isnull().all("space").values
    assert np.argwhere(lost).tolist() == [[0, 2], [1, 0], [2, 1], [3, 2]]
    (finding,) = check(motion)
    assert finding.sentence == "values of HEAD, LKNE, RKNE are missing in frames 0 to 3."


def test_every_kind_of_nan_is_missing(path: Path):
    content = bytearray(c3d(path, places()).read_bytes())
    content[1024:1028] = b"\x00\x00\xa0\x7f"  # a signalling one
    path.write_bytes(content)
    assert read(path)["position"].isnull().sum() == 3


def test_more_frames_than_a_word_can_count(path: Path):
    ends = {
        "POINT:FRAMES": number(-1, "h"),
        "TRIAL:ACTUAL_START_FIELD": ("h", [2], [1, 0]),
        "TRIAL:ACTUAL_END_FIELD": ("h", [2], [20, 0]),
    }
    for last in (65535, 20):
        motion = read(c3d(path, places(20, 1), ends, last=last))
        np.testing.assert_array_equal(motion["position"], places(20, 1)[..., :3])
    ends["TRIAL:ACTUAL_END_FIELD"] = ("h", [2], [70000 - 65536, 1])
    for last in (65535, 70000 - 65536):
        assert read(c3d(path, places(70000, 1), ends, last=last)).sizes["frame"] == 70000
    # Without these the file's size tells.
    assert read(c3d(path, places(128, 1), {"POINT:FRAMES": ()}, last=65535)).sizes["frame"] == 128


@pytest.mark.parametrize(
    ("word", "metres"),
    [
        ("millimeters", 1e-3), ("Metres", 1.0), ("m", 1.0), ("inch", 0.0254), ("CM", 1e-2),
        ("feet", 0.3048), ("unknown", None), ("ms", None),
    ],
)  # fmt: skip
def test_words_for_units(path: Path, word: str, metres: float | None):
    motion = read(c3d(path, places(), {"POINT:UNITS": texts(word)}))
    assert motion.attrs.get("metres") == metres


@pytest.mark.parametrize(
    ("labels", "names"),
    [
        (texts("LKNE", "LKNE", "RKNE"), ["LKNE", "LKNE_2", "RKNE"]),
        (texts("HEAD", "LKNE"), ["HEAD", "LKNE", "marker_3"]),
        (texts("", "", "RKNE"), ["marker_1", "marker_2", "RKNE"]),
        ((), ["marker_1", "marker_2", "marker_3"]),
    ],
)
def test_markers_without_names_of_their_own_are_numbered(path: Path, labels: tuple, names: list):
    c3d(path, places(), {"POINT:LABELS": labels})
    # What stands twice or has no name is told.
    with pytest.warns(MotionWarning, match="names of their own") if names != [] else None:
        motion = read(path)
    assert motion["joint"].values.tolist() == names


def test_long_lists_of_names_go_on(path: Path):
    names = [f"M{index}" for index in range(300)]
    lists = {"POINT:LABELS": texts(*names[:255], width=4)}
    lists["POINT:LABELS2"] = texts(*names[255:], width=4)
    assert read(c3d(path, places(2, 300), lists))["joint"].values.tolist() == names


def test_the_rate_can_be_said(path: Path):
    c3d(path, places(), {"POINT:RATE": number(0.0)})
    assert read(path).attrs["frame_rate"] == 100.0  # that of the head
    c3d(path, places(), {"POINT:RATE": number(-5.0)})
    with pytest.raises(InputError, match=r"POINT:RATE -5 is no frame rate.*frame_rate=30"):
        read(path)
    assert read(path, frame_rate=50.0).attrs["frame_rate"] == 50.0


def test_one_pose_can_be_read_and_checked(path: Path):
    motion = read(c3d(path, places(1)))
    assert motion.sizes["frame"] == 1
    assert check(motion) == []


def test_what_is_refused_is_told(path: Path):
    analog = {"ANALOG:USED": number(2, "h")}
    with pytest.raises(InputError, match="there are no markers, but 2 analog channels"):
        read(c3d(path, places(4, 0), analog, analog=np.ones((4, 2))))
    c3d(path, places(), {"POINT:USED": number(32000, "h")}, points=32000)
    with pytest.raises(InputError, match="breaks off: 32000 markers are promised, and no frame"):
        read(path)
    content = c3d(path, places()).read_bytes()
    path.write_bytes(content[:512] + content[512:516].ljust(512, b"\0") + content[1024:])
    with pytest.raises(InputError, match="the parameter section is empty"):
        read(path)
    path.write_bytes(content.replace(b"LABELS", b"LABEL", 1))  # all behind it shifts
    with pytest.raises(InputError, match="the parameter section is damaged"):
        read(path)
    with pytest.raises(InputError, match=r"no\.c3d: there is no such file"):
        read_c3d(path.with_name("no.c3d"))


@pytest.mark.parametrize("size", [1, 2, 300, 512, 518, 672, 749, 1023, 1024, 1100])
def test_files_that_break_off_are_refused(path: Path, size: int):
    path.write_bytes(c3d(path, places(40)).read_bytes()[:size])
    with pytest.raises(InputError, match=r"breaks off|not a C3D file"):
        read(path)


def test_damaged_files_are_read_or_refused(path: Path):
    content = c3d(path, places(20), {"POINT:ANGLES": texts("LHipAngles")}).read_bytes()
    random = np.random.default_rng(0)
    outcomes = []
    for trial in range(400):
        damaged = bytearray(content)
        for at in random.integers(1100, size=random.integers(1, 6)):
            damaged[at] = random.integers(256)
        if trial % 3 == 0:
            del damaged[(at := random.integers(1100)) : at + random.integers(1, 9)]
        path.write_bytes(damaged)
        outcomes.append("refused")
        with warnings.catch_warnings(), contextlib.suppress(InputError):
            warnings.simplefilter("ignore", MotionWarning)
            outcomes[-1] = f"read {read(path).sizes['frame'] >= 1}"
    assert set(outcomes) == {"refused", "read True"}
