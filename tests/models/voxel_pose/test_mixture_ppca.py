"""The mixture of PPCA against closed forms, its program, EM and NUTS against each other."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import pytest
import scipy.optimize
import xarray as xr
from jax.flatten_util import ravel_pytree
from scipy.stats import multivariate_normal

from bayesmotion.errors import InputError
from bayesmotion.fit import load
from bayesmotion.inference.density import ProgramDensity, natural_values, real_values
from bayesmotion.inference.optimisation.map import fit_map
from bayesmotion.inference.sampling.nuts import fit_nuts
from bayesmotion.model import draw_sites
from bayesmotion.models.voxel_pose.mixture_ppca import MixturePPCA, em
from bayesmotion.models.voxel_pose.mixture_ppca.density import (
    Mixture,
    PPCAPredictive,
    latent,
    responsibilities,
)
from bayesmotion.models.voxel_pose.mixture_ppca.em import (
    fit_mixture,
    log_density,
    log_joint,
)
from bayesmotion.models.voxel_pose.mixture_ppca.em import (
    responsibilities as responsibilities_in_numpy,
)

D, Q = 5, 2

# What is eager would compile every operation by itself.
covariances = jax.jit(Mixture.covariances)
share_of = jax.jit(responsibilities)
latent_of = jax.jit(latent)
predicted_from = jax.jit(PPCAPredictive.of)
identified = jax.jit(MixturePPCA.identified, static_argnums=0)
density_at = jax.jit(ProgramDensity.__call__, static_argnums=0)
drawn_sites = jax.jit(draw_sites, static_argnums=0)


def drawn(seed: int, components: int, count: int) -> tuple[np.ndarray, Mixture]:
    """Points of a random mixture, and the mixture."""
    random = np.random.default_rng(seed)
    weight = random.dirichlet(5.0 * np.ones(components))
    mean = 4.0 * random.standard_normal((components, D))
    factor = random.standard_normal((components, D, Q))
    noise = random.uniform(0.02, 0.2, components)
    k = random.choice(components, size=count, p=weight)
    t = mean[k] + np.einsum("ndq,nq->nd", factor[k], random.standard_normal((count, Q)))
    t += np.sqrt(noise[k])[:, None] * random.standard_normal((count, D))
    return t, Mixture(weight, mean, factor, noise)


def as_data(t: np.ndarray) -> xr.Dataset:
    return xr.Dataset({"t": (("point", "bin"), t)}, {"bin": [f"bin{i}" for i in range(t.shape[1])]})


def covariance(mixture: Mixture, k: int) -> np.ndarray:
    return np.asarray(covariances(mixture))[k]


def holed(t: np.ndarray, share: float = 0.3) -> np.ndarray:
    """The points with some entries missing, all of the last one."""
    t = np.where(np.random.default_rng(9).random(t.shape) < share, np.nan, t)
    t[-1] = np.nan
    return t


def by_hand(t: np.ndarray, mixture: Mixture) -> np.ndarray:
    """Log joint densities by scipy, each point's missing entries left out of its normals."""
    joint = np.tile(np.log(mixture.weight), (len(t), 1))
    whole = np.asarray(covariances(mixture))
    for n, point in enumerate(t):
        o = ~np.isnan(point)
        if o.any():
            for k in range(len(mixture.weight)):
                C = whole[k][np.ix_(o, o)]
                joint[n, k] += multivariate_normal(mixture.mean[k, o], C).logpdf(point[o])
    return joint


def test_densities_are_those_of_normal_distributions():
    t, mixture = drawn(0, 3, 20)
    joint = by_hand(t, mixture)
    np.testing.assert_allclose(log_joint(mixture, t), joint, rtol=1e-9)
    np.testing.assert_allclose(log_density(mixture, t), np.log(np.exp(joint).sum(axis=1)))
    share = np.exp(joint) / np.exp(joint).sum(axis=1, keepdims=True)
    np.testing.assert_allclose(responsibilities_in_numpy(mixture, t), share, atol=1e-9)
    np.testing.assert_allclose(share_of(mixture, t), share, atol=1e-9)
    single = log_joint(mixture, t.astype(np.float32))
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, joint, rtol=1e-3, atol=1e-2)


def test_missing_entries_are_integrated_out():
    t, mixture = drawn(0, 3, 20)
    t = holed(t)
    joint = by_hand(t, mixture)
    np.testing.assert_allclose(log_joint(mixture, t), joint, rtol=1e-9)
    np.testing.assert_allclose(latent_of(mixture, t).log_joint, joint, rtol=1e-7)
    assert float(log_density(mixture, t)[-1]) == pytest.approx(0.0, abs=1e-12)
    # The control: a point that is wrong where it is missing would be noticed.
    t[0] = 0.0
    assert not np.allclose(log_joint(mixture, t)[0], joint[0])


def test_predictions_are_conditional_normals():
    """Every entry given the seen ones, component by component, from the joint (t, replicate)."""
    t, mixture = drawn(1, 3, 8)
    t = holed(t)
    predicted = predicted_from(mixture, t)
    joint = by_hand(t, mixture)
    share = np.exp(joint - np.logaddexp.reduce(joint, axis=1)[:, None])
    for n, point in enumerate(t):
        o = ~np.isnan(point)
        means, variances = [], []
        for k in range(3):
            W, noise = mixture.factor[k], mixture.noise[k]
            whole = W @ W.T
            C = whole[np.ix_(o, o)] + noise * np.eye(o.sum())
            gain = np.linalg.solve(C, whole[o]).T if o.any() else np.zeros((D, 0))
            means.append(mixture.mean[k] + gain @ (point[o] - mixture.mean[k, o]))
            variances.append(np.diag(whole - gain @ whole[o]) + noise)
        mean = share[n] @ np.array(means)
        second = share[n] @ (np.array(variances) + np.array(means) ** 2)
        np.testing.assert_allclose(predicted.mean[n], mean, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(predicted.variance[n], second - mean**2, rtol=1e-5)
    keys = jax.random.split(jax.random.PRNGKey(0), 4000)
    drawn_entries = np.asarray(jax.jit(jax.vmap(predicted.sample))(keys))
    sd = np.sqrt(predicted.variance)
    off = (drawn_entries.mean(axis=0) - predicted.mean) / sd
    assert np.abs(off).max() < 4.5 / np.sqrt(4000)
    entries = jax.tree.map(np.asarray, jax.jit(jax.vmap(predicted.marginals))(keys))
    off = (np.asarray(entries.mean).mean(axis=0) - predicted.mean) / sd
    assert np.abs(off).max() < 4.5 / np.sqrt(4000)
    second = np.asarray(entries.variance + entries.mean**2).mean(axis=0)
    whole = np.asarray(predicted.variance + predicted.mean**2)
    np.testing.assert_allclose(second, whole, rtol=0.15)


def test_one_component_is_ppca():
    """Closed form of Tipping and Bishop: eigenvectors of the covariance of the points."""
    t, _ = drawn(1, 1, 400)
    found = fit_mixture(t, 1, Q, seed=0)
    S = np.cov(t.T, bias=True)
    values, vectors = np.linalg.eigh(S)
    noise = values[: D - Q].mean()
    C = S.copy()
    for value, vector in zip(values[: D - Q], vectors[:, : D - Q].T, strict=True):
        C += (noise - value) * np.outer(vector, vector)
    assert found.converged
    np.testing.assert_allclose(covariance(found.mixture, 0), C, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(found.mixture.mean[0], t.mean(axis=0))
    best = (
        -0.5
        * len(t)
        * (D * np.log(2 * np.pi) + np.log(values[D - Q :]).sum() + (D - Q) * np.log(noise) + D)
    )
    assert found.log_likelihood[-1] == pytest.approx(best)


def test_every_step_makes_the_points_likelier():
    t, _ = drawn(2, 4, 600)
    found = fit_mixture(t, 4, Q, seed=5, tolerance=1e-9, max_steps=300)
    gains = np.diff(found.log_likelihood)
    assert len(gains) > 3
    assert gains.min() > -1e-8 * abs(found.log_likelihood[0])
    assert found.converged
    assert found.log_likelihood[-1] == pytest.approx(log_density(found.mixture, t).sum())


def test_em_climbs_with_missing_entries_and_fills_them_as_it_should():
    t, truth = drawn(3, 2, 3000)
    found = fit_mixture(holed(t, 0.15), 2, Q, seed=0, tolerance=1e-9, max_steps=60)
    assert np.diff(found.log_likelihood).min() > -1e-8 * abs(found.log_likelihood[0])
    order = [int(np.abs(found.mixture.mean - mean).sum(axis=1).argmin()) for mean in truth.mean]
    assert sorted(order) == [0, 1]
    for k, own in enumerate(order):
        n = 0.8 * truth.weight[k] * len(t)
        size = np.sqrt(np.diag(covariance(truth, k)))
        off = np.abs(covariance(found.mixture, own) - covariance(truth, k)) / np.outer(size, size)
        assert off.max() < 4 * np.sqrt(2 / n)


def test_em_is_the_programs_optimum_when_points_are_many():
    """Climbing the program's density from where EM ends moves what is identified hardly."""
    t, _ = drawn(8, 2, 4000)
    t = holed(t, 0.05)
    model = MixturePPCA(2, Q)
    data = model.prepare(as_data(t))
    found = model.em(data, seed=0, max_steps=200, tolerance=1e-10)
    assert found.converged
    assert found.log_density == pytest.approx(log_density(Mixture(**found.values), t).sum())
    density = ProgramDensity(model)
    start = real_values(density, found.values, data.data)
    flat, back = ravel_pytree(start)
    climb = jax.jit(jax.value_and_grad(lambda u: -density(back(u), data.data) / len(t)))

    def at(u):
        value, slope = climb(u)
        return float(value), np.asarray(slope)

    end = scipy.optimize.minimize(at, flat, jac=True, method="L-BFGS-B", options={"maxiter": 60})
    natural = natural_values(density, back(jnp.asarray(end.x)), data.data)
    one, other = (identified(model, data.points, v) for v in (found.values, natural))
    gained = float(other["log_likelihood"] - one["log_likelihood"])
    assert -3.0 < gained < 1e-3
    for name in ("overall_mean", "overall_covariance", "sorted_weight", "sorted_noise"):
        np.testing.assert_allclose(other[name], one[name], rtol=0.01, atol=0.02, err_msg=name)
    # The control: of few points the priors have a say.
    few = model.prepare(as_data(t[:12]))
    found = model.em(few, seed=0, max_steps=200, tolerance=1e-10)
    at_few = real_values(density, found.values, few.data)
    slope, _ = ravel_pytree(jax.jit(jax.grad(density))(at_few, few.data))
    assert np.abs(slope).max() / 12 > 10 * np.abs(at(flat)[1]).max()


def test_what_is_identified_knows_no_order_and_no_rotation():
    t, mixture = drawn(6, 2, 30)
    model = MixturePPCA(2, Q)
    data = model.prepare(as_data(holed(t)))
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    other = Mixture(*(np.asarray(part)[::-1] for part in mixture))
    other = other._replace(factor=other.factor @ turn)
    one, same = (identified(model, data.points, m._asdict()) for m in (mixture, other))
    for name, value in one.items():
        np.testing.assert_allclose(same[name], value, rtol=1e-7, err_msg=name)
        dims, coords = model.dims()[name], model.coords(data)
        assert np.shape(value) == tuple(len(coords[dim]) for dim in dims)
    moved = mixture._replace(mean=mixture.mean + 0.1)
    changed = identified(model, data.points, moved._asdict())
    assert not np.allclose(changed["overall_mean"], one["overall_mean"])
    found = jax.jit(model.pointwise)(data.points, mixture._asdict())
    expected = log_density(mixture, np.asarray(data.points.t))
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-8)


def test_new_points_are_predicted_from_what_is_seen_of_them():
    t, mixture = drawn(6, 2, 30)
    model = MixturePPCA(2, Q)
    training = model.prepare(as_data(t))
    new = as_data(holed(t[:6]))
    data = model.prepare(new, training)
    np.testing.assert_array_equal(data.points.location, training.points.location)
    trained = jax.jit(model.condition)(training.points, mixture._asdict())
    predicted = jax.jit(model.predict)(trained, data.points, {})["t"]
    assert np.isfinite(np.asarray(predicted.mean)).all()

    @jax.jit
    def log_probs(trained):
        sites = numpyro.handlers.trace(model.program).get_trace(data.points, trained)
        return {n: s["fn"].log_prob(s["value"]) for n, s in sites.items() if s["type"] == "sample"}

    assert list(log_probs(trained)) == ["t"]
    total = float(log_probs(trained)["t"].sum())
    assert total == pytest.approx(log_density(mixture, np.asarray(data.points.t)).sum())
    with pytest.raises(InputError, match="bins are not those"):
        model.prepare(new.assign_coords(bin=list("vwxyz")), training)


def test_priors_give_points_and_every_setting_counts():
    t, _ = drawn(6, 2, 30)
    drawn_points = []
    for model in (MixturePPCA(2, 1), MixturePPCA(3, 1), MixturePPCA(2, 2)):
        data = model.prepare(as_data(t))
        drawn_points.append(drawn_sites(model, jax.random.PRNGKey(0), data.points)["t"])
        assert np.isfinite(np.asarray(drawn_points[-1])).all()
    assert not np.allclose(drawn_points[0], drawn_points[1])
    assert not np.allclose(drawn_points[0], drawn_points[2])


def test_the_example_is_fitted():
    model, recordings = MixturePPCA.example()
    assert np.isnan(recordings["t"].values).any()
    data = model.prepare(recordings)
    assert model.em(data, seed=0, max_steps=100, tolerance=1e-6).converged
    fit = fit_map(model, recordings, seed=0)
    assert json.loads(fit.tree.attrs["warnings"]) == []


def test_a_mixture_is_recovered():
    t, truth = drawn(3, 3, 6000)
    # EM climbs to the nearest maximum: of some starts the best is taken.
    tried = [fit_mixture(t, 3, Q, seed=seed) for seed in range(4)]
    found = max(tried, key=lambda one: one.log_likelihood[-1]).mixture
    order = [int(np.abs(found.mean - mean).sum(axis=1).argmin()) for mean in truth.mean]
    assert sorted(order) == [0, 1, 2]
    for k, own in enumerate(order):
        n = truth.weight[k] * len(t)
        size = np.sqrt(np.diag(covariance(truth, k)))
        # Four standard errors of a mean, of a share, and of entries of a covariance.
        assert (np.abs(found.mean[own] - truth.mean[k]) < 4 * size / np.sqrt(n)).all()
        assert abs(found.weight[own] - truth.weight[k]) < 4 * np.sqrt(0.25 / len(t))
        off = np.abs(covariance(found, own) - covariance(truth, k)) / np.outer(size, size)
        assert off.max() < 4 * np.sqrt(2 / n)


def test_batches_and_single_precision_change_nothing(monkeypatch):
    t, _ = drawn(4, 3, 500)
    one = fit_mixture(t, 3, Q, seed=0, max_steps=5)
    monkeypatch.setattr(em, "BATCH", 64)
    other = fit_mixture(t, 3, Q, seed=0, max_steps=5)
    np.testing.assert_allclose(one.log_likelihood, other.log_likelihood, rtol=1e-10)
    single = fit_mixture(t.astype(np.float32), 3, Q, seed=0, max_steps=5)
    assert single.log_likelihood[-1] == pytest.approx(one.log_likelihood[-1], rel=1e-4)


def test_a_run_goes_on_where_another_stopped():
    # Three components where there is one: EM is slow, and no step stands still.
    t, _ = drawn(4, 1, 400)
    whole = fit_mixture(t, 3, Q, seed=0, max_steps=6, tolerance=0.0)
    part = fit_mixture(t, 3, Q, seed=0, max_steps=2, tolerance=0.0)
    rest = fit_mixture(t, 3, Q, seed=0, max_steps=4, tolerance=0.0, start=part.mixture)
    assert len(whole.log_likelihood) == 7
    np.testing.assert_allclose(rest.log_likelihood, whole.log_likelihood[2:], rtol=1e-12)


def test_constant_dimensions_do_no_harm():
    t, _ = drawn(5, 2, 300)
    found = fit_mixture(np.column_stack([t, np.zeros((300, 4))]), 2, Q, seed=0).mixture
    assert np.isfinite(log_density(found, np.column_stack([t, np.zeros((300, 4))]))).all()
    assert (found.noise > 0).all()


def test_what_makes_no_sense_is_refused():
    t, _ = drawn(0, 1, 10)
    with pytest.raises(InputError, match="latent dimensions"):
        fit_mixture(t, 1, D, seed=0)
    with pytest.raises(InputError, match="latent dimensions"):
        MixturePPCA(1, D).prepare(as_data(t))
    with pytest.raises(InputError, match="no t"):
        MixturePPCA(1, 1).prepare(xr.Dataset({"y": ("point", t[:, 0])}))
    with pytest.raises(InputError, match="at least 1"):
        MixturePPCA(0, 1)


def test_the_program_has_the_density_of_its_equations():
    t, mixture = drawn(6, 2, 15)
    model = MixturePPCA(2, Q)
    training = model.prepare(as_data(t))
    values = {
        "weight": mixture.weight, "mean": mixture.mean, "factor": mixture.factor,
        "noise": mixture.noise,
    }  # fmt: skip
    found = jax.jit(
        lambda data, values: numpyro.infer.util.log_density(model.program, data, {}, values)[0]
    )(training.data, values)
    s = np.sqrt(np.mean((t - t.mean(axis=0)) ** 2))

    def normal(x, loc, scale):
        return (-0.5 * ((x - loc) / scale) ** 2 - np.log(scale) - 0.5 * np.log(2 * np.pi)).sum()

    prior = normal(mixture.mean, t.mean(axis=0), 2 * s) + normal(mixture.factor, 0.0, s)
    log_noise = np.log(mixture.noise)
    prior += normal(log_noise, np.log(s**2 / 10), 1.5) - log_noise.sum()
    assert float(found) == pytest.approx(prior + log_density(mixture, t).sum())


def test_draws_of_one_component_are_those_of_ppca(tmp_path):
    """NUTS on small data: covariances, which a rotation of W does not change."""
    t, _ = drawn(7, 1, 60)
    t = t[:, :3]
    fit = fit_nuts(
        MixturePPCA(1, 1), as_data(t), warmup=80, draws=80, chains=1, seed=1, start="prior",
        max_tree_depth=5,
    )  # fmt: skip
    draws = fit.tree["posterior"].ds.isel(chain=0)
    W, noise = draws["factor"].values[:, 0], draws["noise"].values[:, 0]
    C = W @ W.swapaxes(1, 2) + noise[:, None, None] * np.eye(3)
    point = fit_mixture(t, 1, 1, seed=0).mixture
    size = np.sqrt(np.diag(covariance(point, 0)))
    off = (C.mean(axis=0) - covariance(point, 0)) / np.outer(size, size)
    assert np.abs(off).max() < 3 * np.sqrt(2 / len(t))
    spread = (C / np.outer(size, size)).std(axis=0)
    assert (0.3 * np.sqrt(2 / len(t)) < np.diag(spread)).all()
    fit.save(tmp_path / "fit.nc")
    again = load(tmp_path / "fit.nc")
    assert again.model == fit.model
    density = ProgramDensity(again.model)
    last = again.values(draw=-1)
    data = again.training.data
    lp = density_at(density, real_values(density, last, data), data)
    likelihood = fit.tree["joint_log_likelihood"]["t"].isel(chain=0, draw=-1).sum()
    prior = sum(v.isel(chain=0, draw=-1) for v in fit.tree["log_prior"].ds.values())
    assert float(lp) == pytest.approx(float(likelihood + prior))
