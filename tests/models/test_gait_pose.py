"""Gait-pose models: the density by hand, fits that come back, a fast process that is exact."""

from dataclasses import replace

import arviz as az
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpyro.handlers import substitute, trace
from scipy.stats import lognorm, multivariate_normal, norm

from bayesmotion.distributions.dynamics import GPDynamics, unit_scale
from bayesmotion.distributions.topology import log_normaliser
from bayesmotion.errors import InputError, MotionWarning
from bayesmotion.fit import load
from bayesmotion.inference.density import ProgramDensity
from bayesmotion.inference.optimisation.map import fit_map
from bayesmotion.inference.sampling.nuts import fit_nuts
from bayesmotion.model import Model, ReadsFiles
from bayesmotion.models.gait_pose import (
    SCALES,
    VARIANTS,
    Cylinder,
    GaitPose,
    NoSurface,
    OnTorus,
    PathDynamics,
    PoseCircle,
    Torus,
)
from bayesmotion.models.gait_pose.hyperparameters import ALPHA_MEDIAN
from bayesmotion.motion import save, split
from bayesmotion.motion.cycles import cycles_of, joint_positions
from bayesmotion.motion.synthetic.walkers import synthetic_walkers
from bayesmotion.registry import build_model, describe_model


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
    training = model.prepare(cycles)
    frames = training.frames
    values = model.initial_values(training, 1, 2)[1]
    values |= {"variance": np.array(0.8), "gamma": np.array(1.7), "beta": np.array(30.0)}
    y = np.asarray(frames.y)
    on = "phase" in values
    x = on_surface(training.surface, values) if on else values["x"]
    square = np.sum((x[:, None] - x[None]) ** 2, axis=-1)
    K = 0.8 * np.exp(-0.5 * 1.7 * square) + np.eye(len(x)) / 30.0
    expected = multivariate_normal(np.zeros(len(x)), K).logpdf(y.T).sum()
    expected += lognorm(1.0).logpdf(0.8) + lognorm(1.0).logpdf(1.7)
    expected += lognorm(1.0, scale=100.0).logpdf(30.0)
    if on:
        expected += norm().logpdf(values["phase"]).sum()
        expected += norm(np.arange(4), 1.0).logpdf(values["gait"]).sum()
        radii = np.array(training.surface.radii)
        expected += lognorm(0.2, scale=radii).logpdf(values["radius"]).sum()
    elif model.surface == NoSurface():
        expected += norm(0.0, 2.0).logpdf(x).sum()
    else:
        near, weights = frames.topology.neighbours, frames.topology.weights
        for q in range(3):
            if not frames.topology.constrained[q]:
                continue
            made = np.sum(weights[q] * x[near, q], axis=1)
            expected -= np.sum((x[:, q] - made) ** 2) / 0.1**2
        expected -= np.sum(x**2) / (2 * 2.0**2)
        expected += log_normaliser(frames.topology, 0.1, 2.0)
    if model.dynamics is not None:
        # The dynamics themselves have tests of their own.
        alpha = jnp.append(jnp.asarray(ALPHA_MEDIAN), model.dynamics.noise_sd**-2)
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
    training = model.prepare(cycles)
    layers, parts = len(model.scales), split(cycles)
    y = np.asarray(training.frames.y).reshape(layers, 4, 8, 54)
    for gait, clip in enumerate(training.gaits):
        middle = model.scales.index(1.0)
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
    for scales in ((1.0, 0.4), (), (-1.0, 1.0)):
        with pytest.raises(InputError, match="grow"):
            GaitPose(scales=scales)
    with pytest.raises(InputError, match="sigma"):
        Torus(sigma=0.0)
    never = cycles.copy(deep=True)
    never["angle"].loc[{"dof": "lwrist/rx"}] = np.nan
    with pytest.raises(InputError, match="'lwrist' is missing"):
        GaitPose().prepare(never)
    with pytest.raises(InputError, match="poses"):
        GaitPose().prepare(cycles.isel(frame=slice(28)))
    with pytest.raises(InputError, match="does not turn"):
        GaitPose().prepare(cycles).encoding.columns(["tail"])


# Of every setting another value, and a model that has it.
CHANGED = {
    "scales": (GaitPose(), {"scales": (0.8, 1.0)}),
    "surface": (GaitPose(), {"surface": Cylinder()}),
    "sigma": (GaitPose(), {"surface": Torus(sigma=0.2)}),
    "latent_sd": (GaitPose(), {"surface": Torus(latent_sd=1.0)}),
    "circle": (GaitPose(), {"surface": PoseCircle()}),
    "points": (GaitPose(), {"surface": OnTorus()}),
    "phase_sd": (GaitPose(OnTorus()), {"surface": OnTorus(phase_sd=2.0)}),
    "gait_sd": (GaitPose(OnTorus()), {"surface": OnTorus(gait_sd=2.0)}),
    "radius_sd": (GaitPose(OnTorus()), {"surface": OnTorus(radius_sd=0.1)}),
    "latent_size": (GaitPose(NoSurface()), {"surface": NoSurface(latent_size=2)}),
    "free_latent_sd": (GaitPose(NoSurface()), {"surface": NoSurface(latent_sd=1.0)}),
    "dynamics": (GaitPose(), {"dynamics": PathDynamics()}),
    "noise_sd": (GaitPose(dynamics=PathDynamics()), {"dynamics": PathDynamics(noise_sd=0.1)}),
    "alpha": (GaitPose(dynamics=PathDynamics()), {"dynamics": PathDynamics(alpha=(0.2, 1.0, 1.0))}),
}


@pytest.mark.parametrize("setting", CHANGED)
def test_every_setting_changes_the_density(cycles, setting):
    model, change = CHANGED[setting]
    found = []
    for one in (model, replace(model, **change)):
        assert build_model(describe_model(one), "test") == one
        training = one.prepare(cycles)
        values = one.initial_values(training, 1, 2)[1]
        density = ProgramDensity(one)
        found.append(float(density(density.real(values, training.data), training.data)))
    assert abs(found[1] - found[0]) > 1e-3


def test_missing_entries_are_left_out_of_the_density(cycles):
    """As if they were not there, in features and in what is made of them."""
    holed = cycles.copy(deep=True)
    holed["angle"].loc[{"dof": [f"lwrist/r{axis}" for axis in "xyz"]}] = np.where(
        np.arange(cycles.sizes["frame"])[:, None] % 5 == 2, np.nan, holed["angle"].loc[
            {"dof": [f"lwrist/r{axis}" for axis in "xyz"]}])  # fmt: skip
    model = GaitPose(Cylinder(), SCALES)
    training = model.prepare(holed)
    seen = training.seen()
    columns = training.encoding.columns(["lwrist"])
    assert not seen[:, columns].all()
    assert np.delete(seen, columns, axis=1).all()
    values = model.initial_values(training, 1, 2)[1]
    x, y = values["x"], training.frames.y
    square = np.sum((x[:, None] - x[None]) ** 2, axis=-1)
    K = np.exp(-0.5 * square) + np.eye(len(x)) / 100.0
    expected = 0.0
    for d in range(54):
        rows = seen[:, d]
        prior = multivariate_normal(np.zeros(rows.sum()), K[np.ix_(rows, rows)])
        expected += prior.logpdf(y[rows, d])
    sites = trace(substitute(model.program, data=values)).get_trace(*training.data)
    found = sites["y"]["fn"].log_prob(sites["y"]["value"])
    np.testing.assert_allclose(found, expected, rtol=1e-7)
    assert np.isnan(training.observed()["y"].values[~seen]).all()


@pytest.fixture(scope="module")
def torus(cycles):
    with pytest.warns(MotionWarning, match="not converged"):
        return fit_map(VARIANTS["torus1"], cycles, starts=1, keep=1, max_steps=10)


def process_of(fit):
    return fit.model.condition(*fit.training.data, fit.values())


def test_a_fit_comes_back_and_says_the_same(torus, tmp_path):
    torus.save(tmp_path / "torus.nc")
    back = load(tmp_path / "torus.nc")
    assert back.model == torus.model
    x = torus.values()["x"][:5]
    for one, other in zip(process_of(torus).at(x), process_of(back).at(x), strict=True):
        np.testing.assert_array_equal(one, other)
    start = VARIANTS["torus1"].initial_values(torus.training, 0, 1)[0]
    density = ProgramDensity(torus.model)
    before = density(density.real(start, torus.training.data), torus.training.data)
    assert torus.stats()["lp"] > float(before) + 100.0


def test_the_fast_process_is_the_plain_one(torus):
    values, frames = torus.values(), torus.training.frames
    process = process_of(torus)
    x = values["x"][:6] + 0.05
    found = process.at(x)

    def k(a, b):
        square = np.sum((a[:, None] - b[None]) ** 2, axis=-1)
        return values["variance"] * np.exp(-0.5 * values["gamma"] * square)

    noise = 1.0 / values["beta"] + torus.model.subject_noise_sd**2
    K = k(values["x"], values["x"]) + noise * np.eye(len(values["x"]))
    cross = k(x, values["x"])
    np.testing.assert_allclose(found[0], cross @ np.linalg.solve(K, frames.y), atol=1e-6)
    variance = values["variance"] - np.sum(cross * np.linalg.solve(K, cross.T).T, axis=1)
    np.testing.assert_allclose(found[1][:, 7], variance, atol=5e-3 * float(values["variance"]))
    assert (np.asarray(found[1][:, 0]) >= variance - 1e-9).all()
    assert process.paths.shape == (4, 8, 3)
    # A path that bends as the training cycles do is likelier than a ragged one.
    path = np.asarray(process.paths[0])
    ragged = path + 0.5 * np.random.default_rng(0).normal(size=path.shape)
    assert float(process.log_bend(path)) > float(process.log_bend(ragged))


@pytest.mark.slow
def test_a_small_surface_can_be_sampled():
    walks = synthetic_walkers(("ann", "ben", "cas"), ("walk",), seconds=2.6, styles=2)
    few = cycles_of(walks, 1, poses=6)
    fit = fit_nuts(
        GaitPose(), few, seed=0, warmup=60, draws=40, chains=2,
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


def test_cycles_are_read_from_files(tmp_path):
    walks = synthetic_walkers(("ann", "ben"), ("walk",), seconds=2.6, frame_rate=60.0)
    files = []
    for clip, part in split(walks).items():
        files.append(tmp_path / f"{clip}.nc")
        save(part, files[-1])
    read = GaitPose.read(files, cycles=1, poses=8)
    expected = cycles_of(walks, 1, poses=8)
    np.testing.assert_allclose(read["angle"], expected["angle"], atol=1e-9)
    assert isinstance(GaitPose(), ReadsFiles)
