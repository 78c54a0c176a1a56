"""Voice puppetry: its density against sums over all paths, EM, predictions, trajectories."""

from dataclasses import replace
from functools import partial
from itertools import pairwise, product

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, norm, wishart

from bayesmotion.errors import InputError
from bayesmotion.fit import load
from bayesmotion.inference.density import ProgramDensity, natural_values, real_values
from bayesmotion.inference.methods import EM, fit
from bayesmotion.inference.optimisation.optimise import maximise
from bayesmotion.inference.predicting import predict
from bayesmotion.inference.results import log_densities
from bayesmotion.model import draw_sites
from bayesmotion.models.voice_puppetry import VoicePuppetry
from bayesmotion.models.voice_puppetry.entropic import log_normaliser
from bayesmotion.models.voice_puppetry.example import three_mouths
from bayesmotion.models.voice_puppetry.trajectory import Normals, trajectory
from bayesmotion.registry import build_model, describe_model

MODEL = VoicePuppetry(2)
STATES = range(2)

drawn_sites = jax.jit(draw_sites, static_argnums=0)
pointwise = jax.jit(VoicePuppetry.pointwise, static_argnums=0)
identified = jax.jit(VoicePuppetry.identified, static_argnums=0)


def clips(holes=True):
    data = three_mouths(1, clips=2, frames=4)
    if holes:
        data["face"][2, 1] = np.nan
        data["audio"][5, :2] = np.nan
        data["face"][6] = data["audio"][6] = np.nan
    return data


def somewhere(seed=2):
    """Values of the unobserved sites, drawn from their priors."""
    drawn = drawn_sites(MODEL, jax.random.key(seed), MODEL.prepare(clips(False)).frames)
    return {n: np.asarray(v) for n, v in drawn.items() if n not in MODEL.outputs}


def frame_density(model, frames, values, t, s, outputs=None):
    """Log density of what is seen of a frame in a state."""
    total = 0.0
    for name in outputs or model.outputs:
        y = np.asarray(frames.y[name])[t]
        seen = np.flatnonzero(~np.isnan(y))
        if seen.size:
            covariance = np.linalg.inv(values[f"{name}_precision"][s])[np.ix_(seen, seen)]
            normal = multivariate_normal(values[f"{name}_mean"][s][seen], covariance)
            total += normal.logpdf(y[seen])
    return total


def every_path(model, frames, values, emission):
    """All paths of states of all frames, and log p(path, outputs)."""
    n, begins = len(emission), np.asarray(frames.begins)
    paths = list(product(range(model.states), repeat=n))
    logs = []
    for path in paths:
        total = sum(emission[t, s] for t, s in enumerate(path))
        total += sum(np.log(values["initial"][path[t]]) for t in np.flatnonzero(begins))
        moves = enumerate(pairwise(path), start=1)
        total += sum(np.log(values["transition"][a, b]) for t, (a, b) in moves if not begins[t])
        logs.append(total)
    return np.array(paths), np.array(logs)


def emissions(model, frames, values, outputs=None):
    n = len(frames.begins)
    return np.array([[frame_density(model, frames, values, t, s, outputs)
                      for s in range(model.states)] for t in range(n)])  # fmt: skip


@partial(jax.jit, static_argnums=0)
def density_at(model, data, values):
    density = ProgramDensity(model)
    return density(density.real(values, data), data)


def height(model, data, values):
    return float(density_at(model, data.data, values))


@jax.jit
def predicted(values, frames, new):
    """Predictions of new frames: the mixtures, their moments, and the means of normals of each."""
    found = MODEL.predict(MODEL.condition(frames, values), new, {})
    key = jax.random.key(0)
    return found, {n: (f.mean, f.variance, f.marginals(key).mean) for n, f in found.items()}


def test_the_density_is_the_sum_over_all_paths_with_priors_written_out():
    data = MODEL.prepare(clips())
    values = somewhere()
    _, logs = every_path(MODEL, data.frames, values, emissions(MODEL, data.frames, values))
    total = logsumexp(logs)
    for theta in (values["initial"], *values["transition"]):
        total += np.sum(theta * np.log(theta)) - log_normaliser(2)
    for name in MODEL.outputs:
        d = values[f"{name}_mean"].shape[1]
        prior = wishart(d + 7.0, np.eye(d) / (6.0 * 0.25))
        total += sum(prior.logpdf(precision) for precision in values[f"{name}_precision"])
        total += norm.logpdf(values[f"{name}_mean"], 0.0, 1.5).sum()
    assert height(MODEL, data, values) == pytest.approx(total, rel=1e-8)


def test_frames_left_out_are_the_quotient_of_two_densities():
    data = MODEL.prepare(clips())
    values, frames = somewhere(), data.frames
    emission = emissions(MODEL, frames, values)
    found = np.asarray(pointwise(MODEL, frames, values))
    whole = logsumexp(every_path(MODEL, frames, values, emission)[1])
    for t in range(len(emission)):
        without = emission.copy()
        without[t] = 0.0
        rest = logsumexp(every_path(MODEL, frames, values, without)[1])
        assert found[t] == pytest.approx(whole - rest, rel=1e-7, abs=1e-7)
    assert found[6] == pytest.approx(0.0, abs=1e-8)


def test_predictions_mix_the_states_by_their_probabilities_given_all_that_is_seen():
    data = MODEL.prepare(clips(False))
    values = somewhere()
    new = MODEL.prepare(clips(), data)
    found, moments = predicted(values, data.frames, new.frames)
    emission = emissions(MODEL, new.frames, values)
    paths, logs = every_path(MODEL, new.frames, values, emission)
    mass = np.exp(logs - logsumexp(logs))
    share = np.array([[mass[paths[:, t] == s].sum() for s in STATES] for t in range(8)])
    for name in MODEL.outputs:
        found_mean, found_variance, normals = moments[name]
        y = np.asarray(new.frames.y[name])
        for t in range(8):
            means, variances = [], []
            seen, unseen = ~np.isnan(y[t]), np.isnan(y[t])
            for s in STATES:
                mean = values[f"{name}_mean"][s].copy()
                covariance = np.linalg.inv(values[f"{name}_precision"][s])
                variance = np.diag(covariance).copy()
                if seen.any() and unseen.any():
                    part = covariance[np.ix_(unseen, seen)]
                    gain = part @ np.linalg.inv(covariance[np.ix_(seen, seen)])
                    mean[unseen] += gain @ (y[t] - values[f"{name}_mean"][s])[seen]
                    variance[unseen] -= np.diag(gain @ part.T)
                means.append(mean)
                variances.append(variance)
            expected = share[t] @ np.array(means)
            np.testing.assert_allclose(found_mean[t], expected, atol=1e-8)
            spread = share[t] @ (np.array(variances) + (np.array(means) - expected) ** 2)
            np.testing.assert_allclose(found_variance[t], spread, atol=1e-8)
        off = np.abs(np.mean(normals, axis=0) - found_mean)
        apart = np.ptp(np.asarray(found[name].means), axis=1)
        assert (off <= apart / 64 + 1e-9).all()


def test_draws_have_the_moments():
    data = MODEL.prepare(clips(False))
    values = somewhere()
    new = MODEL.prepare(clips(), data)
    found, moments = predicted(values, data.frames, new.frames)
    keys = jax.random.split(jax.random.key(0), 4000)
    draws = np.asarray(jax.jit(jax.vmap(found["face"].sample))(keys))
    mean, variance, _ = map(np.asarray, moments["face"])
    assert (np.abs(draws.mean(axis=0) - mean) / np.sqrt(variance / 4000)).max() < 4.5
    np.testing.assert_allclose(draws.var(axis=0), variance, rtol=0.25)


def test_prior_draws_are_finite_and_the_outputs_share_their_states():
    data = MODEL.prepare(clips(False))
    for seed in range(3):
        drawn = drawn_sites(MODEL, jax.random.key(seed), data.frames)
        assert all(np.isfinite(value).all() for value in drawn.values())
    far = somewhere()
    for name in MODEL.outputs:
        d = far[f"{name}_mean"].shape[1]
        far[f"{name}_mean"] = np.array([[-9.0], [9.0]]) * np.ones(d)
        far[f"{name}_precision"] = np.repeat(np.eye(d)[None], 2, axis=0)
    drawn = drawn_sites(MODEL, jax.random.key(9), data.frames, far)
    signs = [np.sign(np.asarray(drawn[name])[:, 0]) for name in MODEL.outputs]
    np.testing.assert_array_equal(signs[0], signs[1])
    np.testing.assert_array_equal(signs[0], signs[2])


def test_identified_quantities_do_not_number_the_states():
    data = MODEL.prepare(clips())
    values = somewhere()
    other = {name: value[::-1] for name, value in values.items()}
    other["transition"] = other["transition"][:, ::-1]
    first, second = (identified(MODEL, data.frames, v) for v in (values, other))
    coords = MODEL.coords(data)
    for name, value in first.items():
        np.testing.assert_allclose(second[name], value, rtol=1e-9, atol=1e-12)
        assert tuple(len(coords[dim]) for dim in MODEL.dims()[name]) == np.shape(value)


def holed(recordings):
    recordings["face"][4, 1] = recordings["audio"][9] = np.nan
    return recordings


def test_em_climbs_the_programs_density_to_its_optimum():
    recordings = holed(three_mouths(0))
    model = VoicePuppetry(3)
    data = model.prepare(recordings)
    heights = []
    found = model.em(data, seed=0, max_steps=300, tolerance=0.0,
                     progress=lambda step, here: heights.append(here))  # fmt: skip
    assert (np.diff(heights) > -1e-7).all()

    def height(values):
        # As a fit has it, which the next test compiles as well.
        one = {name: np.asarray(value)[None, None] for name, value in values.items()}
        parts = log_densities(model, one, data.data)
        return sum(value.sum() for part in parts for value in part.values())

    assert height(found.values) == pytest.approx(found.log_density, rel=1e-9)
    # From there the search of the mode gains nothing; probabilities of zero are put inside.
    inside = dict(found.values)
    for name in ("initial", "transition"):
        theta = np.maximum(inside[name], 1e-9)
        inside[name] = theta / theta.sum(axis=-1, keepdims=True)
    density = ProgramDensity(model)
    start = {n: jnp.asarray(v)[None] for n, v in real_values(density, inside, data.data).items()}
    optimum = maximise(density, start, data.data, max_steps=200)
    assert optimum.log_density[0] - found.log_density < 1e-3
    moved = natural_values(density, optimum.best(), data.data)
    np.testing.assert_allclose(moved["face_mean"], found.values["face_mean"], atol=2e-3)
    # A start elsewhere is told from it.
    wrong = {**inside, "face_mean": inside["face_mean"] + 0.5}
    assert height(wrong) < found.log_density - 1.0


def test_a_face_follows_its_sound_and_a_fit_is_loaded_to_the_last_bit(tmp_path):
    recordings = holed(three_mouths(0, clips=4))
    training, test = recordings.isel(frame=slice(0, 60)), recordings.isel(frame=slice(60, 80))
    trained = fit(VoicePuppetry(3), training, method=EM(), seed=0)
    trained.save(tmp_path / "fit.nc")
    heard = test.drop_vars("face")
    made = predict(trained, heard).site("face")
    off = made.means() - test["face"].values
    assert np.sqrt(np.mean(off**2)) < 0.65 * test["face"].values.std()
    again = predict(load(tmp_path / "fit.nc"), heard).site("face")
    np.testing.assert_array_equal(again.means(), made.means())


@pytest.mark.parametrize(
    "other",
    [{"states": 3}, {"face": "audio", "audio": "face"}, {"velocity": False}, {"state_sd": 0.2}],
)
def test_every_setting_changes_something(other):
    model = replace(MODEL, **other)
    assert build_model(describe_model(model), "here") == model
    data = [one.prepare(clips()) for one in (MODEL, model)]
    key = jax.random.key(2)
    sites = [
        {n: v.shape for n, v in jax.eval_shape(partial(draw_sites, one), key, own.frames).items()}
        for one, own in zip((MODEL, model), data, strict=True)
    ]
    if sites[0] == sites[1]:  # other numbers then
        values = somewhere()
        assert height(MODEL, data[0], values) != height(model, data[1], values)


def test_clips_that_are_no_views_are_refused():
    with pytest.raises(InputError, match="no such view"):
        MODEL.prepare(clips().drop_vars("face"))
    with pytest.raises(InputError, match="as in training"):
        MODEL.prepare(clips().isel(coordinate=[0]), MODEL.prepare(clips()))
    with pytest.raises(InputError, match="not positive"):
        VoicePuppetry(0)
    with pytest.raises(InputError, match="states: there are 99 for 8 frames"):
        fit(VoicePuppetry(99), clips(), method="em")


def test_a_trajectory_is_the_minimum():
    random = np.random.default_rng(0)
    roots = random.normal(size=(2, 3, 2, 2))
    precision = roots @ roots.transpose(0, 1, 3, 2) + 0.5 * np.eye(2)
    position, velocity = (Normals(random.normal(size=(3, 2)), part) for part in precision)
    occupancy, begins = random.dirichlet(np.ones(3), 6), np.arange(6) % 3 == 0
    found = trajectory(position, velocity, occupancy, begins)

    def cost(flat):
        z, total = flat.reshape(6, 2), 0.0
        for t, k in np.ndindex(6, 3):
            away = z[t] - position.mean[k]
            total += occupancy[t, k] * away @ position.precision[k] @ away
            if not begins[t]:
                away = z[t] - z[t - 1] - velocity.mean[k]
                total += occupancy[t, k] * away @ velocity.precision[k] @ away
        return total

    best = minimize(cost, np.zeros(12), tol=1e-10).x.reshape(6, 2)
    np.testing.assert_allclose(found, best, atol=1e-4)
