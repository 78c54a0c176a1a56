"""Landmarks from files, and from the tracker with a model learned here."""

import importlib.util

import numpy as np
import pytest

from bayesmotion.errors import InputError, MotionWarning
from bayesmotion.sensing.face import landmarks as module
from bayesmotion.sensing.face.landmarks import read_landmarks, track_landmarks, write_landmarks


@pytest.fixture(scope="module")
def model(tmp_path_factory, talk):
    """A shape predictor learned from half of a sentence of the synthetic talker."""
    dlib = pytest.importorskip("dlib", reason="the tracker is in the extra face")
    options = dlib.shape_predictor_training_options()
    options.tree_depth, options.cascade_depth = 2, 6
    options.num_trees_per_cascade_level, options.feature_pool_size = 50, 150
    options.oversampling_amount, options.num_test_splits, options.num_threads = 15, 10, 1
    options.random_seed = "1"
    find = dlib.get_frontal_face_detector()
    pictures, marked = [], []
    for frame, shape in zip(talk[0].frames[::2], talk[0].landmarks[::2], strict=True):
        pictures.append(np.ascontiguousarray(frame))
        boxes = find(pictures[-1], 0) or find(pictures[-1], 1)
        points = dlib.points([dlib.point(*np.round(point).astype(int)) for point in shape])
        marked.append([dlib.full_object_detection(boxes[0], points)])
    path = tmp_path_factory.mktemp("tracker") / "tiny.dat"
    dlib.train_shape_predictor(pictures, marked, options).save(str(path))
    return path


def test_the_tracker_finds_a_face_in_pictures_it_has_not_seen(talk, model):
    found = track_landmarks(talk[0].frames[1:12:2], model=model)
    error = np.linalg.norm(found - talk[0].landmarks[1:12:2], axis=-1)
    assert error.mean() < 1.5
    # Not because all faces are in one place: another sentence's landmarks are farther.
    assert np.linalg.norm(found - talk[1].landmarks[1:12:2], axis=-1).mean() > 2 * error.mean()


def test_a_picture_without_a_face_is_missing_and_told(talk, model):
    frames = talk[0].frames[:3].copy()
    frames[1] = 128
    with pytest.warns(MotionWarning, match="no face was found in 1 of 3"):
        found = track_landmarks(frames, model=model)
    assert np.isnan(found[1]).all()
    assert np.isfinite(found[[0, 2]]).all()
    with pytest.raises(InputError, match="no face was found in any"):
        track_landmarks(frames[1:2], model=model)


def test_a_tracker_that_is_not_installed_is_told(talk, monkeypatch, tmp_path):
    path = tmp_path / "model.dat"
    path.write_text("no model")
    with pytest.raises(InputError, match="no shape predictor"):
        track_landmarks(talk[0].frames[:1], model=path)
    find = importlib.util.find_spec
    for missing, message in (("face_recognition_models", "68 landmarks"), ("dlib", "dlib is not")):
        monkeypatch.setattr(
            module.importlib.util,
            "find_spec",
            lambda name, missing=missing: None if name == missing else find(name),
        )
        with pytest.raises(InputError, match=message):
            track_landmarks(talk[0].frames[:1])


@pytest.mark.parametrize("name", ["marks.csv", "marks.npz"])
def test_files_give_back_what_was_written(tmp_path, name):
    marks = np.random.default_rng(0).uniform(0, 100, size=(4, 5, 2)).round(3)
    marks[2, 1] = np.nan
    found = read_landmarks(write_landmarks(tmp_path / name, marks))
    np.testing.assert_allclose(found, marks, atol=1e-4)


def test_pts_files_count_pixels_from_one(tmp_path):
    for frame in range(2):
        text = f"version: 1\nn_points: 2\n{{\n1.0 1.0\n{11.5 + frame} 3\n}}\n"
        (tmp_path / f"{frame:03}.pts").write_text(text)
    assert read_landmarks(tmp_path / "000.pts").tolist() == [[[0.0, 0.0], [10.5, 2.0]]]
    assert read_landmarks(tmp_path)[:, 1, 0].tolist() == [10.5, 11.5]
    (tmp_path / "002.pts").write_text("version: 1\n{\n1 1\n}\n")
    with pytest.raises(InputError, match="it has 1 landmarks"):
        read_landmarks(tmp_path)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("marks.csv", "x,y\n", "columns must be"),
        ("marks.csv", "frame,landmark,x,y\n0,0,a,1\n", ":2: 'a' is not a finite number"),
        ("marks.csv", "frame,landmark,x,y\n0,-1,1,1\n", ":2: .* is no landmark.* from 0"),
        ("marks.csv", "frame,landmark,x,y\n99999999,0,1,1\n", "of 100000000 frames"),
        ("marks.csv", "frame,landmark,x,y\n", "no landmarks"),
        ("marks.pts", "1 2\n3 4\n", "no list of points"),
        ("marks.pts", "{\n1 2 3\n}\n", ":2: 3 values where 2 belong"),
        ("marks.npz", "text", "no .npz file of landmarks"),
        ("marks.txt", "", "csv, npz and pts"),
    ],
)
def test_bad_files_are_told(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message):
        read_landmarks(tmp_path / name)


@pytest.mark.real_data
@pytest.mark.skipif(
    importlib.util.find_spec("face_recognition_models") is None,
    reason="the tracker's own model is in the extra face (100 MB)",
)
def test_the_mouth_of_a_grid_speaker_is_below_her_nose(data_root):
    from bayesmotion.sensing.face.video import read_video

    found = track_landmarks(read_video(data_root / "grid" / "bbaf2n.mpg").frames[::25])
    assert found.shape == (3, 68, 2)
    assert (found[:, 51, 1] > found[:, 33, 1]).all()
    assert (found[:, 8, 1] > found[:, 57, 1]).all()
