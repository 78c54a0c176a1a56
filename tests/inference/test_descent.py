"""The search inside a program finds minima, and never leaves a point for a worse one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import rosen

from bayesmotion.inference.optimisation.descent import descend


def valley(x):
    return jnp.sum(100.0 * (x[1:] - x[:-1] ** 2) ** 2 + (1.0 - x[:-1]) ** 2)


def test_it_finds_the_end_of_a_bent_valley():
    begin = jnp.array([-1.2, 1.0, 0.5])
    found = jax.jit(lambda x: descend(valley, x, evaluations=300))(begin)
    np.testing.assert_allclose(found.x, 1.0, atol=1e-5)
    assert float(found.value) == pytest.approx(rosen(np.asarray(found.x)), abs=1e-12)
    assert found.evaluations < 300
    short = descend(valley, begin, evaluations=12)
    assert short.evaluations == 12
    assert found.value < short.value < rosen(np.asarray(begin))


def test_a_quadratic_learns_its_curvature():
    random = np.random.default_rng(0)
    root = random.normal(size=(6, 6)) / 6 + np.eye(6)
    away = random.normal(size=6)
    found = descend(lambda x: 0.5 * jnp.sum((root @ (x - away)) ** 2), jnp.zeros(6), evaluations=60)
    np.testing.assert_allclose(found.x, away, atol=1e-4)


def test_no_step_is_taken_to_where_the_function_is_not_finite():
    # Beyond one nothing is defined; the slope leads there.
    found = descend(
        lambda x: jnp.sum(jnp.sqrt(1.0 - x) + 50.0 * x**2 - 90.0 * x), jnp.zeros(1), evaluations=60
    )
    assert 0.5 < float(found.x[0]) < 1.0
    assert np.isfinite(float(found.value))
    nowhere = descend(lambda x: jnp.sum(jnp.log(-1.0 - x**2)), jnp.ones(2), evaluations=20)
    np.testing.assert_array_equal(nowhere.x, 1.0)
    assert float(nowhere.value) == np.inf
