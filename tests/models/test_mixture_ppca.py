"""The mixture of PPCA against closed forms, its program, EM and NUTS against each other."""

import jax.numpy as jnp
import numpy as np
import numpyro
import pytest
import xarray as xr
from scipy.stats import multivariate_normal

from bayesmotion.errors import InputError
from bayesmotion.fit import load
from bayesmotion.inference.density import ProgramDensity
from bayesmotion.inference.nuts import fit_nuts
from bayesmotion.models.mixture_em import Mixture, fit_mixture
from bayesmotion.models.mixture_ppca import MixturePPCA

D, Q = 5, 2


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


def test_densities_are_those_of_normal_distributions():
    t, mixture = drawn(0, 3, 20)
    joint = np.stack(
        [
            np.log(mixture.weight[k])
            + multivariate_normal(mixture.mean[k], mixture.covariance(k)).logpdf(t)
            for k in range(3)
        ],
        axis=1,
    )
    np.testing.assert_allclose(mixture.log_joint(t), joint, rtol=1e-9)
    np.testing.assert_allclose(mixture.log_density(t), np.log(np.exp(joint).sum(axis=1)))
    share = np.exp(joint) / np.exp(joint).sum(axis=1, keepdims=True)
    np.testing.assert_allclose(mixture.responsibilities(t), share, atol=1e-9)
    single = mixture.log_joint(t.astype(np.float32))
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, joint, rtol=1e-3, atol=1e-2)


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
    np.testing.assert_allclose(found.mixture.covariance(0), C, rtol=1e-10, atol=1e-10)
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
    assert found.log_likelihood[-1] == pytest.approx(found.mixture.log_density(t).sum())


def test_a_mixture_is_recovered():
    t, truth = drawn(3, 3, 6000)
    # EM climbs to the nearest maximum: of some starts the best is taken.
    tried = [fit_mixture(t, 3, Q, seed=seed) for seed in range(4)]
    found = max(tried, key=lambda one: one.log_likelihood[-1]).mixture
    order = [int(np.abs(found.mean - mean).sum(axis=1).argmin()) for mean in truth.mean]
    assert sorted(order) == [0, 1, 2]
    for k, own in enumerate(order):
        n = truth.weight[k] * len(t)
        size = np.sqrt(np.diag(truth.covariance(k)))
        # Four standard errors of a mean, of a share, and of entries of a covariance.
        assert (np.abs(found.mean[own] - truth.mean[k]) < 4 * size / np.sqrt(n)).all()
        assert abs(found.weight[own] - truth.weight[k]) < 4 * np.sqrt(0.25 / len(t))
        off = np.abs(found.covariance(own) - truth.covariance(k)) / np.outer(size, size)
        assert off.max() < 4 * np.sqrt(2 / n)


def test_batches_and_single_precision_change_nothing(monkeypatch):
    t, _ = drawn(4, 3, 500)
    one = fit_mixture(t, 3, Q, seed=0, max_steps=5)
    monkeypatch.setattr("bayesmotion.models.clusters.BATCH", 64)
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
    assert np.isfinite(found.log_density(np.column_stack([t, np.zeros((300, 4))]))).all()
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
    found, _ = numpyro.infer.util.log_density(
        model.program, training.data, {}, {n: jnp.asarray(v) for n, v in values.items()}
    )
    s = np.sqrt(np.mean((t - t.mean(axis=0)) ** 2))

    def normal(x, loc, scale):
        return (-0.5 * ((x - loc) / scale) ** 2 - np.log(scale) - 0.5 * np.log(2 * np.pi)).sum()

    prior = normal(mixture.mean, t.mean(axis=0), 2 * s) + normal(mixture.factor, 0.0, s)
    log_noise = np.log(mixture.noise)
    prior += normal(log_noise, np.log(s**2 / 10), 1.5) - log_noise.sum()
    assert float(found) == pytest.approx(prior + mixture.log_density(t).sum())


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
    size = np.sqrt(np.diag(point.covariance(0)))
    off = (C.mean(axis=0) - point.covariance(0)) / np.outer(size, size)
    assert np.abs(off).max() < 3 * np.sqrt(2 / len(t))
    spread = (C / np.outer(size, size)).std(axis=0)
    assert (0.3 * np.sqrt(2 / len(t)) < np.diag(spread)).all()
    fit.save(tmp_path / "fit.nc")
    again = load(tmp_path / "fit.nc")
    assert again.model == fit.model
    density = ProgramDensity(again.model)
    last = again.values(draw=-1)
    lp = density(density.real(last, again.training.data), again.training.data)
    likelihood = fit.tree["log_likelihood"]["t"].isel(chain=0, draw=-1).sum()
    prior = sum(v.isel(chain=0, draw=-1) for v in fit.tree["log_prior"].ds.values())
    assert float(lp) == pytest.approx(float(likelihood + prior))
