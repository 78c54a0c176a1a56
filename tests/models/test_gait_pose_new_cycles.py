"""New cycles: their program, predictions given what is seen, and poses left out, by hand."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpyro.handlers import seed, substitute, trace
from scipy.stats import multivariate_normal, norm

from bayesmotion.errors import InputError
from bayesmotion.model import Model, draw_sites
from bayesmotion.models.gait_pose import SCALES, GaitPose, NoSurface, OnCylinder, OnTorus, Torus
from bayesmotion.models.gait_pose.harmonics import ClosedPaths, harmonics_of
from bayesmotion.motion import concat, split
from bayesmotion.motion.cycles import cycles_of
from bayesmotion.motion.synthetic.walkers import synthetic_walkers

MODEL = GaitPose(NoSurface(latent_size=2))
# What is eager would compile every operation by itself.
condition = jax.jit(MODEL.condition)
predict = jax.jit(MODEL.predict)
HYPER = {"variance": np.array(0.9), "gamma": np.array(1.3), "beta": np.array(40.0)}


@pytest.fixture(scope="module")
def recordings():
    people = ("ann", "ben", "cas", "dee")
    walks = synthetic_walkers(people, ("walk",), seconds=2.6, styles=2)
    parts = list(split(cycles_of(walks, 1, poses=6)).values())
    known, new = concat(parts[:3]), parts[3].copy(deep=True)
    # A wrist is missing in some poses, and in one training cycle.
    wrist = [f"lwrist/r{axis}" for axis in "xyz"]
    new["angle"].loc[{"dof": wrist}] = np.where(
        np.arange(6)[:, None] < 2, np.nan, new["angle"].sel(dof=wrist).values
    )
    known = known.copy(deep=True)
    known["angle"].loc[{"dof": wrist}] = np.where(
        np.arange(18)[:, None] < 6, np.nan, known["angle"].sel(dof=wrist).values
    )
    return known, new


@pytest.fixture(scope="module")
def problem(recordings):
    known, new = (MODEL.prepare(recordings[0]), recordings[1])
    training = known
    data = MODEL.prepare(new, training)
    values = {**HYPER, "x": training.ideal()}
    path = training.ideal()[6:12] + 0.3 * np.random.default_rng(0).normal(size=(6, 2))
    return training, data, values, path


def k(a, b):
    square = np.sum((a[:, None] - b[None]) ** 2, axis=-1)
    return 0.9 * np.exp(-0.5 * 1.3 * square)


def brute_force(training, data, x, path, column):
    """Mean and covariance of a column of the new cycle given the training poses seen."""
    y, seen = training.frames.y[:, column], training.seen()[:, column]
    noise = 1.0 / 40.0 + MODEL.subject_noise_sd**2
    K = k(x, x)[np.ix_(seen, seen)] + noise * np.eye(seen.sum())
    cross = k(path, x[seen])
    mean = cross @ np.linalg.solve(K, y[seen])
    return mean, k(path, path) - cross @ np.linalg.solve(K, cross.T), noise


def test_the_program_of_new_cycles_is_the_conditional_density(problem):
    training, data, values, path = problem
    trained = condition(*training.data, values)

    @jax.jit
    def log_probs(path):
        sites = trace(substitute(MODEL.program, data={"x": path})).get_trace(*data.data, trained)
        drawn = {name: site for name, site in sites.items() if site["type"] == "sample"}
        return {name: site["fn"].log_prob(site["value"]) for name, site in drawn.items()}

    expected, x = 0.0, values["x"]
    for column in range(54):
        mean, covariance, noise = brute_force(training, data, x, path, column)
        seen = data.seen()[:, column]
        total = covariance + noise * np.eye(6)
        density = multivariate_normal(mean[seen], total[np.ix_(seen, seen)])
        expected += density.logpdf(data.frames.y[seen, column])
    assert_allclose(log_probs(path)["y"], expected, rtol=1e-7)
    # The path is closed and bends as those of training, wherever it begins.
    bend = path - 0.5 * (np.roll(path, 1, axis=0) + np.roll(path, -1, axis=0))
    size = np.sqrt(np.mean(
        [(2 * p - np.roll(p, 1, 0) - np.roll(p, -1, 0)) ** 2 for p in x.reshape(3, 6, 2)],
        axis=(0, 1),
    ))  # fmt: skip
    curved = norm.logpdf(2.0 * bend / size).sum(), norm.logpdf(np.zeros_like(bend)).sum()
    still = norm(x.mean(axis=0), x.std(axis=0))
    flat = np.tile(x.mean(axis=0), (6, 1))
    found = log_probs(path)["x"] - log_probs(flat)["x"]
    by_hand = curved[0] - curved[1] + 6.0 * 0.0
    by_hand += np.sum(still.logpdf(path.mean(axis=0)) - still.logpdf(x.mean(axis=0)))
    assert_allclose(found, by_hand, rtol=1e-9)
    rolled = np.roll(path, 2, axis=0)
    assert_allclose(log_probs(rolled)["x"], log_probs(path)["x"], rtol=1e-9)


def test_entries_are_predicted_from_those_that_are_seen(problem):
    training, data, values, path = problem
    trained = condition(*training.data, values)
    found = predict(trained, *data.data, {"x": path})["y"]
    found_mean, found_variance = np.asarray(found.mean), np.asarray(found.variance)
    for column in (3, *data.encoding.columns(["lwrist"])):
        mean, covariance, noise = brute_force(training, data, values["x"], path, column)
        seen = data.seen()[:, column]
        K = covariance[np.ix_(seen, seen)] + noise * np.eye(seen.sum())
        gain = np.linalg.solve(K, covariance[seen]).T
        y = mean + gain @ (data.frames.y[seen, column] - mean[seen])
        variance = np.diag(covariance - gain @ covariance[seen]) + noise
        assert_allclose(found_mean[:, column], y, atol=1e-7)
        assert_allclose(found_variance[:, column], variance, atol=1e-7)
    # Missing values have no say, whatever stands there.
    other = replace(data.frames, y=np.where(data.seen(), data.frames.y, 99.0))
    assert_allclose(predict(trained, other, {"x": path})["y"].mean, found_mean, atol=1e-12)


def test_draws_are_conditioned_on_together_as_one_by_one(problem):
    training, data, values, _ = problem
    draws = {name: jnp.stack([value, 1.1 * value]) for name, value in values.items()}
    every = jax.lax.map(lambda one: MODEL.condition(*training.data, one), draws)
    for index in range(2):
        one = condition(*training.data, {n: v[index] for n, v in draws.items()})
        for a, b in zip(jax.tree.leaves(every), jax.tree.leaves(one), strict=True):
            if np.shape(b)[-1:] != np.shape(one.roots)[-1:]:
                assert_allclose(a[index], b, atol=1e-9)
    starts = MODEL.initial_values(data, 0, 5, one)
    assert all(start["x"].shape == (6, 2) for start in starts)

    @jax.jit
    def score(start):
        program = substitute(seed(MODEL.program, jax.random.key(0)), data=start)
        return trace(program).get_trace(*data.data, one)["y"]["fn"].log_prob(data.frames.y)

    scores = [float(score(start)) for start in starts[:3]]
    assert scores[0] == max(scores)


def test_a_cycle_that_is_not_conditioned_on_says_nothing(problem):
    training, _, values, path = problem
    some = MODEL.condition_on_some(*training.data, values, np.array([1.0, 0.0, 1.0]))
    y = np.array(training.frames.y)
    y[6:12] = 7.0
    changed = replace(training.frames, y=y)
    again = MODEL.condition_on_some(changed, values, np.array([1.0, 0.0, 1.0]))
    for one, other in zip(some.at(path), again.at(path), strict=True):
        assert_allclose(one, other, atol=1e-12)
    x = values["x"].reshape(3, 6, 2)
    assert_allclose(some.paths, x[[0, 2, 0]])
    rows = np.r_[0:6, 12:18]
    K = k(values["x"][rows], values["x"][rows]) + np.asarray(some.noise) * np.eye(12)
    cross = k(path, values["x"][rows])
    assert_allclose(some.at(path)[0][:, 3], cross @ np.linalg.solve(K, y[rows, 3]), atol=1e-8)


@pytest.mark.parametrize("layers", [1, 3])
def test_poses_left_out_are_conditioned_on_all_others(recordings, layers):
    """Exactly, with their copies of other scales."""
    model = GaitPose(NoSurface(latent_size=2), scales=SCALES if layers == 3 else (1.0,))
    training = model.prepare(recordings[0])
    values = {**HYPER, "x": training.ideal()}
    found = np.asarray(jax.jit(model.pointwise)(*training.data, values))
    points = model.points(training)
    assert found.shape == points["clip"][1].shape == (18,)
    K = k(values["x"], values["x"]) + np.eye(18 * layers) / 40.0
    y, seen = training.frames.y, training.seen()
    for point in (2, 9):
        block = point + 18 * np.arange(layers)
        expected = 0.0
        for column in range(54):
            own = block[seen[block, column]]
            rest = np.setdiff1d(np.flatnonzero(seen[:, column]), block)
            if len(own):
                gain = np.linalg.solve(K[np.ix_(rest, rest)], K[np.ix_(rest, own)]).T
                left = K[np.ix_(own, own)] - gain @ K[np.ix_(rest, own)]
                density = multivariate_normal(gain @ y[rest, column], left)
                expected += density.logpdf(y[own, column])
        assert_allclose(found[point], expected, rtol=1e-8)
    assert points["clip"][1][2] == training.gaits[0]
    assert points["pose"][1][9] == 3


def test_identified_quantities_do_not_turn(problem):
    training, _, values, _ = problem
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    # Points twice as near with a quarter of the length say the same.
    other = {**values, "x": 0.5 * values["x"] @ turn, "gamma": 4.0 * values["gamma"]}
    identified = jax.jit(MODEL.identified)
    one, same = (identified(*training.data, v) for v in (values, other))
    dims, coords = MODEL.dims(), MODEL.coords(training)
    for name, value in one.items():
        assert_allclose(same[name], value, rtol=1e-9, err_msg=name)
        assert np.shape(value) == tuple(len(coords[dim]) for dim in dims[name])
    assert "gamma" not in one
    assert {"variance", "beta", "kernel", "distance", "log_likelihood"} <= set(one)


def test_new_cycles_are_described_as_the_training_cycles_are(recordings, problem):
    training, data, _, _ = problem
    encoding = training.encoding
    assert_allclose(data.observed()["y"], encoding.scaled(recordings[1]), equal_nan=True)
    units = data.units()["y"]
    vectors = encoding.vectors(data.observed()["y"].values).reshape(6, -1)
    back = units.location + units.scale * data.observed()["y"].values
    assert_allclose(back, vectors, atol=1e-12, equal_nan=True)
    coords = MODEL.coords(data)
    assert len(coords["frame"]) == 6
    with pytest.raises(InputError, match="have 4 poses"):
        MODEL.prepare(recordings[1].isel(frame=slice(4)), training)
    with pytest.raises(InputError, match="no surface"):
        data.ideal()


def test_closed_paths_are_drawn_as_their_density_says():
    prior = ClosedPaths(np.array([0.3, 0.1]), np.array([1.0, -1.0]), np.array([0.5, 0.2]), 2, 5)
    draws = np.asarray(jax.jit(lambda key: prior.sample(key, (4000,)))(jax.random.key(0)))
    assert draws.shape == (4000, 10, 2)
    first = draws[:, :5]
    bends = np.roll(first, 1, 1) - 2.0 * first + np.roll(first, -1, 1)
    # Bends add up to zero over a closed path: four of five are free.
    for axis, (bend, mean, sd) in enumerate(((0.3, 1.0, 0.5), (0.1, -1.0, 0.2))):
        assert np.mean(bends[..., axis] ** 2) == pytest.approx(0.8 * bend**2, rel=0.05)
        means = first[..., axis].mean(axis=1)
        assert means.mean() == pytest.approx(mean, abs=4.0 * sd / np.sqrt(4000))
        assert means.std() == pytest.approx(sd, rel=0.06)
    # An orthonormal change of coordinates: the density is that of independent harmonics.
    number, waves = harmonics_of(5)
    assert_allclose(waves @ waves.T, np.eye(5), atol=1e-12)
    z = np.einsum("jt,ctq->cjq", waves, draws[0].reshape(2, 5, 2))
    curved = np.where(number == 0, 1.0, 2.0 - 2.0 * np.cos(2.0 * np.pi * number / 5))[:, None]
    sd = np.where(number[:, None] == 0, np.sqrt(5) * prior.scale, prior.bend / curved)
    loc = np.where(number[:, None] == 0, np.sqrt(5) * prior.loc, 0.0)
    assert_allclose(prior.log_prob(draws[0]), norm(loc, sd).logpdf(z).sum(), rtol=1e-9)


@pytest.mark.parametrize("surface", [Torus(), OnTorus(), OnCylinder(), NoSurface()])
def test_every_model_without_dynamics_can_be_drawn_from(surface):
    model = GaitPose(surface, scales=(0.5, 1.0))
    assert isinstance(model, Model)
    case, data = model.sbc_case()
    assert case.model == model

    @jax.jit
    def draw(key):
        values, drawn = case.draw(model, key, data)
        return drawn, case.quantities(model, drawn, values)

    drawn, found = draw(jax.random.key(0))
    assert np.isfinite(drawn.y).all()
    assert drawn.y.shape == (20, 5)
    assert all(np.isfinite(value).all() for value in found.values())


def test_the_example_is_drawn_from_its_prior_and_from_new_cycles(problem):
    model, recordings = GaitPose.example()
    training = model.prepare(recordings)
    values = jax.jit(draw_sites, static_argnums=0)(model, jax.random.key(0), *training.data)
    assert np.isfinite(values["y"]).all()
    _, data, trained_values, _ = problem
    trained = condition(*problem[0].data, trained_values)
    drawn = seed(MODEL.program, jax.random.key(1))
    sites = trace(drawn).get_trace(*data.data, trained)
    assert np.isfinite(sites["x"]["value"]).all()
