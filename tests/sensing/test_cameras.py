"""Cameras on a circle and from files."""

import json

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.sensing.voxels.cameras import circle, moved, read_cameras, write_cameras


def test_cameras_stand_on_the_circle_and_look_at_its_middle():
    cameras = circle(4, radius=5.0, height=1.5, first=90.0, target=(1.0, 1.0, -2.0))
    np.testing.assert_allclose(cameras[0].place, [6.0, 1.5, -2.0], atol=1e-12)
    np.testing.assert_allclose(cameras[1].place, [1.0, 1.5, -7.0], atol=1e-12)
    for camera in cameras:
        pixel, depth = camera.project(np.array([[1.0, 1.0, -2.0]]))
        np.testing.assert_allclose(pixel, [[319.5, 239.5]])
        assert depth[0] == pytest.approx(np.hypot(5.0, 0.5))


def test_up_is_up_and_right_is_right():
    camera = circle(1)[0]  # stands at +z and looks along -z
    (middle, up, right), _ = camera.project(np.array([[0, 1.0, 0], [0, 1.5, 0], [0.5, 1.0, 0]]))
    assert up[1] < middle[1]
    assert up[0] == pytest.approx(middle[0])
    assert right[0] > middle[0]


def test_cameras_move():
    by = np.array([1.0, 2.0, 3.0])
    for before, after in zip(circle(3), moved(circle(3), by), strict=True):
        np.testing.assert_allclose(after.place, before.place + by, atol=1e-12)


def test_cameras_are_read_as_they_were_written(tmp_path):
    path = tmp_path / "cameras.json"
    cameras = circle(3, radius=4.0, first=20.0)
    write_cameras(path, cameras)
    for before, after in zip(cameras, read_cameras(path), strict=True):
        np.testing.assert_array_equal(before.projection, after.projection)
        assert (before.name, before.width, before.height) == (after.name, after.width, after.height)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"R": np.ones((3, 3)).tolist()}, "its R is no rotation"),
        ({"K": np.ones((3, 3)).tolist()}, "not upper triangular"),
        ({"t": [1.0, 2.0]}, "cannot be used"),
        ({"width": 0}, "no pixels"),
        ({"name": None, "K": None}, "no list of cameras|cannot be used"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused(tmp_path, change, told):
    path = tmp_path / "cameras.json"
    write_cameras(path, circle(1))
    rows = json.loads(path.read_text())
    rows[0] |= change
    path.write_text(json.dumps(rows))
    with pytest.raises(InputError, match=told):
        read_cameras(path)


def test_no_file_and_no_camera_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_cameras(tmp_path / "none.json")
    (tmp_path / "empty.json").write_text("[]")
    with pytest.raises(InputError, match="holds no camera"):
        read_cameras(tmp_path / "empty.json")
    with pytest.raises(InputError, match="at least one"):
        circle(0)
