"""Eq. 15: the poses given what is measured, against brute force and on synthetic walks."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from numpy.testing import assert_allclose

from bayesmotion.errors import InputError
from bayesmotion.fit import load
from bayesmotion.motion.cycles import diversified
from bayesmotion.tasks import gait
from bayesmotion.tasks.latent import LatentPath, PoseModel, infer_path, measured
from bayesmotion.tasks.pose_baselines import best_window, fit_pca, nearest_pose, smoothed
from bayesmotion.tasks.pose_posterior import (
    BANDS,
    LOG_SCALES,
    SubjectResidual,
    pose_given,
    white_residual,
)
from bayesmotion.tasks.subject_residual import Residuals, learn_subject_residual, leave_one_out


@pytest.fixture(scope="module")
def cycle(gait_walks, trained_gait):
    part = gait_walks.isel(frame=gait_walks["subject"].values == "new")
    part = part.assign_coords(frame=np.arange(part.sizes["frame"]))
    return trained_gait[1].training.encoding.scaled(diversified(part, 0.667))


def wave_matrices(residual, t):
    """Covariance (T D, T D) of a residual whose scales are one, wave by wave."""
    at, covariance = np.arange(t), 0.0
    for k in range(t // 2 + 1):
        root = np.sqrt(residual.power[k])
        S = root[:, None] * root * residual.correlation[min(k, 3)]
        for wave in (np.cos(2 * np.pi * k * at / t), np.sin(2 * np.pi * k * at / t)):
            if np.linalg.norm(wave) > 1e-9:
                wave = wave / np.linalg.norm(wave)
                covariance = covariance + np.kron(np.outer(wave, wave), S)
    return covariance


def some_residual(random, t, d, log_scale_sd=0.0):
    A = random.normal(size=(4, d, 2 * d))
    S = A @ A.swapaxes(1, 2)
    size = np.sqrt(np.diagonal(S, axis1=1, axis2=2))
    alike = S / (size[:, :, None] * size[:, None, :])
    power = random.uniform(0.5, 2.0, size=(t // 2 + 1, d))
    return SubjectResidual(power, alike, np.full(len(BANDS), log_scale_sd), np.array(0.1))


@pytest.mark.parametrize("pattern", ["whole columns", "single entries"])
@pytest.mark.parametrize("t", [5, 6])
def test_poses_given_measurements_are_the_conditional_of_everything(pattern, t):
    random = np.random.default_rng(0)
    d = 4
    residual = some_residual(random, t, d)
    variance = random.uniform(size=(t, d))
    found = LatentPath(np.zeros((t, 3)), random.normal(size=(t, d)), variance, 0.0)
    u = random.normal(size=(t, d))
    sd = np.array([0.3, 0.0, 0.5, 0.1])
    seen = np.ones((t, d), bool)
    seen[:, 3] = False
    if pattern == "single entries":
        u[2, 1] = np.nan
    pose = pose_given(found, measured(u, seen, sd), residual)
    above = np.maximum(variance - 0.1, 0.0).mean()
    C = wave_matrices(residual, t) + above * np.eye(t * d)
    known = np.flatnonzero((seen & np.isfinite(u)).ravel())
    S = C[np.ix_(known, known)] + np.diag((np.tile(sd, t) ** 2)[known]) + 1e-8 * np.eye(len(known))
    off = (u - found.mean).ravel()[known]
    gain = np.linalg.solve(S, C[known]).T
    assert_allclose(pose.mean.ravel(), found.mean.ravel() + gain @ off, atol=1e-6)
    left = np.diag(C - gain @ C[known])
    assert_allclose(pose.sd.ravel() ** 2, np.maximum(left, 0.0), atol=1e-6)
    expected = -0.5 * off @ np.linalg.solve(S, off)
    expected -= 0.5 * np.linalg.slogdet(2 * np.pi * S)[1]
    assert pose.log_density == pytest.approx(expected, rel=1e-6)
    # What is exact and seen comes back as it is.
    assert_allclose(pose.mean[[0, 1, 3, 4], 1], u[[0, 1, 3, 4], 1], atol=1e-6)


@pytest.mark.parametrize("t", [5, 6])
def test_every_wave_of_a_cycle_counts_once(t):
    d = 3
    residual = some_residual(np.random.default_rng(6), t, d)
    # The fastest wave of an even number of poses has no sine.
    variance = np.diag(wave_matrices(residual, t)).reshape(t, d).mean(axis=0)
    assert_allclose(residual.white(t), variance)


def test_scales_are_averaged_as_draws_say():
    """Against importance sampling: scales drawn from their prior, weighted by what is seen."""
    random = np.random.default_rng(4)
    t, d = 2, 3
    residual = some_residual(random, t, d, log_scale_sd=0.6)._replace(
        process_variance=np.array(1.0)
    )
    found = LatentPath(np.zeros((t, 3)), np.zeros((t, d)), np.zeros((t, d)), 0.0)
    u = np.array([[2.5, -1.0, 0.0], [1.0, 2.0, 0.0]])
    seen = np.array([[True, True, False]] * t)
    pose = pose_given(found, measured(u, seen, 0.4), residual)
    # A cycle of two poses has two waves: their sum and their difference.
    waves = np.array([[1.0, 1.0], [1.0, -1.0]]) / np.sqrt(2.0)
    z = waves @ u[:, :2]
    scales = np.exp(LOG_SCALES)
    weights = np.exp(-0.5 * (LOG_SCALES / 0.6) ** 2)
    weights /= weights.sum()
    mean, square, log_density = np.zeros(t), np.zeros(t), 0.0
    for k in range(2):
        root = np.sqrt(residual.power[k])
        S = root[:, None] * root * residual.correlation[k]
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
    far = pose_given(found, measured(5.0 * u, seen, 0.4), residual)
    assert (far.sd[:, 2] > 1.5 * pose.sd[:, 2]).all()


def test_any_model_that_predicts_can_be_asked():
    from typing import NamedTuple

    class Plane(NamedTuple):
        weights: np.ndarray
        paths: np.ndarray

        def at(self, x):
            return jnp.asarray(x) @ self.weights, jnp.full((x.shape[0], 6), 0.01)

        def log_bend(self, x):
            return -0.5 * jnp.sum(x**2)

    random = np.random.default_rng(1)
    model = Plane(random.normal(size=(2, 6)), random.normal(size=(3, 4, 2)))
    assert isinstance(model, PoseModel)
    u = random.normal(size=(4, 6))
    seen = np.ones((4, 6), bool)
    seen[:, 2] = False
    found = infer_path(model, measured(u, seen), np.full(6, 0.09), max_steps=100)
    W = model.weights[:, [0, 1, 3, 4, 5]]
    exact = np.linalg.solve(W @ W.T / 0.1 + np.eye(2), W @ u[:, [0, 1, 3, 4, 5]].T / 0.1).T
    assert_allclose(found.x, exact, atol=1e-3)


def test_a_trained_cycle_is_found_again(trained_gait):
    _, ready = trained_gait
    training = ready.training
    y = np.asarray(training.frames.y).reshape(18, 12, 54)[7]
    found = infer_path(ready.draws[0].process, measured(y), np.full(54, 0.01))
    assert np.sqrt(np.mean((found.mean - y) ** 2)) < 0.1
    assert_allclose(found.x, np.asarray(ready.draws[0].process.paths)[7], atol=0.3)


def test_a_missing_limb_is_told_better_than_by_the_mean(trained_gait, cycle):
    _, ready = trained_gait
    columns = gait.limb_columns(ready, ["lleg"])
    assert columns == ready.training.encoding.columns(["lfemur", "ltibia", "lfoot"])
    pose = gait.reconstruct(ready, gait.hidden(cycle, columns))
    mean, sd = pose.means(), pose.sds()
    error = np.abs(mean[:, columns] - cycle[:, columns]).mean()
    assert error < 0.45 * np.abs(cycle[:, columns]).mean()
    others = np.setdiff1d(np.arange(54), columns)
    assert_allclose(mean[:, others], cycle[:, others], atol=1e-5)
    assert sd[:, columns].min() > 10 * sd[:, others].max()
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
    left = pose.means() - cycle
    assert np.mean(left**2) < 0.65 * np.mean(noise**2)
    assert np.mean((smoothed(cycle + noise, 7) - cycle) ** 2) < np.mean(noise**2)
    known, at = gait.denoise(ready, cycle + noise, 0.25)
    assert at == 0.25
    inside = np.abs(known.means() - cycle) < 1.645 * known.sds()
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
        assert np.isfinite(made.sds()).all()
        error = np.abs(made.means()[:, columns] - cycle[:, columns]).mean()
        assert error < 0.6 * np.abs(cycle[:, columns]).mean()
    assert abs(gap.means()[3, 0] - cycle[3, 0]) < 3.0 * gap.sds()[3, 0]


def test_a_fit_keeps_what_it_knows_of_new_people(trained_gait, tmp_path):
    fit, ready = trained_gait
    fit.save(tmp_path / "torus.nc")
    back = gait.trained_of(load(tmp_path / "torus.nc"))
    for one, other in zip(back.residual, ready.residual, strict=True):
        np.testing.assert_array_equal(one, other)


def test_paths_on_the_surface_stride_as_their_radius_says(trained_gait):
    _, ready = trained_gait
    made = {name: gait.along(ready, **path).means() for name, path in gait.paths(ready, 12).items()}
    swing = {name: y.std(axis=0).mean() for name, y in made.items()}
    assert swing["outer spiral"] > 1.8 * swing["inner spiral"]
    assert made["line"].shape == (24, 54)
    # On the middle layer a path is a training cycle.
    still = np.arange(12.0)
    mean = gait.along(ready, still, np.full(12, 2.0), np.ones(12)).means()
    y = np.asarray(ready.training.frames.y).reshape(3, 6, 12, 54)[1, 2]
    assert np.sqrt(np.mean((mean - y) ** 2)) < 0.35 * np.sqrt(np.mean(y**2))


def test_the_residual_is_recovered_from_draws():
    random = np.random.default_rng(5)
    C, T, D = 80, 12, 5
    true = some_residual(random, T, D)
    L = np.linalg.cholesky(wave_matrices(true, T))
    # A stride that people make more or less of; all else alike.
    r = (random.normal(size=(C, T * D)) @ L.T).reshape(C, T, D)
    at = 2 * np.pi * np.arange(T) / T
    stride = np.stack([np.cos(at), np.sin(at)]) / np.sqrt(T / 2)
    scale = np.exp(0.5 * random.normal(size=(C, 1, 1))) - 1.0
    r = r + scale * np.einsum("wt,ws,csd->ctd", stride, stride, r)
    people = tuple(f"p{i // 4}" for i in range(C))
    found = learn_subject_residual(Residuals(r, 0.02, people))
    assert_allclose(found.power[[0, 2]], true.power[[0, 2]], rtol=0.5)
    assert_allclose(found.correlation[:3], true.correlation[:3], atol=0.3)
    assert found.log_scale_sd[1] >= 0.35
    assert max(found.log_scale_sd[[0, 3]]) <= 0.25
    assert float(found.process_variance) == 0.02
    white = white_residual([1.0, 2.0], 3)
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


@pytest.fixture(scope="module")
def many(trained_gait):
    """A fit of five draws: the point estimate's sites, and such as differ from it a little."""
    fit, _ = trained_gait
    posterior, random = fit.tree["posterior"].to_dataset(), np.random.default_rng(2)
    draws = [
        posterior.assign(
            x=posterior["x"] + off * random.normal(size=posterior["x"].shape),
            beta=posterior["beta"] * np.exp(off * random.normal()),
        ).assign_coords(draw=[number])
        for number, off in enumerate((0.0, 0.05, 0.1, 0.1, 0.2))
    ]
    tree = fit.tree.copy()
    tree["posterior"] = xr.DataTree(xr.concat(draws, "draw"))
    return replace(fit, tree=tree)


def reverse(fit):
    tree = fit.tree.copy()
    order = {"draw": slice(None, None, -1)}
    tree["posterior"] = xr.DataTree(tree["posterior"].to_dataset().isel(order))
    return replace(fit, tree=tree)


def test_tasks_average_over_all_draws_whatever_their_order(many, trained_gait, cycle):
    _, first = trained_gait
    ready, turned = gait.trained_of(many), gait.trained_of(reverse(many))
    columns = gait.limb_columns(ready, ["larm"])
    noisy = cycle + 0.1 * cycle.std(axis=0) * np.random.default_rng(1).normal(size=cycle.shape)
    path = gait.paths(ready, 6)["outer spiral"]
    tasks = {
        "interpolate": lambda one: gait.interpolate(one, cycle),
        # What is missing in one pose only asks for no people to be left out anew.
        "reconstruct": lambda one: gait.reconstruct(one, with_gap(cycle, columns)),
        "denoise": lambda one: gait.denoise(one, noisy)[0],
        "along": lambda one: gait.along(one, **path),
    }
    for name, task in tasks.items():
        found, other, alone = task(ready), task(turned), task(first)
        assert found.weight.tolist() == [0.2] * 5
        assert_allclose(other.means(), found.means(), atol=1e-9, err_msg=name)
        assert_allclose(other.sds(), found.sds(), atol=1e-9, err_msg=name)
        # The first draw is that of the point estimate, and not all that is said.
        assert_allclose(found.mean[0], alone.means(), atol=1e-6, err_msg=name)
        assert np.abs(found.means() - alone.means()).max() > 1e-3, name
        assert_allclose(found.means(), found.mean.mean(axis=0), atol=1e-12)
    assert len(gait.trained_of(many, draws=2).draws) == 2


def with_gap(u, columns):
    out = np.array(u)
    out[3:5, columns] = np.nan
    return out


def test_residuals_are_those_of_all_draws(many, trained_gait):
    fit, _ = trained_gait
    training = fit.training
    draws = [many.values(draw=number) for number in (0, 4)]
    both = leave_one_out(fit.model, training, draws).residuals()
    alone = leave_one_out(fit.model, training, draws[1:]).residuals()
    assert both.residual.shape == (36, 12, 54)
    assert_allclose(both.residual[18:], alone.residual)
    assert both.subjects[18:] == alone.subjects == training.subjects * 3
    few = replace(training, subjects=("ann",) * 6)
    with pytest.raises(InputError, match="of 1 people"):
        leave_one_out(fit.model, few, draws)
