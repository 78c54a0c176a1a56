"""Limbs, clips and futures left out: exact where it can be checked by hand, blind to them."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, norm

from bayesmotion.criticism import folds
from bayesmotion.criticism.blocks import Blocks, block_densities, without
from bayesmotion.criticism.folds import leave_clips_out, leave_limbs_out
from bayesmotion.criticism.future import leave_future_out
from bayesmotion.criticism.limbs import limb_features, limbs
from bayesmotion.errors import InputError
from bayesmotion.fit import Fit
from bayesmotion.inference.draws import stacked
from bayesmotion.motion import concat, split
from bayesmotion.motion.dataset import clips, skeletons
from bayesmotion.priors.dynamics import roll_out

from .conftest import draws_around, jnp_values, with_posterior


def never(motion) -> Fit:
    raise AssertionError("there was no need to fit again")


def conditional(K, y, w, rest, block) -> float:
    """Log density of one column's block given its rest, from the definition."""
    gain = np.linalg.solve(K[np.ix_(rest, rest)], K[np.ix_(rest, block)]).T
    covariance = (K[np.ix_(block, block)] - gain @ K[np.ix_(rest, block)]) / w**2
    return multivariate_normal.logpdf(y[block], gain @ y[rest], (covariance + covariance.T) / 2)


def test_limbs_are_the_chains_between_forks(map_fit: Fit):
    skeleton = next(iter(skeletons(map_fit.motion).values()))
    layout = map_fit.training.encoding.layout
    found = limbs(skeleton, layout)
    assert len(found) == 6
    assert any({"lfemur", "ltibia", "lfoot"} <= set(joints) for joints in found.values())
    every = [joint for joints in found.values() for joint in joints]
    described = {*layout.maps, *(label.split("/")[0] for label in layout.angles)}
    assert sorted(every) == sorted(described - {skeleton.joints[0].name})
    places = limb_features(layout, ("ltibia",))
    assert [layout.labels[i].split("/")[0] for i in places] == ["ltibia"] * len(places)
    assert len(places) == 2


def test_a_limb_left_out_is_conditioned_on_everything_else(map_fit: Fit):
    """Draws that hardly differ need no importance weights, and none of them a new fit."""
    fit = draws_around(map_fit, size=1e-7)
    found = leave_limbs_out(fit, never, only=["lfemur"])
    assert found.n_data_points == 4
    frames, values = fit.training.frames, jnp_values(fit, 0, 0)
    K, y = np.asarray(fit.model.covariance(frames, values)), np.asarray(frames.y)
    encoding = fit.training.encoding
    case = int(np.flatnonzero(found.elpd_i["clip"].values == "ben-walk")[0])
    block = np.flatnonzero(frames.clip == fit.training.clips.index("ben-walk"))
    rest = np.setdiff1d(np.arange(len(K)), block)
    layout, skeleton = encoding.layout, next(iter(skeletons(fit.motion).values()))
    places = limb_features(layout, limbs(skeleton, layout)["lfemur"])
    expected = sum(
        conditional(K, y[:, d], values["scale"][d], rest, block)
        - len(block) * np.log(encoding.spread[d])
        for d in places
        if d < layout.n_angles
    )
    assert float(found.elpd_i[case]) == pytest.approx(float(expected), rel=1e-4)


def test_draws_are_weighted_as_if_the_limb_had_not_been_seen(map_fit: Fit):
    """By hand, without smoothing: weights 1 / p(angles and velocities), score of the angles."""
    fit = draws_around(map_fit, size=3e-3)
    found = leave_limbs_out(fit, never, only=["rfemur"])
    values, shape = stacked(fit)
    layout, clip = fit.training.encoding.layout, np.asarray(fit.training.frames.clip)
    skeleton = next(iter(skeletons(fit.motion).values()))
    left = np.zeros((1, len(layout.labels)))
    left[0, limb_features(layout, limbs(skeleton, layout)["rfemur"])] = 1.0
    scored = left * (np.arange(left.shape[1]) < layout.n_angles)
    assert 0 < scored.sum() < left.sum()
    blocks = Blocks((clip == 1)[None].astype(float), left, scored)
    told, seen = block_densities(fit, fit.training.frames, values, blocks)
    expected = logsumexp(told - seen) - logsumexp(-seen)
    case = int(np.flatnonzero(found.elpd_i["clip"].values == fit.training.clips[1])[0])
    assert float(found.elpd_i[case]) == pytest.approx(float(expected), abs=0.05)
    # It does matter: without weights the score is higher by more than that.
    assert logsumexp(told) - np.log(told.size) > expected + 0.1
    assert np.all(without(seen, shape).k_hat <= found.good_k)


def test_a_point_estimate_is_fitted_again_without_the_limb(map_fit: Fit):
    asked = []

    def refit(motion) -> Fit:
        asked.append(motion)
        return Fit(map_fit.model, motion, map_fit.tree)

    found = leave_limbs_out(map_fit, refit, only=["rfemur"])
    assert len(asked) == found.n_data_points == 4
    hidden = np.isnan(asked[1]["angle"]).any("frame")
    assert set(hidden["dof"].values[hidden]) >= {"rtibia/rx"}
    assert np.isnan(asked[1]["angle"].sel(dof="rtibia/rx")).sum() == 18
    assert np.isfinite(found.elpd)
    assert found.pareto_k is not None
    assert not found.pareto_k.values.any()


def test_the_future_is_what_the_phases_lead_to(map_fit: Fit):
    """By hand: phases go on from the middle of what was seen; frames seen are given."""
    horizon = 4

    def refit(motion) -> Fit:
        assert motion.sizes["frame"] == map_fit.motion.sizes["frame"] - 4 * horizon
        return Fit(map_fit.model, motion, map_fit.tree)

    found = leave_future_out(map_fit, refit, horizon=horizon)
    assert found.n_data_points == 4 * horizon
    other = refit(short(map_fit, horizon))
    encoding, values = other.training.encoding, jnp_values(map_fit, 0, 0)
    y = np.concatenate(
        [encoding.scaled(encoding.features(p, 0.0)) for p in split(map_fit.motion).values()]
    )
    frames = map_fit.training.frames
    # Time is counted from the middle of the frames that were seen.
    whole = dataclasses.replace(frames, time=np.asarray(frames.time) + horizon / 2)
    K = np.asarray(map_fit.model.covariance(whole, values))
    place = np.tile(np.arange(18), 4)
    rest = np.flatnonzero(place < 18 - horizon)
    target = 18 * 2 + 15
    expected = sum(
        conditional(K, y[:, d], values["scale"][d], rest, [target]) - np.log(encoding.spread[d])
        for d in range(encoding.n_angles)
    )
    at = np.flatnonzero(
        (found.elpd_i["clip"].values == "ben-walk") & (found.elpd_i["frame"].values == 15)
    )
    assert float(found.elpd_i[at[0]]) == pytest.approx(float(expected), rel=1e-6)


def short(fit: Fit, horizon: int):
    return concat([p.isel(frame=slice(None, -horizon)) for p in split(fit.motion).values()])


def test_paths_go_on_by_their_dynamics(gp_fit: Fit):
    horizon, place = 3, np.tile(np.arange(18), 4)
    kept = place < 18 - horizon

    def refit(motion) -> Fit:
        posterior = gp_fit.tree["posterior"].to_dataset().isel(frame=kept)
        made = with_posterior(gp_fit, posterior, np.random.default_rng(0))
        return Fit(gp_fit.model, motion, made.tree)

    found = leave_future_out(gp_fit, refit, horizon=horizon)
    # By hand, the last frame of the second clip.
    other = refit(short(gp_fit, horizon))
    past, values = other.training.frames, jnp_values(other, 0, 0)
    given, encoding = gp_fit.model.condition(past, values), other.training.encoding
    assert given.steps is not None
    points = {}
    for name, seen in given.points.items():
        parts = [np.asarray(seen)[np.asarray(past.clip) == c] for c in range(4)]
        if name == "content":
            points[name] = np.concatenate([roll_out(given.steps, x, 18) for x in parts])
        else:
            points[name] = np.repeat([x[0] for x in parts], 18, axis=0)
    frames = gp_fit.training.frames
    K = np.asarray(gp_fit.model.covariance(frames, values, points))
    y = np.concatenate(
        [encoding.scaled(encoding.features(p, 0.0)) for p in split(gp_fit.motion).values()]
    )
    expected = sum(
        conditional(K, y[:, d], values["scale"][d], np.flatnonzero(kept), [35])
        - np.log(encoding.spread[d])
        for d in range(encoding.n_angles)
    )
    assert float(found.elpd_i[2 * horizon - 1]) == pytest.approx(float(expected), rel=1e-5)


def test_few_differing_draws_need_no_new_fit_for_the_future(map_fit: Fit):
    fit = draws_around(map_fit, size=1e-7)
    found = leave_future_out(fit, never, horizon=3)
    assert found.pareto_k is not None
    assert float(found.pareto_k.max()) <= found.good_k
    assert np.isfinite(found.elpd)


def test_a_clip_left_out_is_not_seen_and_is_scored_by_its_forecast(map_fit: Fit, monkeypatch):
    other = Fit(map_fit.model, without_clip(map_fit.motion, "ben-run"), map_fit.tree)
    random = np.random.default_rng(0)
    n = other.training.encoding.n_angles
    mean = random.normal(size=(16, 2 * n + 3))
    sd = random.uniform(0.5, 1.0, size=mean.shape)

    def refit(motion) -> Fit:
        assert clips(motion) == ["ann-walk", "ann-run", "ben-walk"]
        return other

    def forecast(fit, clip, *, given, horizon, max_steps):
        assert fit is other
        assert clips(clip) == ["ben-run"]
        assert (given, horizon) == (10, 6)
        return SimpleNamespace(mean=mean, sd=sd)

    monkeypatch.setattr(folds, "forecast", forecast)
    found = leave_clips_out(map_fit, refit, lengths={"ben-run": (10, 6)})
    true = other.training.encoding.features(split(map_fit.motion)["ben-run"], 0.0)
    expected = norm.logpdf(true[10:16, :n], mean[10:, :n], sd[10:, :n]).sum(axis=1)
    np.testing.assert_allclose(found.elpd_i, expected)
    assert found.elpd_i["frame"].values.tolist() == list(range(10, 16))


def without_clip(motion, clip: str):
    return concat([part for name, part in split(motion).items() if name != clip])


def test_bad_questions_get_a_sentence(map_fit: Fit):
    with pytest.raises(InputError, match="there is none"):
        leave_limbs_out(map_fit, never, only=["tail"])
    with pytest.raises(InputError, match="cannot be left out"):
        leave_clips_out(map_fit, never, lengths={"ben-run": (10, 60)})
    with pytest.raises(InputError, match="the shortest clip has 18 frames"):
        leave_future_out(map_fit, never, horizon=17)
