"""From motions to the arrays a model sees, and back."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from bayesmotion.errors import InputError
from bayesmotion.models.multifactor.encoding import learn_encoding
from bayesmotion.models.multifactor.frames import clip_labels, frames_of, level_names
from bayesmotion.motion import Skeleton, concat, downsample, make_motion, skeleton_of, split
from bayesmotion.motion.features import encode
from bayesmotion.motion.synthetic.walkers import synthetic_walkers


@pytest.fixture(scope="module")
def walkers() -> xr.Dataset:
    return synthetic_walkers(["ann", "ben"], ["walk", "run"], seconds=0.5)


def all_features(encoding, motion) -> np.ndarray:
    parts = split(motion).values()
    return np.concatenate([encoding.features(part, encoding.heading(part)) for part in parts])


def test_scaled_training_features_have_mean_zero_and_sd_one(walkers):
    encoding = learn_encoding(walkers)
    features = all_features(encoding, walkers)
    y = encoding.scaled(features)
    np.testing.assert_allclose(y.mean(axis=0), 0.0, atol=1e-10)
    np.testing.assert_allclose(y.std(axis=0), 1.0, rtol=1e-10)
    np.testing.assert_allclose(encoding.unscaled(y), features, atol=1e-12)
    assert y.shape[1] == len(encoding.layout.labels) == 2 * encoding.n_angles + 3


def test_features_that_never_change_are_not_divided_by_zero(walkers):
    still = walkers.copy(deep=True)
    still["angle"].loc[{"dof": "ltibia/rx"}] = 0.25
    encoding = learn_encoding(still)
    place = encoding.layout.labels.index("ltibia/rx")
    assert encoding.still[place]
    assert encoding.still.sum() == 2
    assert encoding.mean[place] == pytest.approx(0.25)
    np.testing.assert_allclose(
        encoding.scaled(all_features(encoding, still))[:, place], 0, atol=1e-9
    )
    told = encoding.entries(all_features(encoding, still))
    np.testing.assert_array_equal(np.isnan(told).any(axis=0), encoding.still)


def test_a_motion_comes_back_from_its_scaled_features(walkers):
    encoding = learn_encoding(walkers, align_heading=True)
    clip = split(walkers)["ben-run"]
    heading = encoding.heading(clip)
    y = encoding.scaled(encoding.features(clip, heading))
    again = encoding.motion(
        y,
        skeleton_of(clip),
        clip="again",
        start=clip["root_position"].values[0],
        heading=heading,
        labels={"subject": "ben", "gait": "run"},
    )
    np.testing.assert_allclose(again["root_position"], clip["root_position"], atol=1e-9)
    np.testing.assert_allclose(
        encode(again, encoding.layout), encode(clip, encoding.layout), atol=1e-9
    )
    assert again.attrs["frame_rate"] == clip.attrs["frame_rate"]
    assert set(again["gait"].values) == {"run"}
    # What is not among the features rests at its mean over the training clips.
    left_out = [dof for dof in walkers["dof"].values if "clavicle" in dof or "wrist" in dof]
    for dof in left_out:
        np.testing.assert_allclose(
            again["angle"].sel(dof=dof), walkers["angle"].sel(dof=dof).mean()
        )


def test_headings_are_taken_out_only_where_asked(walkers):
    clip = split(walkers)["ann-walk"]
    assert learn_encoding(walkers).heading(clip) == 0.0
    turned = clip.copy(deep=True)
    x, y, z = clip["root_position"].values.T
    turned["root_position"].values[:] = np.stack([z, y, -x], axis=1)
    assert learn_encoding(walkers, align_heading=True).heading(turned) == pytest.approx(
        np.pi / 2, abs=0.1
    )


def test_what_does_not_fit_is_told(walkers):
    encoding = learn_encoding(walkers)
    slow = downsample(split(walkers)["ann-walk"], 2)
    with pytest.raises(InputError, match=r"'ann-walk': it has 15 frames a second, .* have 30"):
        encoding.features(slow, 0.0)
    with pytest.raises(InputError, match="have no label 'mood'"):
        clip_labels(walkers, "mood")
    changing = split(walkers)["ann-walk"]
    gait = np.array(["walk"] * 10 + ["run"] * (changing.sizes["frame"] - 10))
    changing = changing.assign_coords(gait=("frame", gait))
    with pytest.raises(InputError, match="'ann-walk': its gait changes from 'run' to 'walk'"):
        clip_labels(changing, "gait")


def test_labels_and_levels(walkers):
    assert level_names(walkers, "subject") == ["ann", "ben"]
    parts = split(walkers)
    parts["ann-run"] = parts["ann-run"].assign_coords(
        subject=("frame", np.full(parts["ann-run"].sizes["frame"], ""))
    )
    unknown = concat([parts["ann-run"], parts["ben-walk"]])
    assert level_names(unknown, "subject") == ["ben"]
    assert clip_labels(unknown, "subject") == {"ann-run": "", "ben-walk": "ben"}


def test_frames_are_put_together_clip_by_clip():
    y = {"a": np.arange(12.0).reshape(4, 3), "b": -np.arange(9.0).reshape(3, 3)}
    y["a"][1, 2] = y["b"][0, 2] = np.nan
    labels = {"gait": {"a": "walk", "b": "run"}, "subject": {"a": "", "b": "x"}}
    frames = frames_of(y, labels, {"gait": ["walk", "run"], "subject": ["x"]}, frame_rate=30.0)
    np.testing.assert_array_equal(frames.clip, [0, 0, 0, 0, 1, 1, 1])
    np.testing.assert_array_equal(frames.time, [-1.5, -0.5, 0.5, 1.5, -1.0, 0.0, 1.0])
    np.testing.assert_array_equal(frames.steps.first, [0, 4])
    np.testing.assert_array_equal(frames.steps.before, [0, 1, 2, 4, 5])
    np.testing.assert_array_equal(frames.steps.after, [1, 2, 3, 5, 6])
    np.testing.assert_array_equal(frames.level["gait"], [0, 1])
    np.testing.assert_array_equal(frames.level["subject"], [1, 0])
    assert frames.levels == (2, 2)
    assert frames.n_clips == 2
    both = np.concatenate(list(y.values()))
    seen = np.einsum("pn,pd->nd", frames.missing.rows, frames.missing.columns) > 0
    np.testing.assert_array_equal(seen, np.isfinite(both))
    np.testing.assert_array_equal(frames.y, np.nan_to_num(both))


def test_labels_nobody_had_before_become_levels_of_their_own():
    y = np.zeros((2, 1))
    labels = {"subject": {"a": "new", "b": "", "c": "new", "d": "old"}}
    frames = frames_of(dict.fromkeys("abcd", y), labels, {"subject": ["old"]}, frame_rate=30.0)
    level = frames.level["subject"]
    assert level[3] == 0
    assert level[0] == level[2]
    assert {level[0], level[1]} == {1, 2}
    assert frames.levels == (3,)


def test_clips_of_other_bodies_are_refused(walkers):
    clip = split(walkers)["ann-walk"]
    body = skeleton_of(clip)
    joints = [replace(j, channels=()) if j.name == "ltoes" else j for j in body]
    other = make_motion(
        Skeleton("stiff", tuple(joints)),
        clip["angle"].drop_sel(dof="ltoes/rx").values,
        clip["root_position"].values,
        frame_rate=30.0,
        clip="stiff",
    )
    with pytest.raises(
        InputError, match="'stiff': they have the same joints, but ltoes turn about different"
    ):
        learn_encoding(concat([clip, other]))
