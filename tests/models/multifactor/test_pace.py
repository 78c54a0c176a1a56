"""A clip's pace: learned from others, and the phase that wanders about it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.models.multifactor import Circle
from bayesmotion.models.multifactor.pace import WANDER_S, step_distribution, wandering

RATE = 30.0


def alike(count, apart=0.0):
    """Return products of styles: all the same, but for the last by `apart`."""
    styles = np.ones((count, 2)) * [1.0, 0.0]
    styles[-1, 1] = apart
    return styles @ styles.T


def draws_of(styles, known):
    """Draw a new clip's log step."""
    steps = step_distribution(RATE, styles, jnp.asarray(known))
    return np.log(np.asarray(steps.sample(jax.random.key(0), (20_000,))))


def test_a_new_clip_is_expected_at_the_pace_of_those_it_is_like():
    random = np.random.default_rng(0)
    known = np.exp(np.log(0.25) + 0.03 * random.normal(size=60))
    near, far = (draws_of(alike(61, apart), known) for apart in (0.0, 5.0))
    assert abs(near.mean() - np.log(known).mean()) < 0.002
    assert near.std() == pytest.approx(0.03, rel=0.15)
    # Of styles that nobody had the pace is hardly known.
    assert far.std() > 0.3


def test_the_conditional_is_that_of_the_joint_density():
    random = np.random.default_rng(1)
    styles = random.normal(size=(5, 3))
    steps = np.exp(random.normal(-1.5, 0.2, size=5))
    alike = styles @ styles.T
    whole = step_distribution(RATE, alike).log_prob(jnp.asarray(steps))
    part = step_distribution(RATE, alike[:3, :3]).log_prob(jnp.asarray(steps[:3]))
    given = step_distribution(RATE, alike, jnp.asarray(steps[:3]))
    found = np.asarray(given.log_prob(jnp.asarray(steps[3:])))
    assert float(found) == pytest.approx(float(np.subtract(whole, part)), rel=1e-6)


def gone(white, sd=0.1, context=9, count=90, step=0.2):
    time = np.arange(count) - (context - 1) / 2.0
    each = np.full(count, 1.0)
    both = np.broadcast_to(white, (count, 2))
    return np.asarray(wandering(time, each * (context - 1) / 2, each * step, both, sd, RATE))


def test_without_wandering_the_phase_goes_at_the_pace():
    time = np.arange(90) - 4.0
    np.testing.assert_allclose(gone([0.0, 0.0]), 0.2 * time, atol=1e-12)
    np.testing.assert_allclose(gone([1.3, -2.0], sd=0.0), 0.2 * time, atol=1e-12)


def test_the_speed_of_the_context_is_forgotten_after_it():
    speed = np.diff(gone([2.0, 0.0])) / 0.2
    np.testing.assert_allclose(speed[:8], speed[0], rtol=1e-9)
    assert speed[0] > 1.05
    # After five time scales less than a hundredth of it is left.
    late = int(8 + 5 * WANDER_S * RATE + 1)
    assert np.abs(speed[late:] - 1.0).max() < 0.01 * (speed[0] - 1.0)


def test_the_phase_is_off_as_an_integrated_process_simulated():
    sd, tau, frames, draws = 0.1, WANDER_S * RATE, 60, 20_000
    random = np.random.default_rng(2)
    decay, fine = np.exp(-0.1 / tau), 10
    speed, phase = sd * random.normal(size=draws), np.zeros(draws)
    for _ in range(frames * fine):
        fresh = sd * np.sqrt(1 - decay**2) * random.normal(size=draws)
        later = decay * speed + fresh
        phase += 0.5 * (speed + later) / fine
        speed = later
    told = gone([0.0, 1.0], context=1, count=frames + 1, step=1.0) - np.arange(frames + 1)
    error = 1.0 / np.sqrt(2 * draws)
    assert abs(phase.std() / told[-1] - 1.0) < 4 * error + 0.01


def test_the_gradient_is_finite_at_the_end_of_the_context():
    def last(white):
        time = jnp.arange(9.0) - 4.0
        each = jnp.ones(9)
        return jnp.sum(wandering(time, 4.0 * each, 0.2 * each, white * each[:, None], 0.1, RATE))

    assert np.isfinite(np.asarray(jax.grad(last)(jnp.array([0.3, -0.2])))).all()


def test_what_is_no_sd_is_refused():
    with pytest.raises(InputError, match="wander_sd"):
        Circle(wander_sd=-0.1)
