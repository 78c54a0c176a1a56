"""Recordings without their noise, as users ask for it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import bayesmotion as bm
from bayesmotion.gp.series import lowpass
from bayesmotion.motion.synthetic.walkers import synthetic_walkers


@pytest.fixture(scope="module")
def walk():
    """Give a walker without its own noise."""
    walkers = synthetic_walkers(("ann",), ("walk",), seconds=2.0, frame_rate=60.0)
    walk = bm.split(walkers)["ann-walk"]
    return walk.assign(angle=(walk["angle"].dims, lowpass(walk["angle"].values, 4.0, 60.0)))


@pytest.fixture(scope="module")
def noisy(walk):
    white = np.random.default_rng(0).normal(size=walk["angle"].shape)
    return walk.assign(angle=walk["angle"] + np.deg2rad(3.0) * white)


@pytest.fixture(scope="module")
def clean(noisy):
    return bm.denoise(noisy)


def error(made, walk):
    return np.sqrt(np.mean((made["angle"].values - walk["angle"].values) ** 2))


def test_the_recording_comes_back_with_less_noise(walk, noisy, clean):
    assert error(clean.motion, walk) < 0.4 * error(noisy, walk)
    for name in ("frame", "time", "clip", "dof", "subject"):
        assert_array_equal(clean.motion[name].values, noisy[name].values)
    for name in ("frame_rate", "skeletons", "source"):
        assert clean.motion.attrs[name] == noisy.attrs[name]
    assert_array_equal(clean.motion["root_position"].values, noisy["root_position"].values)
    assert "denoise: noise of" in clean.motion.attrs["history"]
    assert clean.estimated
    assert abs(clean.noise_degrees - 3.0) < 0.15
    assert "120 frames" in repr(clean)


def test_intervals_and_the_table_are_of_the_angles(walk, clean):
    low, high = clean.interval(0.9)
    held = (low <= walk["angle"].values) & (walk["angle"].values <= high)
    assert 0.85 < held.mean() < 0.97
    table = clean.to_dataset()
    own = table.sel(channel=list(clean.dofs))
    assert_allclose(own["mean"].values, clean.mean)
    assert_allclose(own["quantiles"].sel(quantile=0.95).values, high, atol=1e-6)
    assert "left knee flexion" in table["channel"].values


def test_without_noise_the_recording_is_left_alone(walk):
    same = bm.denoise(walk, noise_degrees=0.0)
    assert_array_equal(same.motion["angle"].values, walk["angle"].values)
    assert np.all(same.sd < 1e-9)


def test_a_smooth_recording_is_moved_by_less_than_a_tenth_of_a_degree(walk):
    found = bm.denoise(walk)
    off = found.motion["angle"].values - walk["angle"].values
    assert np.rad2deg(np.sqrt(np.mean(off**2))) < 0.1


def test_gaps_are_filled_and_turns_are_kept(walk):
    gappy = walk.copy(deep=True)
    dof = [str(one) for one in walk["dof"].values if str(one).startswith("ltibia")]
    gappy["angle"].loc[{"dof": dof, "frame": slice(50, 60)}] = np.nan
    gappy["angle"].loc[{"frame": slice(80, None)}] += 2.0 * np.pi
    gappy["root_position"][30:33] = np.nan
    made = bm.denoise(gappy, noise_degrees=0.0)
    seen = np.isfinite(gappy["angle"].values)
    assert_array_equal(made.motion["angle"].values[seen], gappy["angle"].values[seen])
    assert made.filled.sum() == 11 * len(dof)
    off = made.motion["angle"].values[~seen] - walk["angle"].values[~seen]
    assert np.rad2deg(np.abs(off).max()) < 6.0
    assert np.all(made.sd[made.filled] > 1e-5)
    path = made.motion["root_position"].values - walk["root_position"].values
    assert np.all(np.isfinite(path))
    assert np.abs(path).max() < 0.01 * np.ptp(walk["root_position"].values)


def test_what_was_never_recorded_stays_missing_and_is_told(walk):
    lost = walk.copy(deep=True)
    dof = [str(one) for one in walk["dof"].values if str(one).startswith("ltibia")]
    lost["angle"].loc[{"dof": dof}] = np.nan
    with pytest.warns(bm.MotionWarning, match="nothing is recorded of ltibia"):
        made = bm.denoise(lost, noise_degrees=0.0)
    assert np.isnan(made.motion["angle"].sel(dof=dof).values).all()
    assert len(made.dofs) == walk.sizes["dof"] - len(dof)


def test_what_cannot_be_done_is_refused_in_a_sentence(walk, trained_gait):
    with pytest.raises(bm.InputError, match="no standard deviation"):
        bm.denoise(walk, noise_degrees=-1.0)
    with pytest.raises(bm.InputError, match="tell no noise from motion"):
        bm.denoise(walk.isel(frame=slice(5)))
    with pytest.raises(bm.InputError, match="noise: it says nothing without a fit"):
        bm.denoise(walk, noise=0.1)
    with pytest.raises(bm.InputError, match="there is a fit and no clip"):
        bm.denoise(trained_gait[0])
    with pytest.raises(bm.InputError, match="noise_degrees: it says nothing by a fit"):
        bm.denoise(trained_gait[0], walk, noise_degrees=1.0)
