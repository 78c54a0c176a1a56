"""Pieces of the study of dances, on energies and poses whose answer is known."""

import numpy as np
import pytest

from bayesmotion.models.keyposes.rule import KeyposeFrames
from bayesmotion.studies.keypose.dance import FRAMES_A_BEAT, at_beats, low_at, pca, pool


def test_energy_that_rests_at_the_beats_is_low_there_and_not_after_a_shift():
    time = np.arange(1000)
    flow = np.abs(np.sin(np.pi * time / FRAMES_A_BEAT))
    beats = np.arange(0.0, 999, FRAMES_A_BEAT)
    assert low_at(flow, beats) == 1.0
    assert low_at(flow, beats + FRAMES_A_BEAT / 2) < 0.05
    found = at_beats((flow, np.ones(1000)), seed=0)
    assert found["global"]["share"] == 1.0
    assert 0.3 < found["global"]["control"] < 0.7
    assert found["global"]["energy_at_beats"] < 0.2
    pooled = pool([found["global"]])
    assert pooled["control"] == pytest.approx(found["global"]["control"])
    assert pooled["control_largest"] <= 1.0


def test_keyposes_that_span_a_plane_cover_it_with_two_components():
    random = np.random.default_rng(0)
    frames, joints = 200, 23
    axes = random.normal(size=(2, joints * 3))
    # Extremes in a plane at every tenth frame; in between poses also stray out of it.
    position = random.normal(size=(frames, 2)) @ axes
    position[::10] *= 5.0
    away = np.ones(frames)
    away[::10] = 1e-4
    position += away[:, None] * random.normal(size=position.shape)
    body = position.reshape(frames, joints, 3)
    # Fixed hips and waist, so that the body's frame leaves all other joints as they are.
    body[:, 7], body[:, 16], body[:, 2] = (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    every = np.arange(0, frames, 10)
    keyposes = KeyposeFrames(every, np.arange(len(every)), ("global",) * len(every))
    found = pca(body, keyposes)
    assert found["keypose"][1] == pytest.approx(1.0, abs=1e-6)
    assert found["uniform"][1] < 0.95
    assert found["n"] == len(every)
