"""Gaps of markers: filled in exactly where they follow from the others, with honest intervals."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bayesmotion.gp.marker_gaps import aligned, fill_marker_gaps, runs
from bayesmotion.prediction import Mixture

RATE = 50.0


def walking(seed=0, frames=700, markers=8):
    """Markers on a body that turns and goes, bending in two ways; coordinates in mm."""
    random = np.random.default_rng(seed)
    t = np.arange(frames) / RATE
    shape = 300.0 * random.normal(size=(markers, 3))
    ways = 60.0 * random.normal(size=(2, markers, 3))
    bends = np.sin(2 * np.pi * np.stack([0.9 * t, 1.3 * t + 0.7]) + random.uniform(0, 6, (2, 1)))
    local = shape + np.einsum("kt,kmi->tmi", bends, ways)
    turn = Rotation.from_euler("y", 0.4 * t[:, None]).as_matrix()
    place = np.column_stack([900.0 * t, 20.0 * np.sin(5 * t), 0.0 * t])
    return np.einsum("tij,tmj->tmi", turn, local) + place[:, None]


def with_gap(position, marker=2, first=300, length=50):
    out = position.copy()
    out[first : first + length, marker] = np.nan
    return out


def test_what_follows_from_the_others_is_filled_in():
    position = walking()
    [gap] = fill_marker_gaps(with_gap(position), RATE)
    assert (gap.marker, gap.frames[0], len(gap.frames)) == (2, 300, 50)
    away = np.linalg.norm(gap.mean - position[gap.frames, 2], axis=-1)
    across = np.linalg.norm(position[350, 2] - position[300, 2])
    assert away.max() < 0.01 * across


def test_unit_and_room_do_not_matter():
    position = with_gap(walking() + np.random.default_rng(1).normal(size=(700, 8, 3)))
    turn, moved = Rotation.from_euler("xyz", [0.3, 1.2, -2.0]).as_matrix(), [5e3, -2e3, 700.0]
    [one], [other] = (
        fill_marker_gaps(each, RATE) for each in (position, 1e-3 * (position @ turn.T + moved))
    )
    np.testing.assert_allclose(other.mean, 1e-3 * (one.mean @ turn.T + moved), atol=1e-9)
    np.testing.assert_allclose(other.sds, 1e-3 * one.sds, rtol=1e-6)


def test_a_turn_is_found_and_is_no_reflection():
    shape = np.random.default_rng(2).normal(size=(5, 3))
    turns = Rotation.random(4, rng=3).as_matrix()
    turn, place = aligned(np.einsum("tij,mj->tmi", turns, shape) + 7.0, shape)
    np.testing.assert_allclose(turn, turns, atol=1e-12)
    np.testing.assert_allclose(place, 7.0, atol=1e-12)
    flat = shape * [1.0, 1.0, 0.0]
    mirrored, _ = aligned((flat * [-1.0, 1.0, 1.0])[None], flat)
    assert np.linalg.det(mirrored[0]) == pytest.approx(1.0)


def coverage(widened=1.0):
    """Share of coordinates in 90 % intervals, and its standard error over recordings."""
    shares = []
    for seed in range(16):
        random = np.random.default_rng(seed)
        position = walking(seed)
        # What no other marker tells: a smooth movement of its own, and noise.
        t = np.arange(-60, len(position))
        smooth = np.exp(-0.5 * (np.arange(-30, 31) / 8.0) ** 2)
        own = random.normal(size=(len(t) + 60, 3))
        own = np.stack([np.convolve(column, smooth, "valid") for column in own.T], axis=1)
        position[:, 2] += 4.0 * own[-len(position) :]
        position += random.normal(size=position.shape)
        [gap] = fill_marker_gaps(with_gap(position, first=int(random.integers(50, 600))), RATE)
        sd = widened * np.repeat(gap.sds[:, :, None], 3, axis=2)
        count = len(sd)
        mixture = Mixture(np.repeat(gap.mean[None], count, 0), sd, np.full(count, 1.0 / count))
        true = position[gap.frames, 2]
        inside = (true > mixture.quantile(0.05)) & (true < mixture.quantile(0.95))
        shares.append(inside.mean())
    return np.mean(shares), np.std(shares) / 4.0


@pytest.mark.thorough
def test_intervals_hold_what_they_say():
    share, error = coverage()
    assert abs(share - 0.9) < 3.0 * error + 0.02
    narrow, error = coverage(widened=0.5)
    assert narrow < 0.9 - 3.0 * error


def test_gaps_at_the_ends_and_of_all_the_markers():
    position = walking(markers=4)
    cut = position.copy()
    cut[:30, 1] = cut[-40:, 2] = cut[200:220] = np.nan
    gaps = {(gap.marker, int(gap.frames[0])): gap for gap in fill_marker_gaps(cut, RATE)}
    assert set(gaps) == {(1, 0), (2, 660), *((m, 200) for m in range(4))}
    for (marker, _), gap in gaps.items():
        away = np.linalg.norm(gap.mean - position[gap.frames, marker], axis=-1)
        assert np.isfinite(gap.sds).all()
        assert away.max() < 0.2 * np.linalg.norm(position[-1, 1] - position[0, 1])


def test_a_gap_longer_than_what_is_known_says_so():
    position = walking(frames=90)
    position[5:80, 2] = np.nan
    [gap] = fill_marker_gaps(position, RATE)
    assert not gap.tried
    assert np.isfinite(gap.mean).all()


def test_runs_are_unbroken():
    mask = np.array([True, False, True, True, False, True])
    assert [run.tolist() for run in runs(mask)] == [[0], [2, 3], [5]]
    assert list(runs(np.zeros(3, dtype=bool))) == []
