"""More or fewer frames a second."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

from bayesmotion.errors import InputError, MotionWarning
from bayesmotion.motion import (
    Joint,
    Skeleton,
    concat,
    downsample,
    make_motion,
    read_amc,
    resample,
)

BODY = Skeleton(
    "stick",
    (
        Joint("root", -1, (0.0, 0.0, 0.0), channels=("rz",)),
        Joint("tip", 0, (0.0, 1.0, 0.0), channels=("rx",)),
    ),
)
TIME = np.arange(960) / 120.0


def motion(
    angle: np.ndarray, clip: str = "c", root: np.ndarray | None = None, rate: float = 120.0
) -> xr.Dataset:
    root = np.zeros(len(angle)) if root is None else root
    return make_motion(
        BODY,
        np.stack([angle, np.zeros_like(angle)], axis=1),
        np.stack([root] * 3, axis=1),
        frame_rate=rate,
        clip=clip,
    )


def share(result: xr.Dataset) -> float:
    found = re.search(r"([\d.]+)% in clip", result.attrs["history"].splitlines()[-1])
    assert found
    return float(found[1]) / 100.0


def amplitude(signal: np.ndarray, frequency: float, rate: float) -> float:
    time = np.arange(len(signal)) / rate
    return float(2.0 * np.abs(np.mean(signal * np.exp(-2j * np.pi * frequency * time))))


def test_a_fast_sine_aliases_without_filter_and_is_removed_with_it():
    # 26 Hz at 30 frames a second looks like 30 - 26 = 4 Hz.
    fast = motion(np.sin(2 * np.pi * 2 * TIME) + 0.5 * np.sin(2 * np.pi * 26 * TIME))
    with pytest.warns(MotionWarning, match=r"power above 15 Hz: 19\.9\d+% in clip c"):
        folded = downsample(fast, 4, filter="none")
    assert amplitude(folded["angle"].values[:, 0], 4.0, 30.0) == pytest.approx(0.5, rel=1e-6)
    smooth = downsample(fast, 4, filter="lowpass")
    inside = smooth["angle"].values[30:-30, 0]
    assert amplitude(inside, 4.0, 30.0) < 0.5 * 10 ** (-50 / 20)
    assert amplitude(inside, 2.0, 30.0) == pytest.approx(1.0, abs=3e-3)
    # a quarter of the power of the slow sine: 0.25 / (1 + 0.25)
    assert share(folded) == pytest.approx(0.2, rel=1e-3)
    assert share(smooth) == share(folded)


@pytest.mark.parametrize("frequency", [15.5, 20.0, 45.0])
def test_all_above_the_new_nyquist_frequency_is_removed(frequency: float):
    result = downsample(motion(np.sin(2 * np.pi * frequency * TIME)), 4, filter="lowpass")
    assert np.abs(result["angle"].values[30:-30]).max() < 10 ** (-50 / 20)


@pytest.mark.parametrize("frequency", [1.0, 5.0, 9.0])
def test_slow_movement_passes_without_delay_or_ringing(frequency: float):
    slow = np.sin(2 * np.pi * frequency * TIME)
    result = downsample(motion(slow), 4, filter="lowpass")["angle"].values[:, 0]
    np.testing.assert_allclose(result[10:-10], slow[::4][10:-10], atol=5e-3)


def test_the_ends_stay_in_place():
    ramp = 3.0 + 7.0 * TIME
    step = np.where(TIME < 4.0, 0.0, 1.0)
    result = downsample(motion(step, root=ramp), 4, filter="lowpass")
    np.testing.assert_allclose(result["root_position"][:, 0], ramp[::4], atol=1e-9)
    assert np.abs(result["angle"].values[:60]).max() < 1e-9
    np.testing.assert_allclose(result["angle"].values[-50:, 0], 1.0, atol=1e-9)


def test_none_keeps_frames_exactly_and_says_so():
    slow = motion(np.sin(2 * np.pi * TIME))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = downsample(slow, 4, filter="none")
    np.testing.assert_array_equal(result["angle"], slow["angle"][::4])
    assert result.attrs["frame_rate"] == 30.0
    np.testing.assert_allclose(result["time"], np.arange(240) / 30.0)
    assert "120 to 30 Hz, filter none" in result.attrs["history"]
    assert share(result) < 1e-4


def test_turning_past_180_degrees_is_not_a_jump():
    turning = 2 * np.pi * 0.5 * TIME
    wrapped = np.angle(np.exp(1j * turning))
    result = downsample(motion(wrapped), 4, filter="lowpass")
    np.testing.assert_allclose(
        np.exp(1j * result["angle"][:, 0]), np.exp(1j * turning[::4]), atol=1e-9
    )
    assert share(result) < 1e-6


def test_every_clip_for_itself():
    both = concat([motion(np.zeros(7), "a"), motion(np.ones(10), "b")])
    result = downsample(both, 3, filter="lowpass")
    assert result["clip"].values.tolist() == ["a"] * 3 + ["b"] * 4
    np.testing.assert_allclose(result["angle"][:, 0], [0.0] * 3 + [1.0] * 4, atol=1e-12)
    assert result["frame"].values.tolist() == list(range(7))
    assert result["time"].values.tolist()[3] == 0.0


def test_factor_one_changes_nothing(make):
    assert downsample(make(), 1) is not None
    xr.testing.assert_identical(downsample(make(), 1), make())


def test_what_cannot_be_done_is_told(make):
    with pytest.raises(InputError, match="factor 0"):
        downsample(make(), 0)
    with pytest.raises(InputError, match=r"clip 'c': of its 4 frames only one would be left"):
        downsample(motion(np.zeros(4)), 4)
    with pytest.raises(InputError, match=r"0 frames a second, filter 'lowpass'"):
        resample(make(), 0.0)


@pytest.mark.parametrize(
    ("rate", "wanted", "bound"),
    [(120.0, 30.0, 3e-3), (30.0, 120.0, 2e-4), (29.97, 30.0, 2e-4), (100.0, 30.0, 3e-3)],
)
def test_a_movement_is_the_same_at_any_rate(rate: float, wanted: float, bound: float):
    time = np.arange(round(6.0 * rate)) / rate
    result = resample(motion(np.sin(2 * np.pi * 2.0 * time), root=3.0 * time, rate=rate), wanted)
    assert result.attrs["frame_rate"] == wanted
    then = np.arange(result.sizes["frame"]) / wanted
    np.testing.assert_allclose(result["time"], then, atol=1e-12)
    assert time[-1] - 1.0 / wanted < then[-1] <= time[-1] + 1e-9
    inside = (then > 0.5) & (then < 5.5)
    expected = np.sin(2 * np.pi * 2.0 * then)
    np.testing.assert_allclose(result["angle"][inside, 0], expected[inside], atol=bound)
    np.testing.assert_allclose(result["root_position"][:, 0], 3.0 * then, atol=1e-9)


@pytest.mark.parametrize("rate", [100.0, 119.88])
def test_a_tone_above_the_new_nyquist_frequency_is_gone_at_any_ratio(rate: float):
    tone = np.sin(2 * np.pi * 17.0 * np.arange(1200) / rate)
    result = resample(motion(tone, rate=rate), 30.0)
    assert np.abs(result["angle"].values[30:-30]).max() < 10 ** (-50 / 20)
    # Where no whole part makes the rate frames are made, and filtered, whatever is asked for.
    made = resample(motion(tone, rate=rate), 30.0, filter="none")
    np.testing.assert_array_equal(made["angle"], result["angle"])


@pytest.mark.parametrize("wanted", [30.0, 50.0, 125.0, 240.0])
def test_gaps_stay_gaps_and_their_neighbours_are_told(wanted: float):
    holed = motion(np.sin(2 * np.pi * TIME))
    holed["angle"][400:480, 0] = np.nan
    result = resample(holed, wanted)
    then = result["time"].values
    lost = np.isnan(result["angle"].values[:, 0])
    np.testing.assert_array_equal(lost, (then > TIME[399] + 1e-9) & (then < TIME[480] - 1e-9))
    assert result["angle"][:, 1].notnull().all()
    away = lost | (np.abs(then - TIME[440]) < 0.7) | (then < 0.5) | (then > 7.5)
    expected = np.sin(2 * np.pi * then)
    np.testing.assert_allclose(result["angle"].values[~away, 0], expected[~away], atol=3e-3)
    assert np.abs(result["angle"].values[~lost, 0] - expected[~lost]).max() < 0.5


def test_rotations_near_gimbal_lock_go_the_short_way():
    ball = Skeleton("ball", (Joint("root", -1, (0.0, 0.0, 0.0), channels=("rz", "rx", "ry")),))
    time = np.arange(480) / 120.0
    way = np.stack([0.3 * np.sin(2 * time), np.sin(3 * time) * 1.5 + 0.3, 0.4 * time], axis=1)
    turned = Rotation.from_euler("y", 1.0) * Rotation.from_rotvec(way)
    # Angles that jump from one triple to the other, as files have them.
    made = make_motion(ball, turned.as_euler("ZXY"), np.zeros((480, 3)), frame_rate=120.0, clip="c")
    for wanted in (30.0, 50.0, 200.0):
        result = resample(made, wanted)
        then = result["time"].values
        way = np.stack([0.3 * np.sin(2 * then), np.sin(3 * then) * 1.5 + 0.3, 0.4 * then], axis=1)
        expected = Rotation.from_euler("y", 1.0) * Rotation.from_rotvec(way)
        found = Rotation.from_euler("ZXY", result["angle"].values)
        apart = (found.inv() * expected).magnitude()
        assert apart[(then > 0.4) & (then < 3.6)].max() < 5e-3


@pytest.mark.real_data
def test_a_real_walk_keeps_its_course(data_root: Path):
    walk = read_amc(data_root / "cmu/35/35_01.amc")
    result = downsample(walk, 4, filter="lowpass")
    big = ["lfemur/rx", "rfemur/rx", "lhumerus/ry"]
    difference = result["angle"].sel(dof=big).values - walk["angle"].sel(dof=big).values[::4]
    assert np.degrees(np.abs(difference)).max() < 1.5
    assert 0.001 < share(result) < 0.05
