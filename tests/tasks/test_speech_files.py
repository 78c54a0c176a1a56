"""Recordings of speech: sound with tracks beside it, and the face of a sound file."""

from dataclasses import replace

import numpy as np
import pytest
import soundfile

from bayesmotion import load
from bayesmotion.cli import app
from bayesmotion.errors import InputError
from bayesmotion.sensing.face.views import read_tracks, read_views
from bayesmotion.tasks.speech_files import speak_file, write_tracks


def record(folder, name, seed, seconds=2.0):
    """Make a tone whose loudness the tracks follow."""
    random = np.random.default_rng(seed)
    time = np.arange(int(seconds * 16000)) / 16000
    loud = 0.5 + 0.4 * np.sin(2 * np.pi * 1.3 * time + random.uniform(0, 6))
    noise = 0.3 * loud * random.normal(size=len(time)).clip(-3, 3)
    soundfile.write(folder / f"{name}.wav", noise, 16000)
    frames = loud.reshape(-1, 640).mean(axis=1)
    rows = "\n".join(f"{a:.5f},{-2 * a:.5f}" for a in frames)
    (folder / f"{name}.csv").write_text(f"open, close\n{rows}\n", encoding="utf-8")
    return folder / f"{name}.wav"


@pytest.fixture
def recordings(tmp_path):
    return [record(tmp_path, f"r{i}", i) for i in range(4)]


def test_views_of_recordings(recordings, tmp_path):
    views = read_views(recordings, coefficients=5)
    assert views["audio"].shape == (200, 5)
    assert list(views["coordinate"].values) == ["open", "close"]
    assert views.attrs == {"frame_rate": 25.0, "n_coefficients": 5}
    assert views["clip"].values[0] == "r0"
    with pytest.raises(InputError, match="frames of sound, 50 of tracks"):
        read_views(recordings, frame_rate=50.0)
    (tmp_path / "r1.csv").write_text("open,wide\n1,2\n", encoding="utf-8")
    with pytest.raises(InputError, match="other columns"):
        read_views(recordings)


def test_tracks_that_are_no_table_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_tracks(tmp_path / "none.csv")
    (tmp_path / "bad.csv").write_text("a,b\n1,2\n3\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"bad.csv:3: it is not 2 numbers"):
        read_tracks(tmp_path / "bad.csv")


@pytest.mark.thorough
def test_a_face_of_a_sound_file(recordings, tmp_path, capsys):
    out, made = tmp_path / "fit.nc", tmp_path / "made.csv"
    names = map(str, recordings[:3])
    args = ["fit", "shared-gplvm", *names, "--out", str(out), "--max-steps", "30"]
    app([*args, "--coefficients", "4"], standalone_mode=False)
    assert f"saved to {out}" in capsys.readouterr().out
    assert load(out).motion.sizes["frame"] == 150
    face = speak_file(load(out), recordings[3])
    _, true = read_tracks(recordings[3].with_suffix(".csv"))
    assert np.corrcoef(face["mean"].values[:, 0], true[:, 0])[0, 1] > 0.8
    write_tracks(face, made)
    columns, values = read_tracks(made)
    assert columns == ["time", "open", "close", "open sd", "close sd"]
    np.testing.assert_allclose(values[:, 1:3], face["mean"].values, rtol=1e-4, atol=1e-5)
    fit = load(out)
    bare = replace(fit, motion=fit.motion.drop_attrs())
    with pytest.raises(InputError, match="how sound was described"):
        speak_file(bare, recordings[3])
