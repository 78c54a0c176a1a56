"""Phases as points of the plane: uniform directions, and a length that says nothing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import kstest

from bayesmotion.distributions.circle import Ring, angle_of, circle


def test_the_density_integrates_to_one():
    side = jnp.linspace(-2.0, 2.0, 401)
    points = jnp.stack(jnp.meshgrid(side, side), axis=-1).reshape(-1, 1, 2) + 1e-9
    mass = jnp.sum(jnp.exp(jax.vmap(Ring(1).log_prob)(points))) * (side[1] - side[0]) ** 2
    assert mass == pytest.approx(1.0, abs=1e-5)


def test_directions_are_uniform_and_lengths_near_one():
    draws = np.asarray(Ring(3).sample(jax.random.key(0), (2000,)))
    assert draws.shape == (2000, 3, 2)
    angle = np.arctan2(draws[..., 1], draws[..., 0])
    for clip in range(3):
        assert kstest(angle[:, clip], "uniform", (-np.pi, 2 * np.pi)).pvalue > 1e-3
    length = np.linalg.norm(draws, axis=-1)
    assert np.log(length).std() == pytest.approx(0.1, rel=0.05)


def test_the_density_does_not_depend_on_the_direction():
    lengths = np.array([0.9, 1.2])[:, None]
    found = [
        float(Ring(2).log_prob(lengths * np.asarray(circle(np.array([a, 2.0 - a])))))
        for a in np.linspace(-3.0, 3.0, 7)
    ]
    np.testing.assert_allclose(found, found[0], rtol=1e-12)


def test_an_angle_is_that_of_its_point():
    angle = np.array([-3.0, -0.5, 0.0, 2.0])
    np.testing.assert_allclose(angle_of(1.7 * circle(angle)), angle, atol=1e-12)
