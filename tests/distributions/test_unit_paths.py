"""Draws of hyperparameters and paths of unit scale, against the density summed on a grid."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpyro import distributions as dist

from bayesmotion.distributions.dynamics import GPDynamics, UnitScale, path_scale, steps_of
from bayesmotion.distributions.unit_paths import BOUND, WINDOW, draw_unit_path, log_ratio, movement
from bayesmotion.models.multifactor import Multifactor
from bayesmotion.models.multifactor import settings as of

STEPS, SHAPE, DRAWS = steps_of([3]), (3, 1), 8000
PRIOR = dist.LogNormal(jnp.zeros(1), 1.0).to_event(1)
# The movement of three frames about their mean: a circle in this plane.
PLANE = np.array([[1.0, 0.0, -1.0], [0.5, -1.0, 0.5]]) * np.sqrt([[1.5], [2.0]])


def path_of(hyper):
    """Dynamics of first order whose linear variance is unknown."""
    return GPDynamics(jnp.array([0.5, 1.0, 0.0, 4.0]).at[2].set(hyper[0]), STEPS, SHAPE)


def statistics(log_alpha, mean, shape):
    """What is compared: of the hyperparameter, the mean, the shape, and all of them together."""
    first, _, last = shape[..., 0], shape[..., 1], shape[..., 2]
    return jnp.stack(
        [log_alpha, log_alpha**2, mean**2, first * last, first**2, log_alpha * mean * last], axis=-1
    )


@pytest.fixture(scope="module")
def draws():
    draw = jax.jit(jax.vmap(lambda key: draw_unit_path(key, PRIOR, path_of)))
    hyper, x = draw(jax.random.split(jax.random.key(0), DRAWS))
    return np.asarray(hyper[:, 0]), np.asarray(x[..., 0])


def test_draws_have_the_joint_density_of_hyperparameter_and_path(draws):
    hyper, x = draws
    mean = x.mean(axis=1)
    moved = x - mean[:, None]
    found = statistics(np.log(hyper), mean, moved / np.sqrt(np.mean(moved**2, axis=1))[:, None])
    angle = 2.0 * np.pi * np.arange(60) / 60
    u = np.cos(angle)[:, None] * PLANE[0] + np.sin(angle)[:, None] * PLANE[1]
    grid = np.meshgrid(np.linspace(-6, 5, 45), np.linspace(-5, 5, 51), np.arange(60), indexing="ij")
    log_alpha, m, number = (jnp.asarray(axis.ravel()) for axis in grid)
    shape = jnp.asarray(u)[number]

    @jax.jit
    @jax.vmap
    def log_joint(log_alpha, m, shape):
        hyper = jnp.exp(log_alpha)[None]
        path = UnitScale(path_of(hyper)).log_prob((m + shape)[:, None])
        return path + dist.Normal().log_prob(log_alpha)

    weight = jnp.exp(log_joint(log_alpha, m, shape))
    every = statistics(log_alpha, m, shape)
    exact = np.asarray(weight @ every / weight.sum())
    errors = np.asarray(found).std(axis=0) / np.sqrt(DRAWS)
    off = (np.asarray(found).mean(axis=0) - exact) / errors
    assert np.abs(off).max() < 3.5
    # The prior of the hyperparameter is another: draws of it would be caught.
    assert np.abs(exact[0] / errors[0]) > 5


def test_the_scale_of_a_path_is_independent_of_all_else(draws):
    hyper, x = draws
    log_scale = np.log([float(path_scale(one[:, None], STEPS)) for one in x[:400]])
    moments = [(log_scale - 1.0) * np.sqrt(2.0), (log_scale - 1.0) * np.log(hyper[:400])]
    for moment in moments:
        assert abs(moment.mean()) < 3.5 * moment.std() / 20.0
    assert np.std(moments[0]) == pytest.approx(1.0, abs=0.12)


def small_path_of(order):
    """Paths and their prior as the small models of the calibration have them."""
    content = of.GPDynamics(size=2, order=order, noise_sd=0.3)
    factors = (of.Factor("subject", 2),)
    trial, frames = Multifactor(content, factors=factors, residual=of.White()).sbc_case()
    medians = jnp.log(jnp.asarray(trial.model.alpha_median(frames.frame_rate)))

    def path_of(alpha):
        full = trial.model.dynamics_alpha({"alpha": alpha})
        return GPDynamics(full, frames.steps, (len(frames.clip), 2))

    return dist.LogNormal(medians, 1.0).to_event(1), path_of


@pytest.mark.parametrize(
    ("prior", "path_of"), [(PRIOR, path_of), small_path_of(1), small_path_of(2)]
)
def test_hardly_any_weight_is_lost_to_the_bound(prior, path_of):
    def one(key):
        path = path_of(prior.sample(key))
        x = path.sample(jax.random.fold_in(key, 1))
        near = jnp.abs(jnp.log(path_scale(x, path.steps))) * movement(path) < WINDOW
        return jnp.where(near, jnp.exp(log_ratio(path, x)), 0.0)

    keys = jax.random.split(jax.random.key(1), 30_000)
    weight = np.asarray(jax.jit(lambda keys: jax.lax.map(one, keys, batch_size=1000))(keys))
    assert np.sum(weight > 0.0) > 100
    assert np.sum(np.maximum(weight - BOUND, 0.0)) < 2e-3 * np.sum(weight)
