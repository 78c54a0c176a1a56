"""Portraits: made from videos, saved, and filmed again."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.sensing.audio.cepstra import read_audio
from bayesmotion.sensing.face.files import load_portrait
from bayesmotion.sensing.face.landmarks import write_landmarks
from bayesmotion.sensing.face.talker import RATE, synthetic_talker
from bayesmotion.sensing.face.video import read_video, write_video
from bayesmotion.tasks.portraits import make_portrait


@pytest.fixture(scope="module")
def videos(tmp_path_factory):
    """Two videos of the synthetic talker, with landmarks beside them."""
    folder = tmp_path_factory.mktemp("videos")
    paths = []
    for number, one in enumerate(synthetic_talker(5, utterances=2, seconds=1.0, size=64)):
        path = write_video(folder / f"clip{number}.mp4", one.frames, 25.0, one.wave, RATE)
        write_landmarks(folder / f"clip{number}.landmarks.csv", one.landmarks)
        paths.append(path)
    return paths


@pytest.fixture(scope="module")
def made(videos):
    return make_portrait(videos)


def test_a_portrait_films_the_faces_of_a_video(made, videos, tmp_path):
    portrait, tracks = made
    assert set(tracks) == {"clip0", "clip1"}
    assert tracks["clip0"].shape == (25, len(portrait.names))
    sound = read_audio(videos[0])
    film = read_video(portrait.write_film(tmp_path / "film.mp4", tracks["clip0"], *sound))
    video = read_video(videos[0])
    assert film.frames.shape == video.frames.shape
    # The first picture's head is where it was; later ones may have turned away.
    first = np.abs(film.frames[0].astype(float) - video.frames[0]).mean()
    assert first < 4.0
    assert len(read_audio(tmp_path / "film.mp4")[0]) == pytest.approx(len(sound[0]), abs=2048)


def test_a_saved_portrait_films_exactly_the_same(made, tmp_path):
    portrait, tracks = made
    again = load_portrait(portrait.save(tmp_path / "her.npz"))
    assert np.array_equal(again.film(tracks["clip1"]), portrait.film(tracks["clip1"]))
    assert again.names == portrait.names
    assert again.model.kept == portrait.model.kept


def test_what_is_no_portrait_is_told(made, videos, tmp_path):
    portrait, tracks = made
    with pytest.raises(InputError, match="no such file"):
        load_portrait(tmp_path / "none.npz")
    np.savez(tmp_path / "other.npz", landmarks=np.zeros(3))
    with pytest.raises(InputError, match="no portrait"):
        load_portrait(tmp_path / "other.npz")
    with pytest.raises(InputError, match=r"a portrait is written as \.npz"):
        portrait.save(tmp_path / "her.png")
    with pytest.raises(InputError, match="the portrait has"):
        portrait.film(tracks["clip0"][:, :-1])
    with pytest.raises(InputError, match="there are no videos"):
        make_portrait([])
    with pytest.raises(InputError, match="name occurs twice"):
        make_portrait([videos[0], videos[0]])


def test_frames_without_landmarks_are_told(videos, tmp_path):
    path = tmp_path / "short.mp4"
    path.write_bytes(videos[0].read_bytes())
    marks = np.full((25, 4, 2), np.nan)
    marks[:, :, :] = np.random.default_rng(0).uniform(size=(25, 4, 2))
    marks[3, 2] = np.nan
    write_landmarks(tmp_path / "short.landmarks.csv", marks)
    with pytest.raises(InputError, match="frame 3 and 0 others"):
        make_portrait([path])
    write_landmarks(tmp_path / "short.landmarks.csv", marks[:9])
    with pytest.raises(InputError, match="landmarks of 9 frames"):
        make_portrait([path])
