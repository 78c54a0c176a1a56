"""Harmonics of a circle against Bessel functions and the kernel itself."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import ive

from bayesmotion.distributions.circle import circle
from bayesmotion.gp.harmonics import amplitudes, waves
from bayesmotion.gp.kernels import rbf


@pytest.mark.parametrize("gamma", [1e-6, 0.05, 0.77, 5.0, 20.0])
def test_amplitudes_are_bessel_functions_to_the_smallest(gamma):
    bessel = ive(np.arange(41), gamma) * np.where(np.arange(41), 2.0, 1.0)
    there = bessel > 1e-290
    found = np.asarray(amplitudes(jnp.array(gamma), 40))
    np.testing.assert_allclose(found[there] ** 2, bessel[there], rtol=1e-11)


def test_too_sharp_a_kernel_has_no_amplitudes():
    assert np.isfinite(amplitudes(jnp.array(2.3), 16)).all()
    assert np.isnan(amplitudes(jnp.array(2.4), 16)).all()
    assert np.isnan(amplitudes(jnp.array(1e6), 16)).all()


@pytest.mark.parametrize("gamma", [0.05, 0.77, 20.0])
def test_waves_have_the_kernel_for_inner_products(gamma):
    angles = np.random.default_rng(0).uniform(-300.0, 300.0, size=30)
    points = circle(jnp.asarray(angles))
    K = rbf("x", length_scale=gamma**-0.5).matrix({"x": points}, {"x": points})
    features = waves(points, amplitudes(jnp.array(gamma), 40))
    np.testing.assert_allclose(features @ features.T, K, atol=2e-14)


@pytest.mark.parametrize("gamma", [1e-9, 0.77, 20.0])
def test_gradients_are_those_of_the_kernel(gamma):
    angles, weights = np.random.default_rng(1).normal(size=(2, 30))

    def by_waves(gamma, angles):
        features = waves(circle(angles), amplitudes(gamma, 40))
        return jnp.sum((weights @ features) ** 2)

    def by_kernel(gamma, angles):
        away = angles[:, None] - angles
        return weights @ jnp.exp(-gamma * (1.0 - jnp.cos(away))) @ weights

    found = jax.grad(by_waves, (0, 1))(jnp.array(gamma), jnp.asarray(angles))
    true = jax.grad(by_kernel, (0, 1))(jnp.array(gamma), jnp.asarray(angles))
    np.testing.assert_allclose(found[0], true[0], rtol=1e-9)
    np.testing.assert_allclose(found[1], true[1], rtol=1e-9, atol=1e-9 * np.abs(true[1]).max())
