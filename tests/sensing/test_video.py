"""Videos written and read again: pictures, times, sound and what is refused."""

import av
import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.sensing.audio.cepstra import mfcc, read_audio
from bayesmotion.sensing.face.video import read_video, write_video

RATE = 44100


@pytest.fixture
def pictures():
    """A bright square that moves to the right."""
    frames = np.full((15, 48, 64, 3), 60.0)
    for k, frame in enumerate(frames):
        frame[16:32, 3 * k : 3 * k + 12] = (200.0, 120.0, 40.0)
    return frames


def test_pictures_and_sound_come_back(tmp_path, pictures):
    wave = np.zeros(int(0.6 * RATE))
    begin = 8 * RATE // 25
    wave[begin : begin + 1764] = 0.5 * np.sin(np.arange(1764) * 0.2)  # during frame 8
    path = write_video(tmp_path / "out.mp4", pictures, 25.0, wave, RATE)
    video = read_video(path)
    assert video.frame_rate == 25.0
    np.testing.assert_allclose(video.times, np.arange(15) / 25.0, atol=1e-6)
    # Lossy: colours of half the resolution, and little noise.
    assert np.abs(video.frames - pictures).mean() < 4.0
    found, rate = read_audio(path)
    assert rate == RATE
    assert np.argmax(mfcc(found, rate)[:, 0]) == 8
    loud = np.flatnonzero(np.abs(found) > 0.25)
    assert abs(loud[0] - begin) <= RATE // 500
    assert abs(loud[-1] - (begin + 1764)) <= RATE // 500


def test_a_grid_of_odd_size_loses_its_edge(tmp_path, pictures):
    path = write_video(tmp_path / "odd.mp4", pictures[:, :47, :63], 30.0)
    assert read_video(path).frames.shape[1:3] == (46, 62)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"path": "out.avi"}, r"written as \.mp4"),
        ({"frames": np.empty((0, 4, 4, 3))}, "no pictures"),
        ({"frames": np.full((2, 4, 4, 3), np.nan)}, "no pictures"),
        ({"wave": np.zeros(9)}, "samples and their rate"),
    ],
)
def test_what_cannot_be_written_is_told(tmp_path, pictures, changed, message):
    given = {"path": "out.mp4", "frames": pictures, "frame_rate": 25.0, **changed}
    with pytest.raises(InputError, match=message):
        write_video(**{**given, "path": tmp_path / given["path"]})
    assert not list(tmp_path.iterdir())


def test_what_is_no_video_is_told(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_video(tmp_path / "none.mp4")
    path = tmp_path / "bad.mp4"
    path.write_bytes(b"no video")
    with pytest.raises(InputError, match="cannot be read as a video"):
        read_video(path)


def test_pictures_at_uneven_times_are_told(tmp_path, pictures):
    path = tmp_path / "uneven.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for k, picture in enumerate(pictures.astype(np.uint8)):
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts = k if k < 8 else k + 9
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    with pytest.raises(InputError, match="do not follow each other evenly"):
        read_video(path)


@pytest.mark.real_data
def test_a_grid_clip_is_read(data_root):
    video = read_video(data_root / "grid" / "bbaf2n.mpg")
    assert video.frames.shape == (75, 288, 360, 3)
    assert video.frame_rate == 25.0
