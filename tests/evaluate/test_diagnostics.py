"""A sound run is trusted; each way of being unsound is told by its name."""

import json
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import bayesmotion as bm
from bayesmotion.evaluate.diagnostics import Diagnosis, diagnose, r_hat, scalars
from bayesmotion.fit import Fit

from .conftest import draws_around, edited, with_posterior


def problems(fit: Fit) -> str:
    return "; ".join(diagnose(fit).problems)


@pytest.fixture(scope="module")
def independent(cycle_mode) -> Fit:
    """Independent draws about a mode, as a perfect sampler would leave them."""
    return draws_around(cycle_mode, draws=250)


def test_independent_draws_are_trusted(independent):
    found = diagnose(independent)
    assert found.figures["max_r_hat"] < 1.02
    assert found.figures["divergences"] == 0
    assert found.figures["min_ess_bulk"] > 500
    # The worst of several R-hats of independent draws lies near the limit.
    assert found.trusted or found.figures["max_r_hat"] > 1.01
    assert "No step diverged." in found.sentences
    names = [row.name for row in found.quantities]
    assert {"pace", "noise[hip]", "amplitude[knee]", "log_likelihood"} <= set(names)


def test_chains_that_disagree_are_not_trusted(independent):
    apart = edited(independent, "pace", lambda v: v + xr.where(v.chain == 3, 0.2 * v.mean(), 0.0))
    assert "the chains disagree" in problems(apart)
    worst = diagnose(apart).quantities[0]
    assert worst.r_hat is not None
    assert worst.r_hat > 1.5


def test_a_chain_that_stands_still_is_told(independent):
    posterior = independent.tree["posterior"].to_dataset().copy(deep=True)
    for name in posterior.data_vars:
        posterior[name].values[1] = posterior[name].values[1, :1]
    fit = with_posterior(independent, posterior, np.random.default_rng(0))
    fit.tree["sample_stats"]["lp"][1] = 0.0
    assert "nothing moves in chain 1" in problems(fit)


def test_what_the_sampler_met_is_told(independent):
    fit = with_posterior(
        independent, independent.tree["posterior"].to_dataset(), np.random.default_rng(0)
    )
    stats = fit.tree["sample_stats"].to_dataset().copy(deep=True)
    stats["diverging"].values[0, :3] = True
    stats["energy"].values[:] = np.cumsum(stats["energy"].values, axis=1)
    stats["reached_max_treedepth"].values[2, 0] = True
    fit.tree["sample_stats"] = xr.DataTree(stats)
    found = diagnose(fit)
    assert any("3 steps diverged" in text for text in found.problems)
    assert any("E-BFMI" in text for text in found.problems)
    assert any("1 trajectories were cut short" in text for text in found.sentences)
    assert not found.trusted


def relabelled(fit: Fit, method: str) -> Fit:
    """Give a fit as if another method had made it."""
    out = Fit(fit.model, fit.motion, fit.tree.copy(deep=True))
    out.tree.attrs["inference"] = method
    return out


@pytest.mark.parametrize("method", ["map", "em", "fast_marginal", "local"])
def test_a_point_estimate_by_any_method_gets_a_sentence_instead_of_an_r_hat(cycle_mode, method):
    found = diagnose(relabelled(cycle_mode, method))
    assert found.quantities == ()
    assert found.inference == method
    assert f"by {method}" in found.sentences[0]
    assert "no R-hat" in found.sentences[0]
    assert "The search converged." in found.sentences
    assert found.trusted
    stopped = relabelled(cycle_mode, method)
    stopped.tree["sample_stats"]["converged"][:] = False
    stopped.tree["sample_stats"]["steps"][:] = 60
    assert "stopped after 60 steps" in problems(stopped)
    broken = relabelled(cycle_mode, method)
    broken.tree["posterior"]["level"][:] = np.nan
    assert "level is not finite" in problems(broken)


def test_what_a_sampler_of_another_name_drew_is_judged_by_its_chains(independent):
    found = diagnose(relabelled(independent, "mine"))
    assert found.inference == "mine"
    assert "max_r_hat" in found.figures


def test_it_reads_as_the_command_does(independent, tmp_path, run):
    found = diagnose(independent)
    text = str(found)
    assert text == repr(found)
    assert text.splitlines()[0] == found.sentences[0]
    assert f"{found.quantities[0].name}" in text
    assert "bulk ESS" in text
    independent.save(tmp_path / "fit.nc")
    result = run("diagnose", tmp_path / "fit.nc", "--json", tmp_path / "d.json")
    assert result.stdout.startswith(text)
    assert result.exit_code == (0 if found.trusted else 1)
    kept = json.loads((tmp_path / "d.json").read_text())
    assert kept["figures"] == pytest.approx(found.figures)
    assert len(kept["quantities"]) == len(found.quantities)
    html = replace(found, problems=("a < b",))._repr_html_()
    assert "<table" in html
    assert "<li>a &lt; b</li>" in html
    point = repr(Diagnosis("map", sentences=("One.",)))
    assert point == "One.\nNothing speaks against this fit."


def test_a_fitted_model_is_diagnosed_as_it_is(cycle_draws):
    found = bm.diagnose(cycle_draws)
    assert found.figures["max_r_hat"] < 1.05
    assert found.figures["min_ess_bulk"] > 200


def test_walkers_have_no_r_hat(independent):
    fit = with_posterior(
        independent, independent.tree["posterior"].to_dataset(), np.random.default_rng(0)
    )
    fit.tree.attrs |= {
        "inference": "ensemble",
        "acceptance": 0.4,
        "autocorrelation": json.dumps({"level": 12.0, "pace": 30.0}),
        "ess": json.dumps({"level": 2500.0, "pace": 1200.0}),
    }
    found = diagnose(fit)
    assert {row.r_hat for row in found.quantities} == {None}
    assert "no R-hat over them" in found.sentences[0]
    # No more than there are draws, however long the run was.
    assert found.figures == {"autocorrelation_time": 30.0, "min_ess_bulk": 1000.0}
    row = found.quantities[0]
    assert row.mcse == pytest.approx(row.sd / np.sqrt(1000.0))
    assert found.trusted
    fit.tree.attrs["ess"] = json.dumps({"level": 2500.0, "pace": 50.0})
    assert "50 independent draws" in problems(fit)
    fit.tree.attrs["warnings"] = json.dumps(["the run of 90 steps is too short"])
    assert "the run of 90 steps is too short" in problems(fit)


def test_naive_r_hat_and_labels():
    random = np.random.default_rng(0)
    x = xr.DataArray(
        random.normal(size=(2, 200, 2)) + np.array([[[0.0, 0.0]], [[3.0, 0.0]]]),
        dims=("chain", "draw", "axis"),
        coords={"axis": ["a", "b"]},
    )
    found = r_hat(xr.Dataset({"x": x, "fixed": (("chain", "draw"), np.ones((2, 200)))}))
    assert set(found) == {"x[a]", "x[b]"}
    assert found["x[a]"] > 1.5
    assert found["x[b]"] < 1.02
    assert scalars(xr.Dataset({"k": 2.0}))["k"] == pytest.approx(2.0)
