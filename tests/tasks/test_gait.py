"""Eq. 15: the poses given what is measured, against brute force and on synthetic walks."""

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from bayesmotion.errors import InputError
from bayesmotion.fit import load
from bayesmotion.motion.cycles import diversified
from bayesmotion.tasks import gait
from bayesmotion.tasks.deviation import LeftOver, learn_deviation
from bayesmotion.tasks.latent import PoseModel, Represented, measured, represent
from bayesmotion.tasks.pose_baselines import best_window, fit_pca, nearest_pose, smoothed
from bayesmotion.tasks.pose_posterior import (
    LOG_SCALES,
    Deviation,
    pose_given,
    white_deviation,
)


@pytest.fixture(scope="module")
def cycle(gait_walks, trained_gait):
    part = gait_walks.isel(frame=gait_walks["subject"].values == "new")
    part = part.assign_coords(frame=np.arange(part.sizes["frame"]))
    return trained_gait[1].training.encoding.scaled(diversified(part, 0.667))


def wave_matrices(deviation, t):
    """Covariance (T D, T D) of a deviation whose scales are one, wave by wave."""
    at, covariance = np.arange(t), 0.0
    for k in range(t // 2 + 1):
        root = np.sqrt(deviation.power[k])
        S = root[:, None] * root * deviation.alike[min(k, 3)]
        for wave in (np.cos(2 * np.pi * k * at / t), np.sin(2 * np.pi * k * at / t)):
            if np.linalg.norm(wave) > 1e-9:
                wave = wave / np.linalg.norm(wave)
                covariance = covariance + np.kron(np.outer(wave, wave), S)
    return covariance


def some_deviation(random, t, d, spread=0.0):
    A = random.normal(size=(4, d, 2 * d))
    S = A @ A.swapaxes(1, 2)
    size = np.sqrt(np.diagonal(S, axis1=1, axis2=2))
    alike = S / (size[:, :, None] * size[:, None, :])
    power = random.uniform(0.5, 2.0, size=(t // 2 + 1, d))
    return Deviation(power, alike, np.full(4, spread), np.array(0.1))


@pytest.mark.parametrize("pattern", ["whole columns", "single entries"])
@pytest.mark.parametrize("t", [5, 6])
def test_poses_given_measurements_are_the_conditional_of_everything(pattern, t):
    random = np.random.default_rng(0)
    d = 4
    deviation = some_deviation(random, t, d)
    variance = random.uniform(size=(t, d))
    found = Represented(np.zeros((t, 3)), random.normal(size=(t, d)), variance, 0.0)
    u = random.normal(size=(t, d))
    sd = np.array([0.3, 0.0, 0.5, 0.1])
    seen = np.ones((t, d), bool)
    seen[:, 3] = False
    if pattern == "single entries":
        u[2, 1] = np.nan
    pose = pose_given(found, measured(u, seen, sd), deviation)
    above = np.maximum(variance - 0.1, 0.0).mean()
    C = wave_matrices(deviation, t) + above * np.eye(t * d)
    known = np.flatnonzero((seen & np.isfinite(u)).ravel())
    S = C[np.ix_(known, known)] + np.diag((np.tile(sd, t) ** 2)[known]) + 1e-8 * np.eye(len(known))
    residual = (u - found.mean).ravel()[known]
    gain = np.linalg.solve(S, C[known]).T
    assert_allclose(pose.mean.ravel(), found.mean.ravel() + gain @ residual, atol=1e-6)
    left = np.diag(C - gain @ C[known])
    assert_allclose(pose.sd.ravel() ** 2, np.maximum(left, 0.0), atol=1e-6)
    expected = -0.5 * residual @ np.linalg.solve(S, residual)
    expected -= 0.5 * np.linalg.slogdet(2 * np.pi * S)[1]
    assert pose.log_density == pytest.approx(expected, rel=1e-6)
    # What is exact and seen comes back as it is.
    assert_allclose(pose.mean[[0, 1, 3, 4], 1], u[[0, 1, 3, 4], 1], atol=1e-6)


@pytest.mark.parametrize("t", [5, 6])
def test_every_wave_of_a_cycle_counts_once(t):
    d = 3
    deviation = some_deviation(np.random.default_rng(6), t, d)
    # The fastest wave of an even number of poses has no sine.
    variance = np.diag(wave_matrices(deviation, t)).reshape(t, d).mean(axis=0)
    assert_allclose(deviation.white(t), variance)


def test_scales_are_averaged_as_draws_say():
    """Against importance sampling: scales drawn from their prior, weighted by what is seen."""
    random = np.random.default_rng(4)
    t, d = 2, 3
    deviation = some_deviation(random, t, d, spread=0.6)._replace(usual=np.array(1.0))
    found = Represented(np.zeros((t, 3)), np.zeros((t, d)), np.zeros((t, d)), 0.0)
    u = np.array([[2.5, -1.0, 0.0], [1.0, 2.0, 0.0]])
    seen = np.array([[True, True, False]] * t)
    pose = pose_given(found, measured(u, seen, 0.4), deviation)
    # A cycle of two poses has two waves: their sum and their difference.
    waves = np.array([[1.0, 1.0], [1.0, -1.0]]) / np.sqrt(2.0)
    z = waves @ u[:, :2]
    scales = np.exp(LOG_SCALES)
    weights = np.exp(-0.5 * (LOG_SCALES / 0.6) ** 2)
    weights /= weights.sum()
    mean, square, log_density = np.zeros(t), np.zeros(t), 0.0
    for k in range(2):
        root = np.sqrt(deviation.power[k])
        S = root[:, None] * root * deviation.alike[k]
        parts = []
        for scale in scales:
            K = scale**2 * S[:2, :2] + (0.16 + 1e-8) * np.eye(2)
            gain = np.linalg.solve(K, scale**2 * S[:2, 2])
            density = np.exp(-0.5 * z[k] @ np.linalg.solve(K, z[k]))
            density /= np.sqrt(np.linalg.det(2.0 * np.pi * K))
            left = scale**2 * S[2, 2] - scale**2 * S[2, :2] @ gain
            parts.append((density, gain @ z[k], left))
        density, each, left = np.array(parts).T
        total = weights @ density
        share = weights * density / total
        mean[k] = share @ each
        square[k] = share @ (left + each**2) - mean[k] ** 2
        log_density += np.log(total)
    assert_allclose(pose.mean[:, 2], waves.T @ mean, atol=1e-9)
    assert_allclose(pose.sd[:, 2] ** 2, waves.T**2 @ square, atol=1e-9)
    assert pose.log_density == pytest.approx(log_density)
    # Somebody far off elsewhere is less sure here.
    far = pose_given(found, measured(5.0 * u, seen, 0.4), deviation)
    assert (far.sd[:, 2] > 1.5 * pose.sd[:, 2]).all()


def test_any_model_that_predicts_can_be_asked():
    from typing import NamedTuple

    class Plane(NamedTuple):
        weights: np.ndarray
        candidates: np.ndarray

        def predict(self, x):
            return jnp.asarray(x) @ self.weights, jnp.full((x.shape[0], 6), 0.01)

        def log_prior(self, x):
            return -0.5 * jnp.sum(x**2)

    random = np.random.default_rng(1)
    model = Plane(random.normal(size=(2, 6)), random.normal(size=(3, 4, 2)))
    assert isinstance(model, PoseModel)
    u = random.normal(size=(4, 6))
    seen = np.ones((4, 6), bool)
    seen[:, 2] = False
    found = represent(model, measured(u, seen), np.full(6, 0.09), max_steps=100)
    W = model.weights[:, [0, 1, 3, 4, 5]]
    exact = np.linalg.solve(W @ W.T / 0.1 + np.eye(2), W @ u[:, [0, 1, 3, 4, 5]].T / 0.1).T
    assert_allclose(found.x, exact, atol=1e-3)


def test_a_trained_cycle_is_found_again(trained_gait):
    _, ready = trained_gait
    training = ready.training
    y = np.asarray(training.frames.y).reshape(18, 12, 54)[7]
    found = represent(ready.process, measured(y), np.full(54, 0.01))
    assert np.sqrt(np.mean((found.mean - y) ** 2)) < 0.1
    assert_allclose(found.x, np.asarray(ready.process.candidates)[7], atol=0.3)


def test_a_missing_limb_is_told_better_than_by_the_mean(trained_gait, cycle):
    _, ready = trained_gait
    columns = gait.limb_columns(ready, ["lleg"])
    assert columns == ready.training.encoding.columns(["lfemur", "ltibia", "lfoot"])
    pose = gait.reconstruct(ready, gait.hidden(cycle, columns))
    error = np.abs(pose.mean[:, columns] - cycle[:, columns]).mean()
    assert error < 0.45 * np.abs(cycle[:, columns]).mean()
    others = np.setdiff1d(np.arange(54), columns)
    assert_allclose(pose.mean[:, others], cycle[:, others], atol=1e-5)
    assert pose.sd[:, columns].min() > 10 * pose.sd[:, others].max()
    # Its density is that of a smooth continuation: far more than of another leg.
    other = cycle.copy()
    other[:, columns] = np.roll(cycle[:, columns], 6, axis=0)
    ours, theirs = (gait.held_out_density(ready, u, columns) for u in (cycle, other))
    assert ours > theirs + 50.0


def test_the_filter_takes_noise_away_and_finds_its_level(trained_gait, cycle):
    _, ready = trained_gait
    noise = 0.25 * cycle.std(axis=0) * np.random.default_rng(3).normal(size=cycle.shape)
    pose, level = gait.denoise(ready, cycle + noise)
    assert level in (0.2, 0.3)
    left = pose.mean - cycle
    assert np.mean(left**2) < 0.65 * np.mean(noise**2)
    assert np.mean((smoothed(cycle + noise, 7) - cycle) ** 2) < np.mean(noise**2)
    known, at = gait.denoise(ready, cycle + noise, 0.25)
    assert at == 0.25
    inside = np.abs(known.mean - cycle) < 1.645 * known.sd
    assert 0.75 < inside.mean() <= 1.0


def test_the_filter_fills_in_a_limb_that_is_missing(trained_gait, cycle):
    _, ready = trained_gait
    columns = gait.limb_columns(ready, ["larm"])
    noise = 0.2 * cycle.std(axis=0) * np.random.default_rng(7).normal(size=cycle.shape)
    noisy = gait.hidden(cycle + noise, columns)
    pose, level = gait.denoise(ready, noisy)
    assert level in (0.15, 0.2, 0.3)
    noisy[3, 0] = np.nan
    gap, _ = gait.denoise(ready, noisy, level)
    for made in (pose, gap):
        assert np.isfinite(made.sd).all()
        error = np.abs(made.mean[:, columns] - cycle[:, columns]).mean()
        assert error < 0.6 * np.abs(cycle[:, columns]).mean()
    assert abs(gap.mean[3, 0] - cycle[3, 0]) < 3.0 * gap.sd[3, 0]


def test_a_fit_keeps_what_it_knows_of_new_people(trained_gait, tmp_path):
    fit, ready = trained_gait
    fit.save(tmp_path / "torus.nc")
    back = gait.trained_of(load(tmp_path / "torus.nc"))
    for one, other in zip(back.deviation, ready.deviation, strict=True):
        np.testing.assert_array_equal(one, other)


def test_paths_on_the_surface_stride_as_their_radius_says(trained_gait):
    _, ready = trained_gait
    made = {name: gait.along(ready, **path)[0] for name, path in gait.paths(ready, 12).items()}
    swing = {name: y.std(axis=0).mean() for name, y in made.items()}
    assert swing["outer spiral"] > 1.8 * swing["inner spiral"]
    assert made["line"].shape == (24, 54)
    # On the middle layer a path is a training cycle.
    still = np.arange(12.0)
    mean, _ = gait.along(ready, still, np.full(12, 2.0), np.ones(12))
    y = np.asarray(ready.training.frames.y).reshape(3, 6, 12, 54)[1, 2]
    assert np.sqrt(np.mean((mean - y) ** 2)) < 0.35 * np.sqrt(np.mean(y**2))


def test_the_deviation_is_recovered_from_draws():
    random = np.random.default_rng(5)
    C, T, D = 80, 12, 5
    true = some_deviation(random, T, D)
    L = np.linalg.cholesky(wave_matrices(true, T))
    # A stride that people make more or less of; all else alike.
    r = (random.normal(size=(C, T * D)) @ L.T).reshape(C, T, D)
    at = 2 * np.pi * np.arange(T) / T
    stride = np.stack([np.cos(at), np.sin(at)]) / np.sqrt(T / 2)
    scale = np.exp(0.5 * random.normal(size=(C, 1, 1))) - 1.0
    r = r + scale * np.einsum("wt,ws,csd->ctd", stride, stride, r)
    people = tuple(f"p{i // 4}" for i in range(C))
    found = learn_deviation(LeftOver(r, 0.02, people))
    assert_allclose(found.power[[0, 2]], true.power[[0, 2]], rtol=0.5)
    assert_allclose(found.alike[:3], true.alike[:3], atol=0.3)
    assert found.spread[1] >= 0.35
    assert max(found.spread[[0, 3]]) <= 0.25
    assert float(found.usual) == 0.02
    white = white_deviation([1.0, 2.0], 3)
    assert_allclose(wave_matrices(white, 3), np.diag([1.0, 2.0] * 3), atol=1e-12)
    assert_allclose(white.white(3), [1.0, 2.0])


def test_baselines_by_hand():
    random = np.random.default_rng(2)
    y = random.normal(size=(50, 4)) @ np.diag([3.0, 2.0, 0.1, 0.1]) + 1.0
    pca = fit_pca(y, 2)
    seen = np.array([[True, True, False, True]])
    joint = pca.loadings @ pca.loadings.T + pca.noise * np.eye(4)
    known = [0, 1, 3]
    expected = pca.mean + (joint - pca.noise * np.eye(4))[:, known] @ np.linalg.solve(
        joint[np.ix_(known, known)], y[0, known] - pca.mean[known]
    )
    assert_allclose(pca.fill(y[:1], seen)[0], expected, atol=1e-9)
    assert_allclose(nearest_pose(y, y[7:8] + 1e-6, seen)[0], y[7])
    wave = np.sin(2 * np.pi * np.arange(30) / 30)[None, :, None]
    noisy = wave + 0.3 * random.normal(size=wave.shape)
    assert best_window(wave, noisy) >= best_window(wave, wave)
    assert_allclose(smoothed(np.ones((30, 2)), 7), 1.0)


def test_unknown_joints_are_refused(trained_gait):
    with pytest.raises(InputError, match="does not turn"):
        gait.limb_columns(trained_gait[1], ["wing"])
    assert len(gait.moved_joints(gait.limb_columns(trained_gait[1], ["larm"]))) == 2
