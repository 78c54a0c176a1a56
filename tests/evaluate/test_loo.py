"""Leave-one-out in ArviZ's format is what conditioning on the other frames gives."""

import dataclasses

import arviz_plots as azp
import arviz_stats as azs
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from scipy.stats import multivariate_normal

from bayesmotion.errors import InputError
from bayesmotion.evaluate.loo import elpd_of_points, leave_one_out, pareto_smoothed
from bayesmotion.fit import Fit
from bayesmotion.gp.matrix_normal import GaussianProcess, patterns
from bayesmotion.models.multifactor.frames import frames_of

from .conftest import draws_around, jnp_values


def first_features(fit: Fit) -> list[str]:
    return list(fit.training.encoding.layout.labels[:6])


@pytest.fixture(scope="module")
def tree(map_fit):
    return leave_one_out(draws_around(map_fit, size=1e-3), seed=0)


def test_a_frame_left_out_is_conditioned_on_the_others(drawn_fit: Fit):
    tree = leave_one_out(drawn_fit)
    frames, values = drawn_fit.training.frames, jnp_values(drawn_fit, 3, 0)
    K, y = np.asarray(drawn_fit.model.covariance(frames, values)), np.asarray(frames.y)
    t = 20
    rest = np.setdiff1d(np.arange(len(K)), [t])
    gain = np.linalg.solve(K[np.ix_(rest, rest)], K[rest, t])
    variance = (K[t, t] - gain @ K[rest, t]) / np.asarray(values["scale"]) ** 2
    expected = multivariate_normal.logpdf(y[t], gain @ y[rest], np.diag(variance))
    found = tree["log_likelihood"]["y"].isel(chain=3, draw=0, point=t)
    assert float(found) == pytest.approx(expected, rel=1e-6)
    assert str(found["clip"].values) == drawn_fit.training.clips[frames.clip[t]]


def test_it_is_what_the_model_says_of_data_without_the_frame(drawn_fit: Fit):
    """The program's own missing data give the same: log p(Y) - log p(Y without frame t)."""
    model, frames = drawn_fit.model, drawn_fit.training.frames
    values = jnp_values(drawn_fit, 0, 0)
    y, t = np.array(frames.y), 33
    parts = {name: y[frames.clip == c] for c, name in enumerate(drawn_fit.training.clips)}
    labels = {f: {c: str(v) for c, v in enumerate(frames.level[f])} for f in ("subject", "gait")}
    by_clip = {
        f: dict(zip(drawn_fit.training.clips, v.values(), strict=True)) for f, v in labels.items()
    }
    known = {f: ["0", "1"] for f in by_clip}
    y[t] = np.nan
    rest = {name: y[frames.clip == c] for c, name in enumerate(parts)}
    without = frames_of(rest, by_clip, known, frame_rate=float(frames.frame_rate))

    def density(data) -> float:
        K = model.covariance(data, values)
        outputs = GaussianProcess(K, values["scale"], None, data.missing)
        return float(outputs.log_prob(jnp.asarray(data.y)))

    found = leave_one_out(drawn_fit)["log_likelihood"]["y"]
    expected = density(frames) - density(without)
    assert float(found[0, 0, t]) == pytest.approx(expected, rel=1e-6)


def test_arviz_works_on_it(tree):
    result = azs.loo(tree, pointwise=True)
    assert result.n_data_points == tree["log_likelihood"].sizes["point"]
    assert np.isfinite(result.elpd)
    assert azp.plot_khat(result, backend="none") is not None
    table = azs.compare({"a": tree, "b": tree.copy()})
    assert table["elpd_diff"].abs().max() == 0.0


def test_loo_pit_is_uniform_for_data_of_the_model_and_not_for_others(map_fit: Fit):
    """Data drawn from the model itself; then with the noise thought five times as large."""
    random = np.random.default_rng(0)
    fit = drawn_from_model(map_fit, random)
    right = leave_one_out(fit, by="entry", features=first_features(fit), seed=0)
    pit = azs.loo_pit(right)["y"].values
    wide = right.copy()
    predictive = wide["posterior_predictive"].to_dataset()
    mean = predictive["y"].mean(("chain", "draw"))
    wide["posterior_predictive"] = wide["posterior_predictive"].assign(
        y=mean + 5.0 * (predictive["y"] - mean)
    )
    wrong = azs.loo_pit(wide)["y"].values
    assert pit.shape == (6 * len(fit.training.frames.clip),)

    def unlike_uniform(values: np.ndarray) -> float:
        grid = np.linspace(0, 1, 51)
        share = np.mean(values[:, None] <= grid, axis=0)
        return float(np.abs(share - grid).max())

    # Entries are correlated, so the bound is wider than that of independent values.
    assert unlike_uniform(pit) < 2.5 / np.sqrt(len(pit))
    assert unlike_uniform(wrong) > 0.2


def drawn_from_model(fit: Fit, random: np.random.Generator) -> Fit:
    """Give a fit whose data are a draw of its own model, at its own parameters."""
    training, values = fit.training, jnp_values(fit, 0, 0)
    K = np.asarray(fit.model.covariance(training.frames, values))
    white = random.normal(size=training.frames.y.shape)
    y = np.linalg.cholesky(K) @ white / np.asarray(values["scale"])
    return with_frames(draws_around(fit, size=1e-3), y=y)


def with_frames(fit: Fit, **changed) -> Fit:
    """Give a fit with other training data, and the same draws."""
    made = Fit(fit.model, fit.motion, fit.tree)
    frames = dataclasses.replace(fit.training.frames, **changed)
    made.__dict__["training"] = dataclasses.replace(fit.training, frames=frames)
    return made


def test_entries_not_seen_are_no_points(map_fit: Fit):
    seen = np.ones(map_fit.training.frames.y.shape, bool)
    seen[5:9, 2] = False
    seen[30] = False
    y = np.where(seen, map_fit.training.frames.y, 0.0)
    draws = draws_around(map_fit, size=1e-3)
    fit = with_frames(draws, y=y, missing=patterns(seen))
    tree = leave_one_out(fit, by="entry", features=first_features(fit), most=4, seed=0)
    assert tree["log_likelihood"].sizes["point"] == seen[:, :6].sum()
    assert np.isfinite(tree["log_likelihood"]["y"].values).all()
    frames = leave_one_out(fit, seed=0)
    assert 30 not in frames["log_likelihood"]["frame"].values
    assert np.isfinite(azs.loo(frames).elpd)


def test_a_point_estimate_has_scores_without_k_hat(map_fit: Fit, drawn_fit: Fit):
    result = elpd_of_points(map_fit)
    assert result.pareto_k is None
    assert result.n_samples == 1
    noisy = elpd_of_points(draws_around(map_fit, size=1e-4))
    # Draws that hardly differ say the same.
    assert result.elpd == pytest.approx(noisy.elpd, abs=0.01 * abs(noisy.elpd))


def test_unknown_features_are_refused(map_fit: Fit):
    with pytest.raises(InputError, match="none of this name"):
        leave_one_out(map_fit, by="entry", features=["tail/rx"], seed=0)
    with pytest.raises(InputError, match="by='entry'"):
        leave_one_out(map_fit, features=first_features(map_fit))


def test_chains_that_stand_still_leave_nothing_out(tree):
    still = tree.copy()
    density = tree["log_likelihood"].to_dataset()
    still["log_likelihood"] = xr.DataTree(density.isel(draw=[0] * density.sizes["draw"]))
    with pytest.raises(InputError, match="one and the same"):
        pareto_smoothed(still)
