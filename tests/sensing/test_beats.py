"""Beats from a sound, a file and a tempo."""

import numpy as np
import pytest
import soundfile

from bayesmotion.errors import InputError
from bayesmotion.sensing.audio.beats import even_beats, read_beats, track_beats
from bayesmotion.studies.keypose.dance import against_grid


@pytest.fixture(scope="module")
def clicks(tmp_path_factory):
    """A sound file of 120 clicks a minute, and the times of the clicks."""
    rate = 22050
    beats = even_beats(120.0, 12.0, first=0.5)
    sound = np.zeros(12 * rate)
    for beat in beats:
        at = int(beat * rate)
        sound[at : at + 200] = np.sin(np.arange(200) * 0.5) * np.exp(-np.arange(200) / 50)
    path = tmp_path_factory.mktemp("music") / "clicks.wav"
    soundfile.write(path, sound, rate)
    return path, beats


@pytest.mark.slow
def test_clicks_are_tracked(clicks):
    path, beats = clicks
    found = track_beats(path)
    assert np.median(np.diff(found)) == pytest.approx(0.5, abs=0.02)
    gap = np.abs(found[:, None] - beats[None]).min(axis=1)
    assert np.mean(gap < 0.07) > 0.9


def test_a_file_of_beats_is_read(tmp_path):
    path = tmp_path / "beats.csv"
    path.write_text("# seconds\n0.5, 1\n1.0, 2\n\n1.5, 3\n")
    assert read_beats(path).tolist() == [0.5, 1.0, 1.5]


def test_a_tempo_gives_even_beats():
    np.testing.assert_allclose(even_beats(120.0, 2.0, first=0.25), [0.25, 0.75, 1.25, 1.75])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1.0\nx\n", ":2: 'x' is not a finite number"),
        ("2\n1\n", "do not grow"),
        ("", "empty"),
        ("# none\n", "none"),
    ],
)
def test_bad_files_are_told(tmp_path, text, message):
    path = tmp_path / "beats.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_beats(path)


def test_missing_and_unreadable_music_is_told(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        track_beats(tmp_path / "song.mp3")
    path = tmp_path / "song.wav"
    path.write_text("no music")
    with pytest.raises(InputError, match="cannot be read"):
        track_beats(path)
    with pytest.raises(InputError, match="no beats"):
        even_beats(0.0, 10.0)


@pytest.mark.slow
def test_a_grid_of_the_musics_tempo_is_matched_and_another_is_not(clicks):
    """The study's comparison of tracked beats with a grid, on music of 120 beats a minute."""
    path, _ = clicks
    right = against_grid(path, 0.5, 10.5, 20, np.random.default_rng(0))
    wrong = against_grid(path, 0.5, 10.5, 23, np.random.default_rng(0))
    assert right["tempo_tracked"] == pytest.approx(120.0, abs=2.0)
    assert right["tempo_grid"] == pytest.approx(120.0)
    assert right["matched"]["at_grid"] > 0.9
    assert right["onsets"]["at_grid"] > 3 * right["onsets"]["control"]
    assert wrong["matched"]["at_grid"] < 0.5
    assert right["matched"]["control"] < 0.5
