"""Keyposes: energy, minima, selection, thresholds, on motions whose truth is known."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.models.keyposes.energy import (
    Minima,
    Thresholds,
    body_centred,
    energy,
    minima_near,
    turning_points,
)
from bayesmotion.models.keyposes.flows import flows
from bayesmotion.models.keyposes.rule import NEVER, learn_both, learn_thresholds, score, select
from bayesmotion.motion.dataset import skeleton_of
from bayesmotion.motion.kinematics import positions
from bayesmotion.motion.roles import hips_and_waist
from bayesmotion.motion.synthetic.dance import synthetic_dance
from bayesmotion.tasks.keyposes import keyposes_of

RATE, TOLERANCE = 60.0, 6


def near(dance):
    flow = flows(positions(dance.motion).values, RATE, hips_and_waist(skeleton_of(dance.motion)))
    window = 0.5 * np.median(np.diff(dance.beats)) * RATE
    return [minima_near(part, dance.beats * RATE, window) for part in flow]


@pytest.fixture(scope="module")
def learned():
    dances = [synthetic_dance(seed, noise=0.02, drift=0.03) for seed in range(100, 106)]
    return learn_both([(*near(dance), dance.keyposes) for dance in dances], TOLERANCE)


def test_energy_of_a_uniform_motion_is_its_speed():
    t = np.arange(50) / 10.0
    position = np.zeros((50, 4, 3))
    position[:, :, 0] = 3.0 * t[:, None]
    np.testing.assert_allclose(energy(position, 10.0, smoothing=0.0), 3.0)
    position[:, :2, 0] *= -1.0
    np.testing.assert_allclose(energy(position, 10.0, smoothing=0.0), 0.0, atol=1e-12)
    weight = np.array([1.0, 1.0, 3.0, 3.0])
    np.testing.assert_allclose(energy(position, 10.0, weight=weight, smoothing=0.0), 1.5)


def test_the_body_does_not_see_turns_and_travel():
    random = np.random.default_rng(0)
    body = np.array([[0.1, 0, 0], [-0.1, 0, 0], [0, 0.3, 0.02], [0.4, 0.2, 0.3]])
    angle = np.cumsum(random.normal(size=40) * 0.1)
    turn = np.stack([[[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]]
                     for a in angle])  # fmt: skip
    moved = np.einsum("nab,jb->nja", turn, body) + np.cumsum(random.normal(size=(40, 1, 3)), 0)
    seen = body_centred(moved, 0, 1, 2)
    np.testing.assert_allclose(seen, np.broadcast_to(seen[0], seen.shape), atol=1e-12)
    np.testing.assert_allclose(seen[0, 0], [0.1, 0, 0], atol=1e-12)
    assert seen[0, 2, 2] > 0
    assert energy(moved, 10.0).mean() > 1.0
    assert energy(seen, 10.0).max() < 1e-9


def test_minima_are_the_nearest_ones_with_their_depth():
    flow = np.array([5, 3, 1, 2, 6, 4, 2.5, 4, 7, 7, 8], dtype=float)
    assert turning_points(flow).tolist() == [2, 6]
    found = minima_near(flow, np.array([3.5, 5.0, 9.0]), window=2.0)
    assert found.frame.tolist() == [2, 6, -1]
    np.testing.assert_allclose(found.energy, [1, 2.5, np.nan])
    np.testing.assert_allclose(found.depth, [5 - 1, 6 - 2.5, np.nan])


def test_a_global_candidate_wins_over_one_of_the_body():
    one = Minima(np.array([10, -1, 30]), np.array([0.1, np.nan, 0.9]), np.array([1, np.nan, 0.1]))
    other = Minima(np.array([12, 21, 31]), np.array([0.1, 0.2, 0.1]), np.array([1.0, 1.0, 1.0]))
    found = select(one, other, (Thresholds(0.5, 9.0), Thresholds(0.5, 9.0)))
    assert found.frame.tolist() == [10, 21, 31]
    assert found.source == ("global", "body", "body")
    deep = select(one, other, (Thresholds(-1.0, 0.05), NEVER))
    assert deep.frame.tolist() == [10, 30]


def test_score_takes_every_true_keypose_once():
    assert score(np.array([10, 12, 50]), np.array([11, 30]), 2) == (1 / 3, 1 / 2)
    assert score(np.array([], int), np.array([5]), 2) == (1.0, 0.0)


def test_without_noise_precision_and_recall_are_one(learned):
    for seed in range(4):
        dance = synthetic_dance(seed)
        found, _, _ = keyposes_of(dance.motion, dance.beats, learned)
        assert score(found.frame, dance.keyposes, TOLERANCE) == (1.0, 1.0)


def test_beats_at_the_wrong_time_and_noise_do_worse(learned):
    shares = []
    for settings, shift in (({}, 0.0), ({}, 0.3), ({"noise": 0.3}, 0.0)):
        dance = synthetic_dance(3, **settings)
        found, _, _ = keyposes_of(dance.motion, dance.beats + shift, learned, window=0.1)
        shares.append(sum(score(found.frame, dance.keyposes, TOLERANCE)))
    assert shares[0] == 2.0
    assert max(shares[1:]) < 1.9


def test_thresholds_are_learned_between_the_classes():
    frame = np.arange(0, 100, 10)
    low = np.where(frame < 50, 0.2, 0.8)
    minima = Minima(frame, low, np.full(10, 0.01))
    found = learn_thresholds([(minima, frame[:5])], 1)
    assert 0.2 <= found.low < 0.8
    assert found.deep > 0.01


def test_bad_input_is_told():
    dance = synthetic_dance(0)
    with pytest.raises(InputError, match="none lies within the clip"):
        keyposes_of(dance.motion, np.array([-1.0, 900.0]))
    with pytest.raises(InputError, match="weights"):
        energy(np.zeros((5, 2, 3)), 30.0, weight=-np.ones(2))
    with pytest.raises(InputError, match="on a line"):
        body_centred(np.zeros((5, 3, 3)), 0, 1, 2)
    with pytest.raises(InputError, match="four beats"):
        synthetic_dance(0, beats=2)
