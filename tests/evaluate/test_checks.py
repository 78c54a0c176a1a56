"""Drawn outcomes are measured right, look like the recorded ones, and tell a broken model."""

from dataclasses import dataclass

import arviz_plots as azp
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

import bayesmotion as bm
from bayesmotion.errors import InputError
from bayesmotion.evaluate.checks import (
    Check,
    predictive_check,
    predictive_groups,
    prior_sensitivity,
)
from bayesmotion.evaluate.motion_statistics import period, statistics
from bayesmotion.fit import Fit
from bayesmotion.model import MotionData
from bayesmotion.motion.synthetic.walkers import synthetic_truth, synthetic_walkers


def changed(fit: Fit, name: str, change) -> Fit:
    """Give a fit with one site's draws changed."""
    tree = fit.tree.copy(deep=True)
    posterior = tree["posterior"].to_dataset()
    posterior[name] = change(posterior[name])
    tree["posterior"] = xr.DataTree(posterior)
    return Fit(fit.model, fit.motion, tree)


def test_the_measures_are_those_of_a_known_walker():
    truth = synthetic_truth(("ann",), ("walk",), seconds=4.0, frame_rate=30.0)
    clip = truth.motion
    found = statistics(clip)
    assert found["period"] == pytest.approx(2 * np.pi / (truth.step.item() * 30.0), rel=0.03)
    path = clip["root_position"].values
    length = np.linalg.norm(path[-1, [0, 2]] - path[0, [0, 2]])
    assert found["speed"] == pytest.approx(length / (119 / 30.0), rel=0.03)
    # The walker is made so that the foot that carries it stands still.
    assert found["foot sliding"] < 0.2 * found["speed"]
    knee = clip["angle"].sel(dof="ltibia/rx")
    assert found["range ltibia/rx"] == pytest.approx(np.degrees(np.ptp(knee.values)))
    skating = clip.assign(root_position=2.0 * clip["root_position"])
    assert statistics(skating)["foot sliding"] > 0.5 * found["speed"]


def test_frames_that_are_missing_change_the_measures_little():
    clip = synthetic_walkers(("ann",), ("walk",), seconds=4.0, frame_rate=30.0)
    gap = clip.copy(deep=True)
    gap["angle"][40:44] = np.nan
    whole, found = statistics(clip), statistics(gap)
    assert set(found) == set(whole)
    for name in ("period", "foot sliding", "speed", "range ltibia/rx"):
        assert found[name] == pytest.approx(whole[name], rel=0.1), name
    nothing = gap.assign(angle=gap["angle"] * np.nan)
    lost = statistics(nothing)
    assert np.isnan(lost["period"])
    assert np.isnan(lost["foot sliding"])
    assert lost["speed"] == pytest.approx(whole["speed"])


def test_a_period_is_found_across_turns_and_gaps():
    angle = np.sin(2 * np.pi / 24.0 * np.arange(120))[:, None] * [1.0, 0.2]
    angle[50:54] = np.nan
    assert period(angle, 24.0) == pytest.approx(1.0, rel=0.03)


def test_replicates_are_like_the_recorded_and_those_of_a_broken_model_are_not(cycle_draws):
    good = predictive_check(cycle_draws, "posterior", draws=100, seed=0)
    # At most a hundred, the same of each of four chains, and the same read backwards.
    assert dict(good.drawn.sizes) == {"draw": 96, "clip": 1, "statistic": 5}
    below = good.table()["below"]
    assert below.between(0.005, 0.995).all(), below
    # Noise three times as large as it is: rows change more than those recorded, in every draw.
    noisy = changed(cycle_draws, "noise", lambda v: 3.0 * v)
    broken = predictive_check(noisy, "posterior", draws=100, seed=0).table()
    assert broken.loc["y change", "below"] == 0.0


def test_recorded_and_drawn_are_measured_on_the_same_entries(cycle_draws):
    """A missing entry counts neither as a zero nor as what was drawn for it."""
    check = predictive_check(cycle_draws, "posterior", draws=8, seed=0)
    y = cycle_draws.motion["y"].values
    mean = check.recorded.sel(statistic="y mean").item()
    assert mean == pytest.approx(np.nanmean(y))
    far = changed(cycle_draws, "level", lambda v: v + 100.0)
    drawn = predictive_check(far, "posterior", draws=8, seed=0).drawn
    assert float(drawn.sel(statistic="y mean").mean()) == pytest.approx(np.nanmean(y) + 100, abs=1)


def test_the_order_of_draws_changes_no_replicate(cycle_draws):
    backwards = Fit(cycle_draws.model, cycle_draws.motion, cycle_draws.tree.copy())
    posterior = cycle_draws.tree["posterior"].to_dataset().isel(draw=slice(None, None, -1))
    backwards.tree["posterior"] = xr.DataTree(posterior)
    one, other = (
        predictive_check(fit, "posterior", draws=40, seed=3) for fit in (cycle_draws, backwards)
    )
    np.testing.assert_allclose(one.table(), other.table(), rtol=1e-9)


def test_prior_draws_are_those_of_the_prior(cycle_draws):
    """Of y_nd the mean is 0; its variance 4 + 4 / 2 (1 + 1) / 2 + 1: by hand, from the program."""
    tree = predictive_groups(cycle_draws, ("prior",), draws=2000, seed=1)
    y = tree["prior_predictive"]["y"].values[0].reshape(2000, -1)
    variance = 4.0 + 4.0 + 1.0
    # Entries of a draw share level and waves: a draw counts once.
    error = np.sqrt(2.0 / 2000) * variance * 2.0
    assert abs(y[:, 7].var() - variance) < 4.0 * error
    assert abs(y[:, 7].mean()) < 4.0 * np.sqrt(variance / 2000)
    level = tree["prior"]["level"].values
    assert level.shape == (1, 2000, 2)
    assert abs(level.std() - 2.0) < 4.0 * 2.0 / np.sqrt(2 * 4000)
    again = predictive_groups(cycle_draws, ("prior",), draws=2000, seed=1)
    xr.testing.assert_identical(again["prior"].ds, tree["prior"].ds)
    check = predictive_check(cycle_draws, "prior", draws=200, seed=1)
    # The prior knows nothing: its draws differ far more than a posterior's.
    posterior = predictive_check(cycle_draws, "posterior", draws=200, seed=1)
    wide, narrow = (c.drawn.sel(statistic="y mean").std() for c in (check, posterior))
    assert float(wide) > 10.0 * float(narrow)


def test_a_point_estimate_is_checked_by_many_outcomes_of_its_one_draw(cycle_mode):
    check = predictive_check(cycle_mode, "posterior", draws=50, seed=0)
    assert check.drawn.sizes["draw"] == 50
    assert float(check.drawn.sel(statistic="y sd").std()) > 0.0
    assert check.table()["below"].between(0.005, 0.995).all()
    assert "posterior predictive check, 50 draws" in repr(check)
    tree = predictive_groups(cycle_mode, ("posterior",), draws=7)
    assert tree["posterior_predictive"].sizes["draw"] == 7
    assert "<table" in check._repr_html_()


@pytest.fixture(scope="module")
def entries_fit(mean_cycle, cycle_draws) -> Fit:
    """The same fit, of a model that tells its entries apart."""

    @dataclass(frozen=True)
    class WithEntries(mean_cycle):
        def entries(self, data, values):
            mean = self._mean(self.condition(data, values), values["pace"] * data.frame)
            return mean, jnp.broadcast_to(values["noise"] ** 2, mean.shape)

    return Fit(WithEntries(), cycle_draws.motion, cycle_draws.tree)


def test_arviz_draws_the_groups(cycle_draws, entries_fit):
    tree = predictive_groups(cycle_draws, draws=50, seed=0)
    assert tree["posterior_predictive"]["y"].dims == ("chain", "draw", "frame", "feature")
    assert list(tree["prior_predictive"]["feature"].values) == ["hip", "knee"]
    assert set(tree["prior"].data_vars) == set(tree["posterior"].data_vars)
    # The fit itself keeps what it had.
    assert "prior" not in cycle_draws.tree.children
    assert azp.plot_ppc_dist(tree, num_samples=20, backend="none") is not None
    shown = azp.plot_ppc_dist(tree, group="prior_predictive", num_samples=20, backend="none")
    assert shown is not None
    assert azp.plot_prior_posterior(tree, backend="none") is not None
    left = bm.leave_one_out(entries_fit, by="entry", seed=0)
    assert azp.plot_loo_pit(left, backend="none") is not None
    assert azp.plot_ecdf_pit(_pits(left), backend="none") is not None


def _pits(tree: xr.DataTree) -> xr.DataTree:
    """Put LOO-PIT values where `plot_ecdf_pit` looks for them."""
    import arviz_stats as azs

    values = azs.loo_pit(tree)["y"].values
    assert np.all((values >= 0.0) & (values <= 1.0))
    return xr.DataTree.from_dict(
        {"prior_sbc": xr.Dataset({"y": (("chain", "draw"), values[None])}, {"chain": [0]})}
    )


def test_a_kind_that_is_none_is_refused(cycle_mode):
    with pytest.raises(InputError, match="no such check"):
        predictive_check(cycle_mode, "after")


@pytest.fixture(scope="module")
def walk_fit(mean_cycle_module) -> Fit:
    walk = synthetic_walkers(("ann",), ("walk",), seconds=2.0, frame_rate=20.0)
    names = [str(dof) for dof in walk["dof"].values]

    @dataclass(frozen=True)
    class WalkData(mean_cycle_module.CycleData):
        def to_motion(self, values):
            return walk.assign(angle=(("frame", "dof"), values["y"]))

    @dataclass(frozen=True)
    class Walk(mean_cycle_module.MeanCycle):
        def prepare(self, recordings, trained=None):
            data = super().prepare(recordings, trained)
            return WalkData(data.cycle, data.features)

    y = xr.Dataset({"y": (("frame", "feature"), walk["angle"].values)}, {"feature": names})
    y["y"][11:13, 4] = np.nan
    return bm.fit(Walk(), y, method=bm.MAP(initial=1, keep=1, max_steps=300), seed=0)


@pytest.mark.filterwarnings("ignore:the fit stopped")
def test_outcomes_that_can_be_made_motions_are_measured_as_such(walk_fit):
    assert isinstance(walk_fit.training, MotionData)
    check = predictive_check(walk_fit, "posterior", seed=0)
    names = set(check.recorded["statistic"].values)
    assert {"period", "foot sliding", "speed", "range ltibia/rx", "y mean"} <= names
    table = check.table()
    for name in ("period", "speed"):
        assert table.loc[name, "50 %"] == pytest.approx(table.loc[name, "recorded"], rel=0.1)


def test_a_narrow_prior_is_felt(cycle_draws):
    """By hand: a prior that the draws of pace follow, data that tell the first noise alone."""
    posterior = cycle_draws.tree["posterior"].to_dataset()
    fit = Fit(cycle_draws.model, cycle_draws.motion, cycle_draws.tree.copy())

    def narrow(draws: xr.DataArray) -> xr.DataArray:
        log = np.log(draws)
        return (-0.5 * ((log - log.mean()) / log.std()) ** 2).drop_vars("feature", errors="ignore")

    fit.tree["log_prior"] = xr.DataTree(xr.Dataset({"pace": narrow(posterior["pace"])}))
    told = narrow(posterior["noise"].isel(feature=0))
    fit.tree["joint_log_likelihood"] = xr.DataTree(xr.Dataset({"y": told}))
    table = prior_sensitivity(fit)
    assert table.loc["pace", "prior"] > 0.08
    assert table.loc["pace", "likelihood"] < 0.05
    assert table.loc["noise[hip]", "prior"] < 0.05
    assert table.loc["noise[hip]", "likelihood"] > 0.08


def test_sensitivity_needs_draws(cycle_mode):
    with pytest.raises(InputError, match="one draw"):
        prior_sensitivity(cycle_mode)


def test_rows_of_different_clips_are_not_compared(mean_cycle, cycle_mode):
    """A step of level between clips is no change from row to row."""

    @dataclass(frozen=True)
    class TwoClips(mean_cycle):
        def points(self, data):
            return {**super().points(data), "clip": ("point", np.repeat(["a", "b"], 30))}

    apart = cycle_mode.motion.copy(deep=True)
    apart["y"][30:] += 50.0
    one, other = (
        predictive_check(Fit(kind(), apart, cycle_mode.tree), "posterior").recorded
        for kind in (mean_cycle, TwoClips)
    )
    assert other["clip"].values.tolist() == ["a", "b"]
    assert one.sel(statistic="y change").max() > 5.0
    assert other.sel(statistic="y change").max() < 1.0


def test_a_check_without_clips_is_of_all_rows(cycle_mode):
    check = predictive_check(cycle_mode, "posterior", seed=0)
    assert isinstance(check, Check)
    assert check.recorded["clip"].values.tolist() == ["all"]
