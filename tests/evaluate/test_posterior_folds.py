"""Clips and futures left out: exact where it can be checked by hand, blind to them."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from bayesmotion.distributions.dynamics import roll_out
from bayesmotion.errors import InputError
from bayesmotion.fit import Fit
from bayesmotion.motion import concat, split
from bayesmotion.motion.dataset import clips
from bayesmotion.prediction import Mixture
from bayesmotion.studies.posterior import folds
from bayesmotion.studies.posterior.folds import leave_clips_out
from bayesmotion.studies.posterior.future import leave_future_out

from .conftest import draws_around, jnp_values, with_posterior


def never(motion) -> Fit:
    raise AssertionError("there was no need to fit again")


def conditional(K, y, w, rest, block) -> float:
    """Log density of one column's block given its rest, from the definition."""
    gain = np.linalg.solve(K[np.ix_(rest, rest)], K[np.ix_(rest, block)]).T
    covariance = (K[np.ix_(block, block)] - gain @ K[np.ix_(rest, block)]) / w**2
    return multivariate_normal.logpdf(y[block], gain @ y[rest], (covariance + covariance.T) / 2)


def seen_to(motion, horizon, encoding) -> np.ndarray:
    """Return the scaled features of whole clips, whose heading is that of the frames seen."""
    return np.concatenate(
        [
            encoding.scaled(
                encoding.features(clip, encoding.heading(clip.isel(frame=slice(-horizon))))
            )
            for clip in split(motion).values()
        ]
    )


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
    y = seen_to(map_fit.motion, horizon, encoding)
    frames = map_fit.training.frames
    # Time is counted from the middle of the frames that were seen.
    whole = dataclasses.replace(frames, time=np.asarray(frames.time) + horizon / 2)
    K = np.asarray(map_fit.model.covariance(whole, values))
    place = np.tile(np.arange(18), 4)
    rest = np.flatnonzero(place < 18 - horizon)
    target = 18 * 2 + 15
    expected = sum(
        conditional(K, y[:, d], values["scale"][d], rest, [target]) - np.log(encoding.sd[d])
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
    trained, encoding = gp_fit.model.condition(past, values), other.training.encoding
    assert trained.steps is not None
    points = {}
    for name, seen in trained.points.items():
        parts = [np.asarray(seen)[np.asarray(past.clip) == c] for c in range(4)]
        if name == "content":
            points[name] = np.concatenate([roll_out(trained.steps, x, 18) for x in parts])
        else:
            points[name] = np.repeat([x[0] for x in parts], 18, axis=0)
    frames = gp_fit.training.frames
    K = np.asarray(gp_fit.model.covariance(frames, values, points))
    y = seen_to(gp_fit.motion, horizon, encoding)
    expected = sum(
        conditional(K, y[:, d], values["scale"][d], np.flatnonzero(kept), [35])
        - np.log(encoding.sd[d])
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

    def forecast(fit, clip, *, context, horizon):
        assert fit is other
        assert clips(clip) == ["ben-run"]
        assert (context, horizon) == (10, 6)
        return SimpleNamespace(mixture=Mixture(mean[None], sd[None], np.ones(1)))

    monkeypatch.setattr(folds, "forecast", forecast)
    found = leave_clips_out(map_fit, refit, lengths={"ben-run": (10, 6)})
    encoding, left_out = other.training.encoding, split(map_fit.motion)["ben-run"]
    true = encoding.features(left_out, encoding.heading(left_out.isel(frame=slice(10))))
    expected = norm.logpdf(true[10:16, :n], mean[10:, :n], sd[10:, :n]).sum(axis=1)
    np.testing.assert_allclose(found.elpd_i, expected)
    assert found.elpd_i["frame"].values.tolist() == list(range(10, 16))


def without_clip(motion, clip: str):
    return concat([part for name, part in split(motion).items() if name != clip])


def test_bad_questions_get_a_sentence(map_fit: Fit):
    with pytest.raises(InputError, match="cannot be left out"):
        leave_clips_out(map_fit, never, lengths={"ben-run": (10, 60)})
    with pytest.raises(InputError, match="the shortest clip has 18 frames"):
        leave_future_out(map_fit, never, horizon=17)
