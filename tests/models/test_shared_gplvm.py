"""The shared model: special cases that coincide with plain processes, and sampling."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
import pytest
import xarray as xr
from numpyro.infer import MCMC, NUTS, init_to_value
from scipy.stats import multivariate_normal

from bayesmotion.errors import InputError
from bayesmotion.inference.density import ProgramDensity
from bayesmotion.models.shared_gplvm import SharedGPLVM
from bayesmotion.models.shared_processes import view_kernel, view_points
from bayesmotion.models.shared_views import Look
from bayesmotion.priors.back_constraints import BackConstraint
from bayesmotion.priors.dynamics import GPDynamics

SMALL = SharedGPLVM(latent_size=2, constraint=BackConstraint("mlp", hidden=4), inducing=100)


def talk(clips: int = 2, frames: int = 10, seed: int = 0) -> xr.Dataset:
    """Two views of a point on a circle that turns unevenly."""
    random = np.random.default_rng(seed)
    x = []
    for _ in range(clips):
        angle = random.uniform(0, 6) + np.cumsum(0.3 + 0.1 * random.normal(size=frames))
        x.append(np.column_stack([np.cos(angle), np.sin(angle)]))
    x = np.concatenate(x)
    audio = np.tanh(x @ np.array([[1.0, -0.5, 0.3, 0.8], [0.4, 1.0, -0.9, 0.1]]))
    face = np.column_stack([x, x[:, 0] * x[:, 1]]) * 10.0
    noise = random.normal(size=(len(x), 7))
    clip = np.repeat([f"clip{i}" for i in range(clips)], frames)
    views = {
        "audio": (("frame", "coefficient"), audio + 0.05 * noise[:, :4]),
        "face": (("frame", "coordinate"), face + 0.3 * noise[:, 4:]),
    }
    labels = {"coefficient": list("abcd"), "coordinate": list("xyz")}
    return xr.Dataset(views, {"clip": ("frame", clip), **labels})


def log_density_of(model, training, values):
    density = ProgramDensity(model)
    return float(density(density.real(values, training.data), training.data))


def test_without_map_and_dynamics_it_is_two_gplvms_of_one_x():
    model = replace(SMALL, back="", dynamics=False)
    training = model.prepare(talk())
    values = model.initial_values(training, 0, 1)[0]
    x, expected = values["x"], float(dist.Normal().log_prob(values["x"]).sum())
    for name in ("audio", "face"):
        scaled = {"x": x * np.sqrt(values[f"{name}_gamma"])}
        K = np.asarray(view_kernel(name, values).matrix(scaled, scaled))
        K = K + np.eye(len(x)) / values[f"{name}_beta"]
        normal = multivariate_normal(np.zeros(len(x)), K)
        expected += sum(normal.logpdf(column) for column in training.frames.y[name].T)
        for part, median in (("variance", 1.0), ("linear", 0.1), ("gamma", 0.5), ("beta", 5.0)):
            prior = dist.LogNormal(np.log(median), 1.0)
            expected += float(jnp.sum(prior.log_prob(values[f"{name}_{part}"])))
    assert log_density_of(model, training, values) == pytest.approx(expected, rel=1e-6)


def test_dynamics_are_those_of_the_exact_process():
    training = SMALL.prepare(talk())
    values = SMALL.initial_values(training, 0, 1)[0]
    with_steps = log_density_of(SMALL, training, values)
    without = {name: value for name, value in values.items() if name != "alpha"}
    rest = log_density_of(replace(SMALL, dynamics=False), training, without)
    x = np.asarray(SMALL.mapped(training.frames.seen, training.frames.centres, values))
    x = x - x.mean(axis=0)
    x = x / np.sqrt(np.mean(x**2))
    alpha = np.append(values["alpha"], SMALL.dynamics_noise**-2)
    path = GPDynamics(alpha, training.frames.steps, x.shape).log_prob(x)
    prior = dist.LogNormal(jnp.log(jnp.array([0.1, 1.0, 1.0])), 1.0).log_prob(values["alpha"])
    assert with_steps - rest == pytest.approx(float(path + prior.sum()), rel=1e-6)


def test_private_coordinates_are_seen_by_their_view_alone():
    model = replace(SMALL, private=(2, 1))
    training = model.prepare(talk())
    values = model.initial_values(training, 0, 1)[0]
    natural = ProgramDensity(model).natural(
        ProgramDensity(model).real(values, training.data), training.data
    )
    assert natural["x"].shape == (20, 2)
    assert natural["audio_private"].shape == (20, 2)
    assert natural["face_private"].shape == (20, 1)
    points = view_points("face", values, natural["x"], {"face": natural["face_private"]})
    assert points["x"].shape == (20, 3)
    assert view_points("face", {"face_gamma": np.array(1.0)}, natural["x"], {})["x"].shape == (
        20,
        2,
    )
    assert model.dims()["audio_private"] == ("frame", "audio_own_latent")


def test_three_views_share_one_path():
    data = talk()
    data["brow"] = (("frame", "brow_feature"), data["face"].values[:, :2] ** 2)
    data = data.assign_coords(brow_feature=["l", "r"])
    model = replace(SMALL, views=("audio", "face", "brow"))
    training = model.prepare(data)
    values, frames = model.initial_values(training, 0, 1)[0], training.frames
    given = model.condition(
        frames, {**values, "x": model.mapped(frames.seen, frames.centres, values)}
    )
    assert set(given.views) == {"audio", "face", "brow"}
    assert np.isfinite(log_density_of(model, training, values))


def test_windows_see_their_clip_alone_and_count_less_far_off():
    look = Look(width=1, taper=2.0, lifter=np.inf, components=99)
    seen = look(np.arange(3.0)[:, None])
    near = np.exp(-0.125)
    np.testing.assert_allclose(seen, [[0, 0, near], [0, 1, 2 * near], [near, 2, 2 * near]])
    half = Look(lifter=1.0)(np.ones((2, 2)))
    np.testing.assert_allclose(half, [[1, np.exp(-0.5)]] * 2)


def test_every_other_frame_is_explained_with_windows_of_all():
    model = replace(SMALL, look=Look(width=2))
    every, some = model.prepare(talk()), model.prepare(talk(), every=3)
    kept = np.r_[0:10:3, 10:20:3]
    np.testing.assert_array_equal(some.frames.seen, every.frames.seen[kept])
    np.testing.assert_array_equal(some.frames.y["face"], every.frames.y["face"][kept])
    assert list(some.frames.steps.first) == [0, 4]
    with pytest.raises(InputError, match="every: it is 10"):
        model.prepare(talk(), every=10)


def test_data_that_are_no_views_are_refused():
    data = talk()
    with pytest.raises(InputError, match="no such view"):
        SMALL.prepare(data.drop_vars("face"))
    with pytest.raises(InputError, match="in pieces"):
        SMALL.prepare(data.isel(frame=np.r_[0:5, 10:15, 5:10]))
    missing = data.copy(deep=True)
    missing["face"][3, 1] = np.nan
    with pytest.raises(InputError, match="missing"):
        SMALL.prepare(missing)
    with pytest.raises(InputError, match="it is no view"):
        SharedGPLVM(back="sound")
    with pytest.raises(InputError, match="one number a view"):
        SharedGPLVM(private=(1,))


def test_nuts_draws_from_the_posterior_of_little_data():
    model = replace(SMALL, constraint=BackConstraint("linear"), dynamics=False)
    training = model.prepare(talk(1, 8))
    begin = init_to_value(values=model.initial_values(training, 0, 1)[0])
    sampler = MCMC(
        NUTS(model.program, init_strategy=begin, max_tree_depth=4),
        num_warmup=30, num_samples=20, progress_bar=False,
    )  # fmt: skip
    sampler.run(jax.random.key(0), *training.data, extra_fields=("potential_energy",))
    energy = np.asarray(sampler.get_extra_fields()["potential_energy"])
    assert np.isfinite(energy).all()
    assert np.unique(energy).size > 12
    # The noise is about what was put on the sound, whose features have unit spread.
    assert 3.0 < np.median(sampler.get_samples()["audio_beta"]) < 3000.0
