"""Nothing that a study kept is taken again under other settings."""

import json
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
import xarray as xr

from bayesmotion.errors import InputError
from bayesmotion.fit import Fit
from bayesmotion.models.gait_pose import GaitPose, NoSurface
from bayesmotion.motion.synthetic.walkers import synthetic_walkers
from bayesmotion.studies.gait_pose import learning as gait_pose_learning
from bayesmotion.studies.gait_pose import study as gait_pose
from bayesmotion.studies.keypose import dance as keypose_dance
from bayesmotion.studies.keypose import novelty as keypose_novelty
from bayesmotion.studies.keypose import recognition as keypose_recognition
from bayesmotion.studies.keypose import scores as keypose_scores
from bayesmotion.studies.keypose import study as keypose
from bayesmotion.studies.keypose import synthetic as keypose_synthetic
from bayesmotion.studies.keypose import tucker as keypose_tucker
from bayesmotion.studies.keypose import vectors as keypose_vectors
from bayesmotion.studies.speech import grid as speech_grid
from bayesmotion.studies.speech import study as speech
from bayesmotion.studies.speech import talker as speech_talker
from bayesmotion.studies.stages import Stages, kept_arrays
from bayesmotion.studies.voxel import curves as voxel_curves
from bayesmotion.studies.voxel import data as voxel_data
from bayesmotion.studies.voxel import study as voxel


def silent(text):
    pass


def test_arrays_are_made_once(tmp_path):
    path = tmp_path / "some" / "one.npz"
    made = {"x": np.arange(3.0), "y": 2.0}
    for make in (lambda: made, lambda: pytest.fail("they are there")):
        found = kept_arrays(path, make)
        assert set(found) == {"x", "y"}
        np.testing.assert_array_equal(found["x"], made["x"])
        assert found["y"] == 2.0


def test_a_file_of_results_that_cannot_be_read_is_refused(tmp_path):
    path = tmp_path / "r.json"
    path.write_text("{")
    with pytest.raises(InputError, match="cannot be read"):
        Stages(path, {}, silent)


@pytest.mark.parametrize(
    ("study", "module", "name", "value"),
    [
        (gait_pose, gait_pose, "SIGMA", 0.1),
        (gait_pose, gait_pose, "SWEEPS", 1),
        (
            gait_pose,
            gait_pose,
            "VARIANTS",
            {**gait_pose.VARIANTS, "torus3": GaitPose()},
        ),
        (gait_pose, gait_pose, "TOPOLOGIES", {"none": GaitPose(NoSurface())}),
        (gait_pose, gait_pose, "COMPONENTS", 9),
        (gait_pose, gait_pose, "TEST_SCALES", (1.0,)),
        (gait_pose, gait_pose_learning, "STEPS", 9),
        (speech, speech, "STEPS", 9),
        (speech, speech, "PLAIN", 9),
        (speech, speech_talker, "TRAINING", 9),
        (speech, speech_grid, "FIRST", 9),
        (speech, speech_grid, "SAME_SPEAKER", "nobody"),
        (
            voxel,
            voxel,
            "SETTINGS",
            replace(voxel.SETTINGS, mixture_points=9),
        ),
        (voxel, voxel, "SETUPS", {"six": voxel_data.Setup(first=3.0)}),
        (voxel, voxel, "MOTIONS", {}),
        (voxel, voxel_curves, "LENGTH", 0.9),
        (keypose, keypose_recognition, "RANKS", (9,)),
        (keypose, keypose_vectors, "COEFFICIENTS", 9),
        (keypose, keypose_novelty, "INNER", 9),
        (keypose, keypose_tucker, "STEPS", 9),
        (keypose, keypose_dance, "MATCH", 9.0),
        (keypose, keypose_scores, "BINS", 9),
        (keypose, keypose_synthetic, "NOISES", (9.0,)),
    ],
)
def test_a_changed_setting_has_a_folder_of_its_own(
    tmp_path, monkeypatch, study, module, name, value
):
    def folder():
        return Stages(tmp_path / "r.json", study.plan(0), silent).folder

    before = folder()
    assert folder() == before
    monkeypatch.setattr(module, name, value)
    assert folder() != before


def test_the_gait_pose_study_fits_again_with_another_setting(tmp_path, monkeypatch):
    trained, read = [], []

    def train(name, training, seed):
        trained.append(name)
        return fit(lambda path: (path.parent.mkdir(exist_ok=True), path.write_text(name)))

    def fit(save):
        tree = Mock(attrs={"seconds": 1.0, "inference": "local"})
        return Mock(spec=Fit, tree=tree, stats=lambda: {"lp": 0.0}, save=save)

    def load(path):
        read.append(path.stem)
        return fit(None)

    def begin():
        with pytest.raises(KeyboardInterrupt):
            gait_pose.reproduce(None, tmp_path, silent)

    def contest(walks, fits):
        raise KeyboardInterrupt

    walks = synthetic_walkers(gaits=("walk",), seconds=1.0)
    monkeypatch.setattr(gait_pose, "read_walks", lambda data: Mock(training=walks, test={}))
    monkeypatch.setattr(gait_pose, "plan", lambda seed: {"sigma": gait_pose.SIGMA})
    monkeypatch.setattr(gait_pose, "train", train)
    monkeypatch.setattr(gait_pose, "load", load)
    monkeypatch.setattr(gait_pose, "trained_of", lambda fit: fit)
    monkeypatch.setattr(gait_pose, "Contest", contest)
    begin()
    begin()
    models = list(gait_pose.MODELS)
    assert (trained, read) == (models, models)
    monkeypatch.setattr(gait_pose, "SIGMA", 0.1)
    begin()
    assert (trained, read) == (2 * models, models)


def test_the_voxel_study_looks_and_fits_in_a_folder_of_its_settings(tmp_path, monkeypatch):
    looked, fitted = [], []

    def observe_all(clips, which, setup, data, cache, seed, say):
        looked.append(cache)
        return {}

    def trained(training, fewer, data, kept, seed, say):
        fitted.append(kept)
        raise KeyboardInterrupt

    monkeypatch.setattr(voxel, "observe_all", observe_all)
    monkeypatch.setattr(voxel, "_trained", trained)
    for settings in (voxel.SETTINGS, voxel.SETTINGS, replace(voxel.SETTINGS, mixture_points=9)):
        monkeypatch.setattr(voxel, "SETTINGS", settings)
        with pytest.raises(KeyboardInterrupt):
            voxel.reproduce(None, tmp_path, silent)
    assert fitted[0] == fitted[1] != fitted[2]
    assert [path.parent for path in looked[::2]] == fitted


def test_talking_faces_are_kept_in_a_folder_of_the_studys_settings(tmp_path, monkeypatch):
    kept = []
    monkeypatch.setattr(speech, "talker_results", lambda out, folder, *_: kept.append(folder))
    monkeypatch.setattr(speech, "grid_results", lambda data, out, folder, *_: kept.append(folder))
    for steps in (1, 2):
        monkeypatch.setattr(speech, "STEPS", steps)
        stages = Stages(tmp_path / "speech.json", speech.plan(0), silent)
        speech._make_faces(stages, None, tmp_path, 0)
    assert len(set(kept)) == 4
    assert len({folder.parent for folder in kept}) == 2


def test_results_say_what_they_were_made_with_and_are_not_mixed(tmp_path):
    path = tmp_path / "r.json"
    stages = Stages(path, {"a": 1}, silent)
    stages.read(motion=xr.Dataset({"x": ("n", [1.0, 2.0])}), other=np.ones(2))
    stages.do("found", work=lambda: 2)
    made = json.loads(path.read_text())["made_with"]
    assert len(made["commits"]) == 1
    assert made["versions"]["numpy"] == np.__version__
    assert set(made["data"]) == {"motion", "other"}
    again = Stages(path, {"a": 1}, silent)
    again.read(motion=xr.Dataset({"x": ("n", [1.0, 2.0])}, attrs={"history": "other"}))
    assert again.result["made_with"] == made
    with pytest.raises(InputError, match="other data"):
        again.read(motion=xr.Dataset({"x": ("n", [1.0, 2.5])}))
