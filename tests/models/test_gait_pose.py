"""Gait-pose models: the density by hand, fits that come back, a fast process that is exact."""

import arviz as az
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import lognorm, multivariate_normal, norm

from bayesmotion.errors import InputError, MotionWarning
from bayesmotion.fit import load
from bayesmotion.inference.density import ProgramDensity
from bayesmotion.inference.map import fit_map
from bayesmotion.inference.nuts import fit_nuts
from bayesmotion.model import Model, build_model, describe_model
from bayesmotion.models.gait_pose import ALPHA_MEDIAN, LAYERS, VARIANTS, GaitPose
from bayesmotion.motion import split
from bayesmotion.motion.cycles import cycles_of, joint_positions
from bayesmotion.motion.synthetic import synthetic_walkers
from bayesmotion.priors.dynamics import GPDynamics, unit_scale
from bayesmotion.priors.topology import log_normaliser


@pytest.fixture(scope="module")
def cycles():
    walks = synthetic_walkers(("ann", "ben", "cas", "dee"), ("walk",), seconds=2.6, styles=2)
    return cycles_of(walks, 1, poses=8)


def on_surface(surface, values):
    rows = []
    for s, g, p in surface.index():
        a = 2 * np.pi * (p + values["phase"][s * surface.gaits + g]) / surface.poses
        r, b = values["radius"][s], 2 * np.pi * values["gait"][g] / surface.gaits
        out = surface.major + r * np.cos(a)
        torus = [out * np.cos(b), out * np.sin(b), r * np.sin(a)]
        along = 0.5 * (values["gait"][g] - 0.5 * (surface.gaits - 1))
        rows.append(torus if surface.kind == "torus" else [r * np.cos(a), along, r * np.sin(a)])
    return np.array(rows)


# Of every kind of prior one; the others are put together of the same parts.
TRIED = ("gplvm", "ll_gpdm", "torus3", "on_cylinder3")


@pytest.mark.parametrize("name", TRIED)
def test_the_density_is_that_written_out_by_hand(cycles, name):
    model = VARIANTS[name]
    training = model.prepare(cycles, scales=LAYERS[name])
    frames = training.frames
    values = model.initial_values(training, 1, 2)[1]
    values |= {"variance": np.array(0.8), "gamma": np.array(1.7), "beta": np.array(30.0)}
    y = np.asarray(frames.y)
    x = values["x"] if not model.on else on_surface(training.surface, values)
    square = np.sum((x[:, None] - x[None]) ** 2, axis=-1)
    K = 0.8 * np.exp(-0.5 * 1.7 * square) + np.eye(len(x)) / 30.0
    expected = multivariate_normal(np.zeros(len(x)), K).logpdf(y.T).sum()
    expected += lognorm(1.0).logpdf(0.8) + lognorm(1.0).logpdf(1.7)
    expected += lognorm(1.0, scale=100.0).logpdf(30.0)
    if model.on:
        expected += norm().logpdf(values["phase"]).sum()
        expected += norm(np.arange(4), 1.0).logpdf(values["gait"]).sum()
        radii = np.array(training.surface.radii)
        expected += lognorm(0.2, scale=radii).logpdf(values["radius"]).sum()
    elif model.surface == "none":
        expected += norm(0.0, model.breadth).logpdf(x).sum()
    else:
        near, weights = frames.topology.neighbours, frames.topology.weights
        for q in range(3):
            if not frames.topology.constrained[q]:
                continue
            made = np.sum(weights[q] * x[near, q], axis=1)
            expected -= np.sum((x[:, q] - made) ** 2) / model.sigma**2
        expected -= np.sum(x**2) / (2 * model.breadth**2)
        expected += log_normaliser(frames.topology, model.sigma, model.breadth)
    if model.dynamics:
        # The dynamics themselves have tests of their own.
        alpha = jnp.append(jnp.asarray(ALPHA_MEDIAN), model.dynamics_noise**-2)
        path = GPDynamics(alpha, frames.steps, x.shape)
        expected += float(path.log_prob(unit_scale(x, frames.steps)))
        expected += sum(lognorm(1.0, scale=m).logpdf(m) for m in ALPHA_MEDIAN)
    density = ProgramDensity(model)
    found = jax.jit(density)(density.real(values, training.data), training.data)
    np.testing.assert_allclose(found, expected, rtol=1e-7)


@pytest.mark.parametrize("name", ["torus3", "cylinder3", "ll_gpdm"])
def test_training_data_lie_as_the_surface_does(cycles, name):
    model = VARIANTS[name]
    assert isinstance(model, Model)
    assert build_model(describe_model(model), "test") == model
    training = model.prepare(cycles, scales=LAYERS[name])
    layers, parts = len(LAYERS[name]), split(cycles)
    y = np.asarray(training.frames.y).reshape(layers, 4, 8, 54)
    for gait, clip in enumerate(training.gaits):
        middle = LAYERS[name].index(1.0)
        np.testing.assert_allclose(y[middle, gait], training.encoding.scaled(parts[clip]))
    if layers == 3:
        mean = y[1].mean(axis=1, keepdims=True)
        np.testing.assert_allclose(y[0], mean + 0.4 * (y[1] - mean), atol=1e-9)
    dims, coords = model.dims(), model.coords(training)
    values = model.initial_values(training, 0, 1)[0]
    density = ProgramDensity(model)
    found = density.natural(density.real(values, training.data), training.data)
    assert set(values) <= set(found)
    # Every model begins at the ideal surface, or at principal components.
    np.testing.assert_allclose(found["x"], training.ideal(), atol=1e-9)
    values = {**values, "x": np.asarray(found["x"])}
    for site, value in values.items():
        assert tuple(len(coords[dim]) for dim in dims[site]) == value.shape
    observed = training.observed()
    assert observed["y"].shape == training.frames.y.shape
    assert set(training.constants()) == {"mean", "lever", "unit"}


def test_features_are_about_millimetres(cycles):
    """A small change of the features moves the joints by its size, root mean square."""
    encoding = GaitPose().prepare(cycles).encoding
    y = encoding.scaled(cycles)[:1]
    for feature in (0, 15, 18):
        moved = y + 1e-3 * np.eye(54)[feature]
        where = joint_positions(encoding.vectors(np.concatenate([y, moved])), encoding.skeleton)
        size = np.sqrt(np.mean(np.sum((where[1] - where[0]) ** 2, axis=-1)))
        assert size == pytest.approx(1e-3 * encoding.unit, rel=0.35)
    back = encoding.motion(encoding.scaled(cycles)[:8], "again")
    np.testing.assert_allclose(encoding.scaled(back), encoding.scaled(cycles)[:8], atol=1e-9)


def test_what_cannot_be_trained_on_is_refused(cycles):
    with pytest.raises(InputError, match="grow"):
        GaitPose().prepare(cycles, scales=(1.0, 0.4))
    with pytest.raises(InputError, match="the surface is none"):
        GaitPose("none", on=True)
    holed = cycles.copy(deep=True)
    holed["angle"][3, 2] = np.nan
    with pytest.raises(InputError, match="angles are missing"):
        GaitPose().prepare(holed)
    with pytest.raises(InputError, match="poses"):
        GaitPose().prepare(cycles.isel(frame=slice(28)))
    with pytest.raises(InputError, match="does not turn"):
        GaitPose().prepare(cycles).encoding.columns(["tail"])


@pytest.fixture(scope="module")
def torus(cycles):
    with pytest.warns(MotionWarning, match="not converged"):
        return fit_map(
            VARIANTS["torus1"], cycles, starts=1, keep=1, max_steps=10,
            preparation={"scales": [1.0]},
        )  # fmt: skip


def test_a_fit_comes_back_and_says_the_same(torus, tmp_path):
    torus.save(tmp_path / "torus.nc")
    back = load(tmp_path / "torus.nc")
    assert back.model == torus.model
    x = torus.values()["x"][:5]
    for one, other in zip(torus.given.predict(x), back.given.predict(x), strict=True):
        np.testing.assert_array_equal(one, other)
    start = VARIANTS["torus1"].initial_values(torus.training, 0, 1)[0]
    density = ProgramDensity(torus.model)
    before = density(density.real(start, torus.training.data), torus.training.data)
    assert torus.stats()["lp"] > float(before) + 100.0


def test_the_fast_process_is_the_plain_one(torus):
    values, frames = torus.values(), torus.training.frames
    process = torus.given
    x = values["x"][:6] + 0.05
    found = process.predict(x)

    def k(a, b):
        square = np.sum((a[:, None] - b[None]) ** 2, axis=-1)
        return values["variance"] * np.exp(-0.5 * values["gamma"] * square)

    noise = 1.0 / values["beta"] + torus.model.personal
    K = k(values["x"], values["x"]) + noise * np.eye(len(values["x"]))
    cross = k(x, values["x"])
    np.testing.assert_allclose(found[0], cross @ np.linalg.solve(K, frames.y), atol=1e-6)
    variance = values["variance"] - np.sum(cross * np.linalg.solve(K, cross.T).T, axis=1)
    np.testing.assert_allclose(found[1][:, 7], variance, atol=5e-3 * float(values["variance"]))
    assert (np.asarray(found[1][:, 0]) >= variance - 1e-9).all()
    assert process.candidates.shape == (4, 8, 3)
    # A path that bends as the training cycles do is likelier than a ragged one.
    path = np.asarray(process.candidates[0])
    ragged = path + 0.5 * np.random.default_rng(0).normal(size=path.shape)
    assert float(process.log_prior(path)) > float(process.log_prior(ragged))


@pytest.mark.slow
def test_a_small_surface_can_be_sampled():
    walks = synthetic_walkers(("ann", "ben", "cas"), ("walk",), seconds=2.6, styles=2)
    few = cycles_of(walks, 1, poses=6)
    fit = fit_nuts(
        GaitPose("torus", sigma=0.1), few, seed=0, warmup=60, draws=40, chains=2,
        mass="diagonal", max_tree_depth=6,
    )  # fmt: skip
    posterior = fit.tree["posterior"]
    assert posterior["x"].shape == (2, 40, 18, 3)
    # What data can tell agrees between chains: the noise, and distances of latent points in
    # the kernel's unit.
    x = posterior["x"].values
    apart = np.linalg.norm(x[:, :, 0] - x[:, :, 3], axis=-1)
    apart = apart * np.sqrt(posterior["gamma"].values)
    for values in (np.log(posterior["beta"].values), apart):
        assert float(az.rhat(values)) < 1.3
    assert int(fit.tree["sample_stats"]["diverging"].values.sum()) < 8
