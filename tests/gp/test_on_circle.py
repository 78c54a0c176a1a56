"""Densities, conditionals and draws by harmonics against the dense ones."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayesmotion.distributions.circle import circle
from bayesmotion.gp.kernels import linear, rbf
from bayesmotion.gp.leave_out import leave_out_each
from bayesmotion.gp.markov import lanes_of
from bayesmotion.gp.matrix_normal import condition, misfit_of_columns, patterns
from bayesmotion.gp.on_circle import CircleCovariance

SIZES = (40, 9, 70, 25)
N, D = sum(SIZES), 3
CLIP = np.repeat(np.arange(4), SIZES)
TIME = np.concatenate([np.arange(float(size)) for size in SIZES])
POINTS = {"x": circle(jnp.asarray(0.3 * TIME + CLIP)), "style": np.array([[1.0, 0.2]] * N)}


# Of few harmonics, and of many.
GAMMAS = (0.8, 6.0)


def arguments(gamma=0.8):
    """Gamma, styles, variances, time scales and noise."""
    random = np.random.default_rng(0)
    styles = jnp.asarray(random.normal(size=(4, 2)))
    return (
        jnp.array(gamma), styles, jnp.array([0.5, 0.1, 0.0, 0.3]), jnp.array([3.0, 1.0, 2.0, 20.0]),
        jnp.array(0.05),
    )  # fmt: skip


def circular(gamma, styles, variance, time_scale, noise):
    return CircleCovariance(
        gamma, POINTS["x"], styles, variance, time_scale, noise, TIME, lanes_of(SIZES)
    )


def dense(gamma, styles, variance, time_scale, noise):
    points = {"x": POINTS["x"], "style": styles[CLIP]}
    K = (rbf("x", length_scale=gamma**-0.5) * linear("style")).matrix(points, points)
    apart = jnp.abs(TIME[:, None] - TIME) / time_scale[CLIP]
    own = (CLIP[:, None] == CLIP) * variance[CLIP] * jnp.exp(-apart)
    return K + own + noise * jnp.eye(N)


@pytest.fixture
def y():
    made = np.random.default_rng(1).normal(size=(N, D))
    made[[0, 3, 100], 1] = np.nan
    made[:, 2] = np.nan
    return made


@pytest.mark.parametrize("gamma", GAMMAS)
def test_misfit_is_that_of_the_dense_covariance(y, gamma):
    missing = patterns(np.isfinite(y))
    found = misfit_of_columns(y, circular(*arguments(gamma)), missing)
    for one, true in zip(
        found, misfit_of_columns(y, dense(*arguments(gamma)), missing), strict=True
    ):
        # The dense form adds its jitter also to the identity in place of what is not seen.
        np.testing.assert_allclose(one, true, rtol=1e-10, atol=2e-8)


@pytest.mark.parametrize("gamma", GAMMAS)
def test_gradient_is_that_of_the_dense_covariance(y, gamma):
    missing = patterns(np.isfinite(y))

    def total(form, args):
        misfit, logdet, _ = misfit_of_columns(y, form(*args), missing)
        return misfit @ jnp.arange(1.0, 1.0 + D) + 3.0 * jnp.sum(logdet)

    found = jax.grad(lambda args: total(circular, args))(arguments(gamma))
    true = jax.grad(lambda args: total(dense, args))(arguments(gamma))
    for one, other in zip(found, true, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-7, atol=1e-9 * np.abs(other).max())


def test_a_kernel_too_sharp_for_the_harmonics_has_no_density(y):
    gamma, *others = arguments()
    sharp = circular(100.0 * gamma, *others)
    assert np.isnan(misfit_of_columns(y, sharp, patterns(np.isfinite(y)))[0][:2]).all()


def test_second_derivatives_are_those_of_the_dense_covariance(y):
    missing, gammas = patterns(np.isfinite(y)), jnp.asarray(GAMMAS)

    def curvature(form):
        def slope(gamma):
            def total(gamma):
                misfit, logdet, _ = misfit_of_columns(y, form(gamma, *arguments()[1:]), missing)
                return jnp.sum(misfit + logdet)

            return jax.grad(total)(gamma)

        return jax.jit(jax.vmap(jax.value_and_grad(slope)))(gammas)

    # As a batch in which one needs more harmonics than the other.
    for found, true in zip(curvature(circular), curvature(dense), strict=True):
        np.testing.assert_allclose(found, true, rtol=1e-6)


@pytest.mark.parametrize("gamma", GAMMAS)
def test_predictions_are_those_of_the_dense_covariance(y, gamma):
    missing = patterns(np.isfinite(y))
    content, styles = circle(jnp.linspace(0.0, 5.0, 7)), jnp.ones((7, 2))
    kernel = rbf("x", length_scale=gamma**-0.5) * linear("style")
    new = {"x": content, "style": styles}
    trained = {"x": POINTS["x"], "style": arguments(gamma)[1][CLIP]}
    own = kernel.matrix(new, new) + 0.5 * jnp.eye(7)
    found = circular(*arguments(gamma)).condition(y, missing)(content, styles, own)
    true = condition(y, dense(*arguments(gamma)), missing)(kernel.matrix(new, trained), own)
    for one, other in zip(found, true, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-10)


def test_entries_left_out_are_predicted_as_by_the_dense_covariance(y):
    missing, scale = patterns(np.isfinite(y)), jnp.arange(1.0, 1.0 + D)
    found, true = (
        leave_out_each(jnp.nan_to_num(y), form(*arguments()), scale, missing)
        for form in (circular, dense)
    )
    for one, other in zip(found, true, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-8)


def test_draws_have_the_covariance():
    process = circular(*arguments())
    drawn = np.asarray(process.sample(jax.random.key(0), (2,), 3000))
    assert drawn.shape == (2, N, 3000)
    K = np.asarray(dense(*arguments()))
    sd = np.sqrt(np.diag(K))
    # Correlations of 6000 columns are known to 0.013.
    found = np.concatenate(drawn, axis=1)
    np.testing.assert_allclose(found @ found.T / 6000 / np.outer(sd, sd), K / np.outer(sd, sd),
                               atol=0.08)  # fmt: skip
