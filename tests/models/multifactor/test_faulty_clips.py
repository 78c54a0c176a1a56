"""Clips with frames that were lost, in which nothing moves, or with markers alone."""

import numpy as np
import pytest

import bayesmotion as bm
from bayesmotion.models.multifactor.data import prepare, prepare_new
from bayesmotion.models.multifactor.initial_values import phases
from bayesmotion.motion import concat, make_markers, split
from bayesmotion.motion.synthetic.walkers import synthetic_walkers


@pytest.fixture(scope="module")
def walkers():
    return synthetic_walkers(["ann"], ["walk", "run"], seconds=1.2, frame_rate=20.0)


def without(motion, frames, *names):
    """Return the motion without values of these frames."""
    lost = motion.copy(deep=True)
    for name in names:
        lost[name].values[frames] = np.nan
    return lost


@pytest.mark.parametrize("align_heading", [False, True])
@pytest.mark.parametrize("frames", [slice(0, 3), slice(8, 12), slice(20, None)])
def test_a_clip_goes_through_where_its_root_was_seen(walkers, align_heading, frames):
    trained = prepare(walkers, ("gait",), align_heading=align_heading)
    clip = split(walkers)["ann-walk"]
    whole = prepare_new(clip, trained)
    lost = prepare_new(without(clip, frames, "angle", "root_position"), trained)
    seen = np.isfinite(lost.observed()["y"].values).any(axis=1)
    assert not seen[frames].any()
    # What is predicted of the lost frames here is what was recorded.
    features = whole.encoding.scaled(
        whole.encoding.features(clip, lost.encoding.heading(without(clip, frames, "root_position")))
    )
    path = lost.to_motion({"y": features})["root_position"].values
    np.testing.assert_allclose(path, clip["root_position"].values, atol=1e-9)


def test_what_was_recorded_becomes_a_motion_again_where_hinges_have_three_channels(
    walkers, tmp_path
):
    """BVH files of many programs say that a knee turns about all axes: about two it never does."""
    bm.write(split(walkers)["ann-walk"], tmp_path / "walk.bvh")
    recorded = bm.read(tmp_path / "walk.bvh")
    lost = without(recorded, slice(8, 12), "angle", "root_position")
    for motion in (recorded, lost):
        training = prepare(motion, ())
        observed = training.observed()["y"].values
        assert np.isnan(observed).all(axis=0).any()
        made = training.to_motion({"y": observed})
        there = ~np.isnan(motion["angle"].values).any(axis=1)
        for joint in ("ltibia", "lfemur", "rhumerus"):
            dofs = [f"{joint}/r{axis}" for axis in "xyz"]
            given, back = (one["angle"].sel(dof=dofs).values for one in (motion, made))
            np.testing.assert_allclose(back[there], given[there], atol=1e-6)
        # What was not recorded is not made up.
        assert np.isnan(made["angle"].sel(dof="lfemur/rx").values[~there]).all()


def test_a_clip_that_stands_still_has_a_phase(walkers):
    moving, still = split(walkers).values()
    still = still.copy(deep=True)
    still["angle"].values[...] = 0.0
    still["root_position"].values[...] = still["root_position"].values[0]
    middle, step = phases(prepare(concat([moving, still]), ()).frames)
    assert np.isfinite(middle).all()
    assert np.isfinite(step).all()
    with pytest.raises(bm.InputError, match="clips ann-run: nothing moves in them"):
        prepare(still, ())


def test_markers_are_no_angles():
    random = np.random.default_rng(0)
    markers = make_markers(
        ["a", "b"], random.normal(size=(30, 2, 3)), frame_rate=30.0, clip="c",
        labels={"subject": "s", "gait": "walk", "task": "t"},
    )  # fmt: skip
    for kind in (bm.Multifactor, bm.MotionTensor, bm.GaitPose, bm.Keyposes):
        with pytest.raises(bm.InputError):
            kind().prepare(markers)
    with pytest.raises(bm.InputError, match="positions of markers alone"):
        bm.Multifactor(factors=()).prepare(markers)
