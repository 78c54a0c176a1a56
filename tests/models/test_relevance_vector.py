"""The relevance vector machine: marginal likelihood, fast maximisation, EM and NUTS."""

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import pytest
import xarray as xr
from scipy.stats import lognorm, multivariate_normal, norm

from bayesmotion.errors import InputError
from bayesmotion.inference.nuts import fit_nuts
from bayesmotion.models.relevance_fast import maximise_marginal
from bayesmotion.models.relevance_marginal import expectation_maximisation, log_marginal
from bayesmotion.models.relevance_vector import Design, RelevanceVectors, basis_functions


def curves(count: int, seed: int = 0, noise=(0.05, 0.2)) -> tuple[np.ndarray, np.ndarray]:
    """Two outputs of one input, with different noise."""
    random = np.random.default_rng(seed)
    x = np.sort(random.uniform(-5, 5, count))[:, None]
    y = np.column_stack([np.sinc(x[:, 0] / np.pi), np.cos(x[:, 0])])
    return x, y + np.array(noise) * random.standard_normal(y.shape)


def as_data(x: np.ndarray, y: np.ndarray) -> xr.Dataset:
    return xr.Dataset(
        {"x": (("frame", "feature"), x), "y": (("frame", "output"), y)},
        {"output": [f"out{i}" for i in range(y.shape[1])]},
    )


def dense(phi, y, alpha, beta) -> float:
    """The marginal likelihood by its covariance matrices."""
    return sum(
        multivariate_normal(np.zeros(len(y)), np.eye(len(y)) / b + (phi / alpha) @ phi.T).logpdf(
            y[:, m]
        )
        for m, b in enumerate(beta)
    )


def test_the_marginal_likelihood_is_that_of_the_covariance():
    x, y = curves(12)
    phi = basis_functions(x, x[:4], 1.0)
    alpha, beta = np.array([0.1, 2.0, 3.0, 40.0, 0.7]), np.array([30.0, 5.0])
    assert log_marginal(phi, y, alpha, beta) == pytest.approx(dense(phi, y, alpha, beta))


@pytest.mark.parametrize("outputs", [1, 2])
def test_fast_maximisation_is_where_em_ends(outputs):
    x, y = curves(40)
    y = y[:, :outputs]
    phi = basis_functions(x, x, 1.5)
    found = maximise_marginal(phi, y, tolerance=1e-8)
    assert found.converged
    assert found.log_marginal == pytest.approx(
        dense(phi[:, found.kept], y, found.alpha, found.beta)
    )
    # The kept bases' precisions and the noise are a point where EM stays.
    alpha, beta, history = expectation_maximisation(
        phi[:, found.kept], y, found.alpha, found.beta, 5
    )
    np.testing.assert_allclose(alpha, found.alpha, rtol=2e-3)
    np.testing.assert_allclose(beta, found.beta, rtol=2e-3)
    assert history[-1] - history[0] < 1e-4
    # EM from nowhere in particular comes to about the same height: where one basis may
    # stand for its neighbour there are several maxima close together.
    start = np.ones(phi.shape[1]), np.full(outputs, 10.0)
    _, _, history = expectation_maximisation(phi, y, *start, 400)
    assert (np.diff(history) > -1e-7).all()
    assert abs(history[-1] - found.log_marginal) < 2.0
    assert history[-1] - history[0] > 30.0


def test_nothing_is_to_gain_anywhere():
    """Brute force: no precision of any basis, in or out, makes the outputs likelier."""
    x, y = curves(25, seed=1)
    phi = basis_functions(x, x, 1.0)
    found = maximise_marginal(phi, y, tolerance=1e-8)
    best = found.log_marginal
    full = np.full(phi.shape[1], np.inf)
    full[found.kept] = found.alpha
    for basis in range(phi.shape[1]):
        for alpha in [*np.geomspace(1e-3, 1e6, 19), np.inf]:
            tried = full.copy()
            tried[basis] = alpha
            some = np.isfinite(tried)
            if some.any():
                one = log_marginal(phi[:, some], y, tried[some], found.beta)
                assert one < best + 1e-5, (basis, alpha)


@pytest.mark.parametrize("least", [0.0, 0.1])
def test_updates_by_rank_one_are_exact(least):
    x, y = curves(30, seed=2)
    phi = basis_functions(x, x, 1.0)
    found = maximise_marginal(phi, y, least_noise=least)
    for m, beta in enumerate(found.beta):
        kept = phi[:, found.kept]
        C = np.linalg.inv(np.diag(found.alpha) + beta * kept.T @ kept)
        np.testing.assert_allclose(found.covariance[m], C, rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(found.mean[m], beta * C @ kept.T @ y[:, m], rtol=1e-6)


def test_one_output_is_the_plain_machine():
    """With one output the best precision is s^2 / (q^2 - s) (Tipping and Faul, eq. 20)."""
    x, y = curves(30, seed=3)
    y = y[:, :1]
    phi = basis_functions(x, x, 1.0)
    found = maximise_marginal(phi, y, tolerance=1e-10)
    beta = found.beta[0]
    for place, basis in enumerate(found.kept):
        others = np.delete(found.kept, place)
        C = np.eye(len(y)) / beta
        C += (phi[:, others] / np.delete(found.alpha, place)) @ phi[:, others].T
        s = phi[:, basis] @ np.linalg.solve(C, phi[:, basis])
        q = phi[:, basis] @ np.linalg.solve(C, y[:, 0])
        assert q**2 > s
        assert found.alpha[place] == pytest.approx(s**2 / (q**2 - s), rel=1e-3)


def test_outputs_that_are_copies_choose_as_one():
    """Two equal outputs: the same bases and noise as one, whose evidence they double."""
    x, y = curves(30, seed=4)
    phi = basis_functions(x, x, 1.0)
    twice = maximise_marginal(phi, np.column_stack([y[:, 0], y[:, 0]]), tolerance=1e-8)
    np.testing.assert_allclose(twice.mean[0], twice.mean[1])
    assert twice.beta[0] == pytest.approx(twice.beta[1])
    single = log_marginal(phi[:, twice.kept], y[:, :1], twice.alpha, twice.beta[:1])
    assert twice.log_marginal == pytest.approx(2 * single)


def test_few_points_are_kept_and_predictions_hold():
    x, y = curves(300, seed=5)
    phi = basis_functions(x, x, 1.5)
    found = maximise_marginal(phi, y)
    assert found.converged
    assert len(found.kept) < 0.1 * len(x)
    np.testing.assert_allclose(found.beta**-0.5, [0.05, 0.2], rtol=0.2)
    new, truth = curves(400, seed=6)
    mean, variance = found.predict(basis_functions(new, x, 1.5)[:, found.kept])
    held = np.abs(truth - mean) < 1.645 * np.sqrt(variance)
    # Four standard errors of a share of 90 %.
    assert (np.abs(held.mean(axis=0) - 0.9) < 4 * np.sqrt(0.09 / 400)).all()
    exact = np.column_stack([np.sinc(new[:, 0] / np.pi), np.cos(new[:, 0])])
    assert np.sqrt(((mean - exact) ** 2).mean(axis=0)).max() < 0.08


def test_noise_is_not_below_its_least():
    """Dense points of a rough curve: without a bound they are kept, with one they are not."""
    random = np.random.default_rng(8)
    x = np.linspace(-5, 5, 120)[:, None]
    rough = np.cumsum(random.standard_normal((120, 2)), axis=0)
    y = (rough - rough.mean(axis=0)) / rough.std(axis=0)
    phi = basis_functions(x, x, 0.15)
    free = maximise_marginal(phi, y)
    bound = maximise_marginal(phi, y, least_noise=np.array([0.1, 0.2]))
    assert bound.converged
    np.testing.assert_allclose(1.0 / bound.beta, [0.1, 0.2], rtol=1e-6)
    assert len(bound.kept) < 0.8 * len(free.kept)
    # Nothing is kept that the bound does not ask for: below the likeliest noise it is idle.
    smooth_x, smooth_y = curves(40)
    phi = basis_functions(smooth_x, smooth_x, 1.5)
    idle = maximise_marginal(phi, smooth_y, least_noise=1e-6)
    assert idle.log_marginal == maximise_marginal(phi, smooth_y).log_marginal
    with pytest.raises(InputError, match="least_noise"):
        maximise_marginal(phi, smooth_y, least_noise=-1.0)


def test_steps_are_bounded_and_constant_outputs_refused():
    x, y = curves(40)
    phi = basis_functions(x, x, 1.0)
    stopped = maximise_marginal(phi, y, max_steps=3)
    assert stopped.steps == 3
    assert not stopped.converged
    with pytest.raises(InputError, match="does not vary"):
        maximise_marginal(phi, np.column_stack([y[:, 0], np.ones(40)]))


def test_the_programs_have_the_densities_of_their_equations():
    x, y = curves(8)
    model = RelevanceVectors(1.3)
    training = model.prepare(as_data(x, y))
    (design,) = training.data
    random = np.random.default_rng(0)
    values = {
        "alpha": random.gamma(2.0, size=9),
        "beta": np.array([20.0, 5.0]),
        "weight": random.standard_normal((9, 2)),
    }
    prior = lognorm(4.0).logpdf(values["alpha"]).sum()
    prior += lognorm(2.0, scale=100.0).logpdf(values["beta"]).sum()
    whole = prior + norm(0, values["alpha"][:, None] ** -0.5).logpdf(values["weight"]).sum()
    mean = np.asarray(design.phi) @ values["weight"]
    whole += norm(mean, values["beta"] ** -0.5).logpdf(y).sum()

    def density(program):
        sites = {name: jnp.asarray(value) for name, value in values.items()}
        return float(numpyro.infer.util.log_density(program, (design,), {}, sites)[0])

    assert density(model.program) == pytest.approx(whole)
    marginal = log_marginal(np.asarray(design.phi), y, values["alpha"], values["beta"])
    assert density(model.collapsed) == pytest.approx(prior + marginal)


def test_weights_are_drawn_from_their_posterior():
    x, y = curves(6)
    phi = basis_functions(x, x[:2], 1.0)
    alpha, beta = np.array([1.0, 0.5, 2.0]), np.array([10.0, 3.0])
    design = Design(phi, y)
    model = RelevanceVectors()
    keys = jax.random.split(jax.random.PRNGKey(0), 4000)
    draw = jax.vmap(
        lambda key: model.complete_draw(key, design, {"alpha": alpha, "beta": beta})["weight"]
    )
    W = np.asarray(draw(keys))
    for m in range(2):
        C = np.linalg.inv(np.diag(alpha) + beta[m] * phi.T @ phi)
        error = np.abs(W[:, :, m].mean(axis=0) - beta[m] * C @ phi.T @ y[:, m])
        assert (error < 4 * np.sqrt(np.diag(C) / 4000)).all()
        np.testing.assert_allclose(np.cov(W[:, :, m].T), C, atol=0.1 * np.diag(C).max())


def test_draws_surround_the_estimate():
    """NUTS on small data: the curve lies within its intervals, the noise near the estimate."""
    x, y = curves(15, seed=7, noise=(0.1, 0.1))
    fit = fit_nuts(
        RelevanceVectors(1.5), as_data(x, y), warmup=150, draws=150, chains=1, seed=0,
        start="prior", max_tree_depth=6,
    )  # fmt: skip
    draws = fit.tree["posterior"].ds.isel(chain=0)
    curve = basis_functions(x, x, 1.5) @ draws["weight"].values
    exact = np.column_stack([np.sinc(x[:, 0] / np.pi), np.cos(x[:, 0])])
    z = np.abs(curve.mean(axis=0) - exact) / curve.std(axis=0)
    assert np.median(z) < 1.5
    phi = basis_functions(x, x, 1.5)
    found = maximise_marginal(phi, y)
    point, _ = found.predict(phi[:, found.kept])
    assert np.abs(curve.mean(axis=0) - point).mean() < 0.1
    assert len(fit.tree["log_likelihood"]["y"].dims) >= 3


def test_settings_and_data_that_make_no_sense_are_refused():
    with pytest.raises(InputError, match="length_scale"):
        RelevanceVectors(0.0)
    x, y = curves(5)
    with pytest.raises(InputError, match="there is no y"):
        RelevanceVectors().prepare(as_data(x, y).drop_vars("y"))
    assert not np.allclose(basis_functions(x, x, 1.0), basis_functions(x, x, 2.0))
