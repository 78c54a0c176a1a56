"""The relevance vector machine: marginal likelihood, fast maximisation, EM and NUTS."""

import json
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import pytest
import xarray as xr
from scipy.stats import lognorm, multivariate_normal, norm

from bayesmotion.errors import InputError
from bayesmotion.inference.optimisation.map import fit_map
from bayesmotion.inference.sampling.nuts import fit_nuts
from bayesmotion.model import draw_sites
from bayesmotion.models.voxel_pose.relevance_vectors import RelevanceVectors
from bayesmotion.models.voxel_pose.relevance_vectors.data import Design, basis_functions
from bayesmotion.models.voxel_pose.relevance_vectors.fast import maximise_marginal
from bayesmotion.models.voxel_pose.relevance_vectors.marginal import log_marginal, posterior

# What is eager would compile every operation by itself.
condition = jax.jit(RelevanceVectors.condition, static_argnums=0)
predict = jax.jit(RelevanceVectors.predict, static_argnums=0)
drawn_sites = jax.jit(draw_sites, static_argnums=0)


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


def expectation_maximisation(
    phi: np.ndarray,
    y: np.ndarray,
    alpha: np.ndarray,
    beta: np.ndarray,
    steps: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Climb the log marginal likelihood by EM, the weights being what is not seen.

        alpha_b = M / sum_m (mean_mb^2 + C_m,bb)
        1 / beta_m = (|y_m - Phi mean_m|^2 + tr(Phi C_m Phi^T)) / N

    Returns alpha, beta, and the log marginal likelihood before every step.
    """
    gram, products = phi.T @ phi, phi.T @ y
    history = []
    for _ in range(steps):
        history.append(log_marginal(phi, y, alpha, beta))
        found = [posterior(gram, products[:, m], alpha, one) for m, one in enumerate(beta)]
        mean = np.array([one for one, _, _ in found])
        covariance = np.array([one for _, one, _ in found])
        second = mean**2 + np.diagonal(covariance, axis1=1, axis2=2)
        alpha = y.shape[1] / second.sum(axis=0)
        residual = ((y - phi @ mean.T) ** 2).sum(axis=0)
        beta = len(y) / (residual + np.einsum("mab,ab->m", covariance, gram))
    return alpha, beta, np.array(history)


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


def holed(y: np.ndarray) -> np.ndarray:
    """The outputs with single ones missing, and one point of both."""
    y = y.copy()
    y[3, 0] = y[5:9, 1] = y[11] = np.nan
    return y


def dense_with_holes(phi, y, alpha, beta) -> float:
    total = 0.0
    for m in range(y.shape[1]):
        o = ~np.isnan(y[:, m])
        total += dense(phi[o], y[o, m : m + 1], alpha, beta[m : m + 1])
    return total


def test_missing_outputs_are_left_out_of_the_search():
    x, y = curves(40)
    y, phi = holed(y), basis_functions(x, x, 1.5)
    found = maximise_marginal(phi, y, tolerance=1e-8)
    assert found.converged
    kept = phi[:, found.kept]
    assert found.log_marginal == pytest.approx(dense_with_holes(kept, y, found.alpha, found.beta))
    for m in range(2):
        o = ~np.isnan(y[:, m])
        C = np.linalg.inv(np.diag(found.alpha) + found.beta[m] * kept[o].T @ kept[o])
        np.testing.assert_allclose(found.covariance[m], C, rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(
            found.mean[m], found.beta[m] * C @ kept[o].T @ y[o, m], rtol=1e-6
        )
    full = np.full(phi.shape[1], np.inf)
    full[found.kept] = found.alpha
    for basis in range(0, phi.shape[1], 3):
        for alpha in [*np.geomspace(1e-3, 1e6, 10), np.inf]:
            tried = full.copy()
            tried[basis] = alpha
            some = np.isfinite(tried)
            if some.any():
                one = log_marginal(phi[:, some], y, tried[some], found.beta)
                assert one < found.log_marginal + 1e-5
    # A point missing in all outputs is as good as not there.
    rest = np.arange(40) != 11
    again = maximise_marginal(phi[rest], y[rest], tolerance=1e-8)
    assert again.log_marginal == pytest.approx(found.log_marginal)


def test_the_fast_estimate_is_the_programs_optimum_where_priors_are_flat():
    """The collapsed program's likelihood has no slope there, and only its priors pull."""
    x, y = curves(40)
    model = RelevanceVectors(1.5)
    data = model.prepare(as_data(x, holed(y)))
    found = model.fast_marginal(data, seed=0, max_steps=2000, tolerance=1e-9)
    assert found.converged

    @jax.jit
    def likelihood(real):
        sites = {name: jnp.exp(value) for name, value in real.items()}
        trace = numpyro.handlers.trace(numpyro.handlers.substitute(model.collapsed, data=sites))
        site = trace.get_trace(data.design)["y"]
        return site["fn"].log_prob(site["value"])

    real = {name: jnp.log(found.values[name]) for name in ("alpha", "noise")}
    assert float(likelihood(real)) == pytest.approx(found.log_density, abs=1e-4)
    slopes = jax.jit(jax.grad(likelihood))
    slope = slopes(real)
    assert max(float(jnp.abs(part).max()) for part in slope.values()) < 5e-3
    # The control: elsewhere there is one.
    other = slopes({**real, "noise": real["noise"] + 0.5})
    assert float(jnp.abs(other["noise"]).max()) > 1.0
    # The machine that is conditioned on the estimate predicts as the search does.
    direct = maximise_marginal(
        np.asarray(data.design.phi), np.asarray(data.design.y), tolerance=1e-9
    )
    new = model.prepare(
        xr.Dataset({"x": (("frame", "feature"), x[:6] + 0.1)}, {"frame": range(6)}), data
    )
    trained = condition(model, data.design, found.values)
    predicted = predict(model, trained, new.design, {})["y"]
    mean, variance = direct.predict(np.asarray(new.design.phi)[:, direct.kept])
    np.testing.assert_allclose(predicted.mean, mean, atol=1e-5)
    np.testing.assert_allclose(predicted.variance, variance, rtol=1e-4)


def random_values(basis: int) -> dict[str, np.ndarray]:
    random = np.random.default_rng(3)
    return {
        "alpha": random.gamma(2.0, size=basis),
        "noise": np.array([0.05, 0.2]),
        "weight": random.standard_normal((basis, 2)),
    }


def test_new_outputs_are_predicted_from_the_joint_gaussian():
    """Training outputs and those seen of new points, against dense covariance matrices."""
    x, y = curves(14)
    model = RelevanceVectors(1.3)
    data = model.prepare(as_data(x, holed(y)))
    new_x, new_y = curves(5, seed=9)
    new_y[0], new_y[3, 1] = np.nan, np.nan
    new = model.prepare(as_data(new_x, new_y), data)
    np.testing.assert_allclose(new.design.y, (new_y - data.scaling.location) / data.scaling.scale)
    values = random_values(15)
    trained = condition(model, data.design, values)
    found = jax.tree.map(np.asarray, predict(model, trained, new.design, {})["y"])
    phi = np.concatenate([data.design.phi, new.design.phi])
    every = np.concatenate([data.design.y, new.design.y])
    density = 0.0
    for m in range(2):
        signal = (phi / values["alpha"]) @ phi.T
        o = np.flatnonzero(~np.isnan(every[:, m]))
        K = signal + values["noise"][m] * np.eye(19)
        gain = np.linalg.solve(K[np.ix_(o, o)], signal[o, 14:]).T
        np.testing.assert_allclose(found.mean[:, m], gain @ every[o, m], rtol=1e-6)
        left = signal[14:, 14:] - gain @ signal[o, 14:]
        np.testing.assert_allclose(
            found.variance[:, m], np.diag(left) + values["noise"][m], rtol=1e-6
        )
        old = o[o < 14]
        density += multivariate_normal(np.zeros(len(o)), K[np.ix_(o, o)]).logpdf(every[o, m])
        density -= multivariate_normal(np.zeros(len(old)), K[np.ix_(old, old)]).logpdf(
            every[old, m]
        )

    @jax.jit
    def log_probs(trained):
        sites = numpyro.handlers.trace(model.program).get_trace(new.design, trained)
        return {name: site["fn"].log_prob(site["value"]) for name, site in sites.items()}

    assert list(log_probs(trained)) == ["y"]
    assert float(log_probs(trained)["y"]) == pytest.approx(density)
    keys = jax.random.split(jax.random.PRNGKey(0), 4000)
    draws = np.asarray(jax.jit(jax.vmap(found.sample))(keys))
    off = (draws.mean(axis=0) - found.mean) / np.sqrt(found.variance)
    assert np.abs(off).max() < 4.5 / np.sqrt(4000)
    np.testing.assert_allclose(draws.var(axis=0), found.variance, rtol=0.12)


def test_points_left_out_are_those_of_the_joint_gaussian():
    x, y = curves(13)
    model = RelevanceVectors(1.3)
    data = model.prepare(as_data(x, holed(y)))
    values = random_values(14)
    phi, z = np.asarray(data.design.phi), np.asarray(data.design.y)
    beta = 1 / values["noise"]
    found = np.asarray(jax.jit(model.pointwise)(data.design, values))
    whole = dense_with_holes(phi, z, values["alpha"], beta)
    for n in range(13):
        rest = np.arange(13) != n
        without = dense_with_holes(phi[rest], z[rest], values["alpha"], beta)
        assert float(found[n]) == pytest.approx(whole - without, abs=1e-8)
    assert float(found[11]) == 0.0
    identified = jax.jit(model.identified)(data.design, values)
    assert float(identified["log_likelihood"]) == pytest.approx(whole)
    for name, value in identified.items():
        coords = model.coords(data)
        assert np.shape(value) == tuple(len(coords[dim]) for dim in model.dims()[name])
    for m in range(2):
        o = ~np.isnan(z[:, m])
        C = np.linalg.inv(np.diag(values["alpha"]) + beta[m] * phi[o].T @ phi[o])
        count = 14 - np.diag(C) @ values["alpha"]
        assert float(identified["effective_vectors"][m]) == pytest.approx(count)


def test_priors_give_outputs_and_every_setting_counts():
    x, y = curves(8)
    drawn = []
    for model in (RelevanceVectors(1.0), RelevanceVectors(2.0), RelevanceVectors(1.0, 0.3)):
        values = drawn_sites(model, jax.random.PRNGKey(1), model.prepare(as_data(x, y)).design)
        assert np.isfinite(np.asarray(values["y"])).all()
        drawn.append(values["y"])
    assert not np.allclose(drawn[0], drawn[1])
    assert not np.allclose(drawn[0], drawn[2])


def test_the_example_is_fitted():
    model, recordings = RelevanceVectors.example()
    assert np.isnan(recordings["y"].values).any()
    data = model.prepare(recordings)
    assert model.fast_marginal(data, seed=0, max_steps=1000, tolerance=1e-3).converged
    fit = fit_map(model, recordings, seed=0)
    assert json.loads(fit.tree.attrs["warnings"]) == []


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
    scaled = (y - y.mean(axis=0)) / y.std(axis=0)
    np.testing.assert_allclose(design.y, scaled)
    random = np.random.default_rng(0)
    values = {
        "alpha": random.gamma(2.0, size=9),
        "noise": np.array([0.05, 0.2]),
        "weight": random.standard_normal((9, 2)),
    }
    prior = lognorm(4.0).logpdf(values["alpha"]).sum()
    prior += lognorm(2.0, scale=0.01).logpdf(values["noise"]).sum()
    whole = prior + norm(0, values["alpha"][:, None] ** -0.5).logpdf(values["weight"]).sum()
    mean = np.asarray(design.phi) @ values["weight"]
    whole += norm(mean, values["noise"] ** 0.5).logpdf(scaled).sum()

    def density(program):
        log_density = partial(numpyro.infer.util.log_density, program)
        return float(jax.jit(lambda values: log_density((design,), {}, values)[0])(values))

    assert density(model.program) == pytest.approx(whole)
    phi = np.asarray(design.phi)
    marginal = log_marginal(phi, scaled, values["alpha"], 1 / values["noise"])
    assert density(model.collapsed) == pytest.approx(prior + marginal)
    # With a least noise the prior is cut off below it.
    bound = RelevanceVectors(1.3, least_noise=0.02)
    cut = lognorm(2.0, scale=0.01)
    more = -2 * np.log(cut.sf(0.02))
    assert density(bound.collapsed) == pytest.approx(prior + marginal + more)


def test_weights_are_drawn_from_their_posterior():
    x, y = curves(6)
    phi = basis_functions(x, x[:2], 1.0)
    alpha, noise = np.array([1.0, 0.5, 2.0]), np.array([0.1, 1 / 3])
    y[2, 1] = np.nan
    design = Design(phi, y)
    model = RelevanceVectors()
    keys = jax.random.split(jax.random.PRNGKey(0), 4000)
    draw = jax.vmap(
        lambda key: model.complete_draw(key, design, {"alpha": alpha, "noise": noise})["weight"]
    )
    W = np.asarray(jax.jit(draw)(keys))
    for m in range(2):
        o = ~np.isnan(y[:, m])
        C = np.linalg.inv(np.diag(alpha) + phi[o].T @ phi[o] / noise[m])
        error = np.abs(W[:, :, m].mean(axis=0) - C @ phi[o].T @ y[o, m] / noise[m])
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
    curve = y.mean(axis=0) + y.std(axis=0) * (basis_functions(x, x, 1.5) @ draws["weight"].values)
    exact = np.column_stack([np.sinc(x[:, 0] / np.pi), np.cos(x[:, 0])])
    z = np.abs(curve.mean(axis=0) - exact) / curve.std(axis=0)
    assert np.median(z) < 1.5
    phi = basis_functions(x, x, 1.5)
    found = maximise_marginal(phi, (y - y.mean(axis=0)) / y.std(axis=0))
    point = y.mean(axis=0) + y.std(axis=0) * found.predict(phi[:, found.kept])[0]
    assert np.abs(curve.mean(axis=0) - point).mean() < 0.1


def test_settings_and_data_that_make_no_sense_are_refused():
    with pytest.raises(InputError, match="length_scale"):
        RelevanceVectors(0.0)
    x, y = curves(5)
    with pytest.raises(InputError, match="there is no y"):
        RelevanceVectors().prepare(as_data(x, y).drop_vars("y"))
    with pytest.raises(InputError, match="least_noise"):
        RelevanceVectors(least_noise=-0.1)
    with pytest.raises(InputError, match="does not vary"):
        RelevanceVectors().prepare(as_data(x, np.ones((5, 1))))
    with pytest.raises(InputError, match="an input is missing"):
        RelevanceVectors().prepare(as_data(np.where(x > 0, x, np.nan), y))
    model = RelevanceVectors()
    trained = model.prepare(as_data(x, y))
    with pytest.raises(InputError, match="lacks out1"):
        model.prepare(as_data(x, y[:, :1]), trained)
    with pytest.raises(InputError, match="2 features"):
        model.prepare(as_data(np.hstack([x, x]), y), trained)
