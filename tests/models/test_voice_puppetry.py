"""Voice puppetry: the trajectory against a search, and a puppet that follows its sound."""

import numpy as np
import pytest
from scipy.optimize import minimize

from bayesmotion.errors import InputError
from bayesmotion.models.entropic_hmm import HMM
from bayesmotion.models.voice_puppetry import train_puppet, trajectory, velocity


def test_trajectory_is_the_minimum():
    random = np.random.default_rng(0)
    roots = random.normal(size=(3, 4, 4))
    covariance = roots @ roots.transpose(0, 2, 1) + 0.5 * np.eye(4)
    hmm = HMM(np.ones(3) / 3, np.ones((3, 3)) / 3, random.normal(size=(3, 4)), covariance)
    occupancy = random.dirichlet(np.ones(3), 6)
    found = trajectory(hmm, occupancy)
    precision = np.linalg.inv(covariance)

    def cost(flat):
        z = flat.reshape(6, 2)
        total = 0.0
        for t, k in np.ndindex(6, 3):
            if t:
                o = np.concatenate([z[t], z[t] - z[t - 1]]) - hmm.mean[k]
                total += occupancy[t, k] * o @ precision[k] @ o
            else:
                # Without a velocity the position has its part of the precision alone.
                o, mean = z[t], hmm.mean[k]
                part = precision[k][:2]
                total += occupancy[t, k] * (o @ part[:, :2] @ o - 2.0 * o @ part @ mean)
        return total

    best = minimize(cost, np.zeros(12), tol=1e-10).x.reshape(6, 2)
    np.testing.assert_allclose(found, best, atol=1e-4)


def test_a_puppet_follows_its_sound():
    random = np.random.default_rng(1)
    faces, sounds = [], []
    for _ in range(6):
        angle = np.cumsum(0.25 + 0.05 * random.normal(size=120)) + random.uniform(0, 6)
        x = np.column_stack([np.cos(angle), np.sin(angle)])
        faces.append(x @ np.array([[2.0, 0.5, 1.0], [0.3, -1.0, 2.0]]) + 5.0)
        sounds.append(x + 0.1 * random.normal(size=x.shape))
    puppet = train_puppet(sounds[:5], faces[:5], states=12, seed=0)
    made = puppet.speak(sounds[5])
    assert np.sqrt(np.mean((made - faces[5]) ** 2)) < 0.25 * faces[5].std()
    with pytest.raises(InputError, match="differ in frames"):
        train_puppet(sounds[:1], [faces[0][:-1]], states=2, seed=0)


def test_velocity_of_the_first_frame_is_that_of_the_second():
    np.testing.assert_array_equal(velocity(np.array([[0.0], [1.0], [3.0]])), [[1.0], [1.0], [2.0]])
