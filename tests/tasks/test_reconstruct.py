"""Clips made whole, as users ask for it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import bayesmotion as bm
from bayesmotion.motion.gait_skeleton import without_joints
from bayesmotion.tasks.gait import LIMBS


@pytest.fixture(scope="module")
def clip(gait_clips):
    return bm.split(gait_clips)["new-walk"]


def test_an_arm_of_a_gait_cycle_is_filled_in_nearer_than_by_the_mean_cycle(trained_gait, clip):
    fit, _ = trained_gait
    whole = bm.reconstruct(fit, clip, missing=["larm"])
    assert np.isfinite(whole.motion["angle"].values).all()
    assert np.isnan(whole.given["angle"].values).any()
    assert not whole.seen.all()
    assert whole.score is not None
    assert whole.score.error_mm is not None
    assert whole.score.error_mm < whole.score.baselines_mm["mean_cycle"]
    assert np.all(whole.sd[~whole.seen] > 0.0)


def test_what_is_named_counts_as_what_is_nan(trained_gait, clip):
    fit, _ = trained_gait
    named = bm.reconstruct(fit, clip, missing=["larm"])
    nan = bm.reconstruct(fit, without_joints(clip, LIMBS["larm"]))
    assert_allclose(named.mean, nan.mean, atol=1e-9)
    assert nan.score is not None
    assert nan.score.error_mm is None


def test_noise_is_taken_out_of_a_cycle(trained_gait, clip):
    fit, _ = trained_gait
    random = np.random.default_rng(0)
    noise = 0.06 * random.normal(size=clip["angle"].shape)
    true = bm.denoise(fit, clip, noise=0.0).given["angle"].values
    noisy = clip.assign(angle=clip["angle"] + noise)
    clean = bm.denoise(fit, noisy)
    assert clean.noise is not None
    assert clean.noise > 0.0

    def error(motion):
        return np.sqrt(np.mean(np.sin(0.5 * (motion["angle"].values - true)) ** 2))

    assert error(clean.motion) < error(clean.given)


def test_a_model_of_motions_fills_in_the_clip_itself(circle_fit, walkers):
    clip = bm.split(walkers)["ann-run"]
    with pytest.warns(bm.MotionWarning, match="this clip trained the fit: 'ann-run'"):
        whole = bm.reconstruct(circle_fit, clip, missing=["lradius"], draws=1)
    table = whole.to_dataset()
    known = table.isel(channel=slice(whole.seen.shape[1]))
    np.testing.assert_array_equal(known["given"].values, whole.seen)
    assert np.all(known["sd"].values[whole.seen] == 0.0)
    assert np.all(known["sd"].values[~whole.seen] > 0.0)
    assert np.all(table.sel(channel="left elbow flexion")["sd"].values > 0.0)
    assert np.all(table.sel(channel="right elbow flexion")["given"].values)
    assert whole.motion.sizes["frame"] == clip.sizes["frame"]
    lost = np.isnan(whole.given["angle"].values)
    assert lost.any()
    off = whole.motion["angle"].values[lost] - clip["angle"].values[lost]
    held = clip["angle"].values[lost] - clip["angle"].mean("frame").values[lost.any(axis=0)].mean()
    assert np.sqrt(np.mean(off**2)) < np.sqrt(np.mean(held**2))


def test_what_cannot_be_answered_is_refused_in_a_sentence(trained_gait, circle_fit, walkers, clip):
    with pytest.raises(bm.InputError, match="nothing is missing"):
        bm.reconstruct(trained_gait[0], clip)
    with pytest.raises(bm.InputError, match=r"takes no noise out of motions\. Fit gait_pose\."):
        bm.denoise(circle_fit, bm.split(walkers)["ann-run"])
    with pytest.raises(bm.InputError, match="there is no such"):
        bm.reconstruct(circle_fit, bm.split(walkers)["ann-run"], missing=["tail"])
    model, recordings = bm.example("mixture_ppca")
    fit = bm.fit(model, recordings, method=bm.EM(max_steps=2))
    with pytest.raises(
        bm.InputError, match=r"not predict motions\. Fit multifactor or gait_pose\."
    ):
        bm.reconstruct(fit, clip, missing=["larm"])
