"""Reading C3D."""

from pathlib import Path

import ezc3d
import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.motion import positions, read_c3d, skeletons


def write(
    path: Path, names: tuple[str, ...], frames: int = 5, unit: str | None = "mm"
) -> np.ndarray:
    content = ezc3d.c3d()
    content["parameters"]["POINT"]["RATE"]["value"] = [100]
    content["parameters"]["POINT"]["LABELS"]["value"] = names
    if unit is not None:
        content["parameters"]["POINT"]["UNITS"]["value"] = [unit]
    points = np.ones((4, len(names), frames))
    points[:3] = np.random.default_rng(0).normal(size=(3, len(names), frames))
    content["data"]["points"] = points
    residuals = np.zeros((1, len(names), frames))
    residuals[0, 0:1, 2] = -1.0  # how C3D says that a marker was not seen
    content["data"]["meta_points"]["residuals"] = residuals
    content["data"]["meta_points"]["camera_masks"] = np.zeros((7, len(names), frames), bool)
    content.write(str(path))
    points[:3, 0:1, 2] = np.nan
    return points[:3].transpose(2, 1, 0)


def test_what_is_read(tmp_path: Path):
    expected = write(tmp_path / "walk.c3d", ("LANK", "RANK"))
    motion = read_c3d(tmp_path / "walk.c3d", labels={"subject": "7"})
    np.testing.assert_allclose(motion["position"], expected, rtol=1e-6)
    assert motion["position"][2, 0].isnull().all()
    assert motion["position"].notnull().sum() == 27
    assert motion["joint"].values.tolist() == ["LANK", "RANK"]
    assert motion.attrs["frame_rate"] == 100.0
    assert motion.attrs["metres"] == 0.001
    assert motion["subject"].values[0] == "7"
    assert motion["clip"].values[0] == "walk"
    assert skeletons(motion) == {}
    assert positions(motion) is motion["position"] or positions(motion).equals(motion["position"])


def test_a_unit_that_is_not_said_is_not_known(tmp_path: Path):
    write(tmp_path / "walk.c3d", ("A",), unit=None)
    assert "metres" not in read_c3d(tmp_path / "walk.c3d").attrs


def test_bad_files_are_told(tmp_path: Path):
    with pytest.raises(InputError, match=r"none\.c3d: there is no such file"):
        read_c3d(tmp_path / "none.c3d")
    for content in (b"", b"garbage" * 200):
        (tmp_path / "bad.c3d").write_bytes(content)
        with pytest.raises(InputError, match=r"bad\.c3d: it is not a C3D file"):
            read_c3d(tmp_path / "bad.c3d")
    write(tmp_path / "long.c3d", ("A", "B"), frames=400)
    content = (tmp_path / "long.c3d").read_bytes()
    (tmp_path / "short.c3d").write_bytes(content[: len(content) - 900])
    with pytest.raises(InputError, match=r"short\.c3d: the file breaks off: \d+ of 400 frames"):
        read_c3d(tmp_path / "short.c3d")
    write(tmp_path / "none.c3d", (), frames=5)
    with pytest.raises(InputError, match=r"none\.c3d: .*no markers, but 0 analog channels|breaks"):
        read_c3d(tmp_path / "none.c3d")


@pytest.mark.real_data
@pytest.mark.parametrize("name", ["85_02", "135_02", "HDM_mm_01-02_03_120"])
def test_real_positions_are_those_of_ezc3d(data_root: Path, name: str):
    path = data_root / "benchmarks" / "gaps" / f"{name}.c3d"
    expected = ezc3d.c3d(str(path))["data"]["points"][:3].transpose(2, 1, 0)
    found = read_c3d(path)["position"].values
    np.testing.assert_array_equal(found, np.where((expected == 0).all(-1)[..., None], np.nan,
                                                  expected))  # fmt: skip
