"""The faces of the speech study: measured against truth, on sentences of the synthetic talker."""

import json

import numpy as np
import pytest

from bayesmotion.sensing.face.appearance import fit_appearance
from bayesmotion.sensing.face.talker import RATE, synthetic_talker
from bayesmotion.sensing.face.video import read_video, write_video
from bayesmotion.studies.speech import grid as speech_grid
from bayesmotion.studies.speech import talker as speech_talker
from bayesmotion.studies.speech.faces import Talk, measured
from bayesmotion.studies.speech.faces_report import faces_markdown
from bayesmotion.studies.speech.talker import LIPS


def ridge(sounds, faces):
    """Learn a face from three frames of sound."""

    def near(sound):
        padded = np.pad(sound, ((1, 1), (0, 0)), mode="edge")
        return np.hstack([padded[:-2], padded[1:-1], padded[2:]])

    x, y = np.vstack([near(one) for one in sounds]), np.vstack(faces)
    middle, mean, spread = x.mean(axis=0), y.mean(axis=0), x.std(axis=0)
    x = (x - middle) / spread
    weights = np.linalg.solve(x.T @ x + 10.0 * np.eye(x.shape[1]), x.T @ (y - mean))
    return lambda sound: mean + (near(sound) - middle) / spread @ weights


@pytest.fixture(scope="module")
def said():
    return synthetic_talker(2, utterances=3, seconds=1.2, size=64)


def test_the_true_parameters_are_measured_as_the_encoders_error(said):
    one = said[0]
    sound = np.zeros((len(one.frames), 1))
    talk = Talk("one", "her", sound, one.frames, one.landmarks)
    model = fit_appearance(one.frames, one.landmarks, keep=1.0)
    face = {"her": model}
    track = model.encode(one.frames, one.landmarks)
    exact = measured([talk], [track], face, LIPS)
    assert exact["landmarks_px"] < 0.01
    assert exact["opening_peak_to_peak"] == pytest.approx(1.0, abs=0.01)
    assert exact["opening_correlation"] == pytest.approx(1.0, abs=1e-3)
    half = measured([talk], [0.5 * track], face, LIPS)
    still = measured([talk], [0.0 * track], face, LIPS)
    assert half["opening_peak_to_peak"] == pytest.approx(0.5, abs=0.02)
    assert 0.4 < half["landmarks_px"] / still["landmarks_px"] < 0.6
    assert still["opening_peak_to_peak"] == 0.0
    assert "opening_correlation" not in still
    # Distances are in pixels of the pictures: a landmark off by one is one away.
    shapes = model.decode(track)[0]
    assert np.abs(shapes - shapes.mean(axis=0)).max() > 0.5


def test_the_talkers_faces_are_made_from_her_sound(tmp_path):
    spoken = []
    found = speech_talker.talker_results(
        tmp_path, tmp_path / "kept", {"ridge": ridge}, spoken.append, training=3, tests=1
    )
    rows = found["models"]
    assert set(rows) == {"encoder", "still_face", "ridge"}
    assert rows["encoder"]["times_encoder"] == 1.0
    assert rows["encoder"]["landmarks_px"] < 0.5 * rows["still_face"]["landmarks_px"]
    assert rows["ridge"]["landmarks_px"] < 0.9 * rows["still_face"]["landmarks_px"]
    assert json.loads(json.dumps(found)) == found
    assert {path.name for path in tmp_path.glob("*.png")} == {"talker_faces.png", "talker_lips.png"}


def test_the_path_through_videos_goes_on_where_it_was(tmp_path, said, monkeypatch):
    """Three sentences as videos; landmarks are given instead of tracked."""
    names = ("one", "two", "left_out")
    data = tmp_path / "data"
    for name, one in zip(names, said, strict=True):
        path = write_video(data / "grid" / f"{name}.mp4", one.frames, 25.0, one.wave, RATE)
        path.rename(path.with_suffix(".mpg"))
    marks = iter([one.landmarks for one in said])
    monkeypatch.setattr(speech_grid, "CLIPS", names)
    monkeypatch.setattr(speech_grid, "LEFT_OUT", "left_out")
    monkeypatch.setattr(speech_grid, "SAME_SPEAKER", "two")
    monkeypatch.setattr(speech_grid, "FIRST", 20)
    monkeypatch.setattr(speech_grid, "LIPS", LIPS)
    monkeypatch.setattr(speech_grid, "track_landmarks", lambda frames: next(marks))
    calls = []

    def counted(sounds, faces):
        calls.append(len(sounds))
        return ridge(sounds, faces)

    out, kept = tmp_path / "out", tmp_path / "kept"
    found = speech_grid.grid_results(data, out, kept, {"ridge": counted}, lambda _: None)
    again = speech_grid.grid_results(data, out, kept, {"ridge": counted}, lambda _: None)
    assert calls == [2]  # of the clips that are not left out, and once
    assert found == again == json.loads(json.dumps(found))
    for row in found["clips"].values():
        assert row["grey_levels"] < row["grey_levels_mean_face"]
        assert row["search_px"] < 1.5
    assert set(found["left_out"]["models"]) == {"encoder", "still_face", "ridge"}
    film = read_video(out / "grid_ridge.mp4")
    assert film.frames.shape == (30, 64, 64, 3)
    assert (out / "grid_faces.png").is_file()
    assert (out / "grid_lips.png").is_file()


def test_the_report_has_a_row_for_every_model_and_clip():
    row = {"landmarks_px": 1.0, "lips_px": 1.5, "opening_peak_to_peak": 0.9, "grey_levels": 4.0}
    clip = {"parameters": 3, "grey_levels": 2.0, "grey_levels_mean_face": 4.0}
    clip |= {"landmarks_px": 0.5, "search_px": 0.7, "search_failed": 1, "frames": 25}
    result = {
        "talker": {"training_frames": 1500, "test_frames": 300, "parameters": 4,
                   "kept": [0.96, 0.95, 0.97],
                   "models": {"encoder": {**row, "times_encoder": 1.0}}},
        "grid": {"settings": {"first_frames": 50, "displaced_px": 8.0}, "clips": {"one": clip},
                 "left_out": {"clip": "two", "training_frames": 675,
                              "models": {"ridge": {**row, "opening_correlation": 0.6}}}},
    }  # fmt: skip
    text = faces_markdown(result, {"ridge": "ridge regression"})
    assert "1,500 frames to train" in text
    assert "| ridge regression | 1.00 | 1.50 | 0.60 | 0.90 | 4.00 |" in text
    assert "| the encoder itself, given the pictures | 1.00 | 1.50 | - |" in text
    assert "| one | 3 | 2.00 | 4.00 | 0.50 | 0.70 | 1 of 25 |" in text
    assert faces_markdown({}, {}) == ""
