"""Segments: normalised in time, place, heading and body."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.motion import concat, make_motion, skeleton_of
from bayesmotion.motion.segments import Segmenting, cosine, from_cosine, resampled, segments
from bayesmotion.motion.synthetic.anthropometry import adult_skeleton
from bayesmotion.motion.synthetic.dance import synthetic_dance

KINDS = ("positions", "rotations", "both")


@pytest.fixture(scope="module")
def clip():
    return synthetic_dance(0, beats=6).motion


def changed(clip, name, *, stature=1.7, turn=0.0, move=0.0, every=1):
    """Give the clip on another body, turned, moved or with fewer frames."""
    angle = clip["angle"].values[::every].copy()
    ry = clip["dof"].values.tolist().index("root/ry")
    if turn:
        from scipy.spatial.transform import Rotation

        root = clip["dof"].values.tolist().index("root/rz")
        about = Rotation.from_rotvec([0, turn, 0])
        turned = about * Rotation.from_euler("ZYX", angle[:, :3])
        assert (root, ry) == (0, 1)
        angle[:, :3] = turned.as_euler("ZYX")
    return make_motion(
        adult_skeleton(name, stature), angle, clip["root_position"].values[::every] + move,
        frame_rate=60.0, clip=name,
    )  # fmt: skip


@pytest.mark.parametrize("channels", KINDS)
def test_place_heading_body_and_time_do_not_matter(clip, channels):
    others = [
        changed(clip, "tall", stature=2.0),
        changed(clip, "there", move=3.0),
        changed(clip, "turned", turn=1.2),
        changed(clip, "fast", every=2),
    ]
    motion = concat([clip, *others])
    x = segments(motion, Segmenting(channels, coefficients=4)).values
    for row in range(1, 4):
        np.testing.assert_allclose(x[row], x[0], atol=1e-6)
    np.testing.assert_allclose(x[4], x[0], atol=0.02)


def test_settings_change_something(clip):
    motion = concat([clip, changed(clip, "tall", stature=2.0)])
    own = segments(motion, Segmenting("positions", body="own", lengths="file"))
    assert float(abs(own[0] - own[1]).max()) > 0.05
    whole = segments(motion, Segmenting(coefficients=5))
    moving = segments(motion, Segmenting(coefficients=5, static=False))
    np.testing.assert_allclose(moving.values, whole.values[..., 1:])
    fine = segments(motion, Segmenting(coefficients=5, samples=32))
    assert not np.allclose(fine.values, whole.values, atol=1e-6)


def test_cosine_coefficients_go_back_and_keep_the_mean_square():
    x = np.random.default_rng(0).normal(size=(16, 3))
    c = cosine(x, 16)
    np.testing.assert_allclose(from_cosine(c, 16), x, atol=1e-12)
    np.testing.assert_allclose(np.square(c).sum(axis=0), np.square(x).mean(axis=0))
    np.testing.assert_allclose(c[0], x.mean(axis=0))


def test_samples_are_linear_between_rows():
    np.testing.assert_allclose(resampled(np.array([[0.0], [1.0], [3.0]]), 5).ravel(),
                               [0, 0.5, 1, 2, 3])  # fmt: skip


def test_channels_tell_their_joints_and_depths(clip):
    x = segments(clip, Segmenting("positions"))
    assert "lfingers" not in x["joint"].values
    deep = dict(zip(x["joint"].values.tolist(), x["depth"].values.tolist(), strict=True))
    assert deep["ltibia"] == deep["lfemur"] + 1
    assert skeleton_of(clip).names.index("ltibia") > 0


def test_bad_input_is_told(clip):
    with pytest.raises(InputError, match="coefficients"):
        Segmenting(coefficients=0)
    with pytest.raises(InputError, match="coefficients"):
        Segmenting(coefficients=1, static=False)


def test_a_gap_is_bridged_by_what_is_seen_and_a_limb_never_seen_is_missing(clip):
    whole = segments(clip, Segmenting("rotations"))
    gap = clip.copy(deep=True)
    gap["angle"][30:34] = np.nan
    bridged = segments(gap, Segmenting("rotations"))
    np.testing.assert_allclose(bridged.values, whole.values, atol=0.02)
    limb = clip.copy(deep=True)
    limb["angle"].loc[{"dof": "lfemur/rx"}] = np.nan
    found = segments(limb, Segmenting("rotations"))
    missing = found["joint"].values == "lfemur"
    assert np.isnan(found.values[0, missing]).all()
    np.testing.assert_allclose(found.values[0, ~missing], whole.values[0, ~missing], atol=1e-9)


def test_a_pause_matters_by_time_and_not_by_the_way_gone():
    u = np.linspace(0.0, 1.0, 60)[:, None]
    moving = np.hstack([np.sin(3 * u), u**2])
    pausing = np.concatenate([moving[:20], np.repeat(moving[20:21], 30, axis=0), moving[20:]])
    by_time, by_way = (
        np.abs(resampled(moving, 40, pace) - resampled(pausing, 40, pace)).max()
        for pace in ("time", "path")
    )
    assert by_time > 0.2
    assert by_way < 1e-9
    still = np.ones((10, 2))
    np.testing.assert_array_equal(resampled(still, 5, "path"), np.ones((5, 2)))
