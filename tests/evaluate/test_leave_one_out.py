"""Leave-one-out of a model written from the page: ArviZ's format, NaN, PIT, refits."""

from dataclasses import dataclass

import arviz_plots as azp
import arviz_stats as azs
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from scipy.stats import norm

import bayesmotion as bm
from bayesmotion.errors import InputError
from bayesmotion.evaluate.held_out import refit_of
from bayesmotion.evaluate.loo import elpd_of_points, leave_one_out
from bayesmotion.evaluate.sbc.uniformity import p_value
from bayesmotion.fit import Fit

from .conftest import draws_around


@pytest.fixture(scope="module")
def entries_fit(mean_cycle, cycle_draws) -> Fit:
    """A fit of a model that tells its entries apart; its data are a draw of it."""

    @dataclass(frozen=True)
    class WithEntries(mean_cycle):
        def entries(self, data, values):
            mean = self._mean(self.condition(data, values), values["pace"] * data.frame)
            return mean, jnp.broadcast_to(values["noise"] ** 2, mean.shape)

    return Fit(WithEntries(), cycle_draws.motion, cycle_draws.tree)


def test_a_point_has_the_density_of_its_entries(cycle_draws):
    found = leave_one_out(cycle_draws)["log_likelihood"]["y"].isel(chain=1, draw=7)
    values = cycle_draws.values(1, 7)
    theta = values["pace"] * 21.0
    mean = values["level"] + np.cos(theta) * values["cosine"] + np.sin(theta) * values["sine"]
    y = cycle_draws.motion["y"].values[21]
    # The second entry of frame 21 was not seen.
    expected = norm.logpdf(y[0], mean[0], values["noise"][0])
    assert float(found.isel(point=21)) == pytest.approx(expected, rel=1e-9)
    assert 41 not in found["frame"].values


def test_arviz_works_on_the_tree_of_a_fit(cycle_draws):
    result = azs.loo(cycle_draws.tree, pointwise=True)
    assert result.n_data_points == 59
    assert result.elpd == pytest.approx(elpd_of_points(cycle_draws).elpd, rel=1e-3)
    assert azp.plot_khat(result, backend="none") is not None
    table = azs.compare({"a": cycle_draws.tree, "b": cycle_draws.tree.copy()})
    assert table["elpd_diff"].abs().max() == 0.0


def test_a_point_estimate_has_scores_without_k_hat(cycle_mode):
    result = elpd_of_points(cycle_mode)
    assert result.pareto_k is None
    assert result.n_samples == 1
    noisy = elpd_of_points(draws_around(cycle_mode, size=1e-4))
    # Draws that hardly differ say the same.
    assert result.elpd == pytest.approx(noisy.elpd, abs=0.01 * abs(noisy.elpd))


def test_loo_pit_is_uniform_for_data_of_the_model_and_not_for_others(entries_fit):
    right = leave_one_out(entries_fit, by="entry", seed=0)
    seen = int(np.isfinite(entries_fit.motion["y"].values).sum())
    assert right["log_likelihood"].sizes["point"] == seen
    wide = right.copy()
    predictive = wide["posterior_predictive"].to_dataset()
    mean = predictive["y"].mean(("chain", "draw"))
    wide["posterior_predictive"] = xr.DataTree(
        predictive.assign(y=mean + 5.0 * (predictive["y"] - mean))
    )
    p = [p_value(np.minimum((azs.loo_pit(tree)["y"].values * 21).astype(int), 20), 21)
         for tree in (right, wide)]  # fmt: skip
    assert p[0] > 1e-3
    assert p[1] < 1e-3


def test_what_is_not_told_apart_is_refused(cycle_draws, entries_fit):
    with pytest.raises(InputError, match="does not leave single entries out"):
        leave_one_out(cycle_draws, by="entry")
    with pytest.raises(InputError, match="none of this name"):
        leave_one_out(entries_fit, by="entry", features=["tail"])


@pytest.mark.filterwarnings("ignore:the fit stopped")
def test_a_refit_is_made_as_the_fit_was(mean_cycle):
    model, recordings = mean_cycle.example()
    first = bm.fit(model, recordings, method=bm.MAP(initial=2, keep=1, max_steps=7), seed=5)
    again = refit_of(first)(recordings)
    xr.testing.assert_identical(again.tree["posterior"].ds, first.tree["posterior"].ds)
    assert again.tree.attrs["settings"] == first.tree.attrs["settings"]
