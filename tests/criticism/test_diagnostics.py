"""A sound run is trusted; each way of being unsound is told by its name."""

import json

import numpy as np
import pytest
import xarray as xr

from bayesmotion.criticism.diagnostics import diagnose, r_hat, scalars
from bayesmotion.fit import Fit

from .conftest import draws_around, edited, with_posterior


def problems(fit: Fit) -> str:
    return "; ".join(diagnose(fit).problems)


def test_independent_draws_are_trusted(map_fit):
    found = diagnose(draws_around(map_fit, draws=250))
    assert found.figures["max_r_hat"] < 1.02
    assert found.figures["divergences"] == 0
    assert found.figures["min_ess_bulk"] > 500
    # The worst of two hundred R-hats of independent draws lies near the limit.
    assert found.trusted or found.figures["max_r_hat"] > 1.01
    assert "No step diverged." in found.sentences
    names = [row.name for row in found.quantities]
    assert "gamma" in names
    assert "step[ann-run]" in names
    # The first level's length is one by definition; it has no R-hat.
    assert "gram_subject[ann; ann]" not in names


def test_chains_that_disagree_are_not_trusted(drawn_fit):
    apart = edited(drawn_fit, "gamma", lambda v: v + xr.where(v.chain == 3, 0.2 * v.mean(), 0.0))
    assert "the chains disagree" in problems(apart)
    worst = diagnose(apart).quantities[0]
    assert worst.r_hat is not None
    assert worst.r_hat > 1.5


def test_a_chain_that_stands_still_is_told(drawn_fit):
    posterior = drawn_fit.tree["posterior"].to_dataset().copy(deep=True)
    for name in posterior.data_vars:
        posterior[name].values[1] = posterior[name].values[1, :1]
    fit = with_posterior(drawn_fit, posterior, np.random.default_rng(0))
    fit.tree["sample_stats"]["lp"][1] = 0.0
    assert "nothing moves in chain 1" in problems(fit)


def test_what_the_sampler_met_is_told(drawn_fit):
    fit = with_posterior(
        drawn_fit, drawn_fit.tree["posterior"].to_dataset(), np.random.default_rng(0)
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


def test_a_point_estimate_gets_a_sentence_instead_of_an_r_hat(map_fit):
    found = diagnose(map_fit)
    assert found.quantities == ()
    assert "no R-hat" in found.sentences[0]
    assert found.trusted
    stopped = Fit(map_fit.model, map_fit.motion, map_fit.tree.copy(deep=True))
    stopped.tree["sample_stats"]["converged"][:] = False
    assert "stopped after 60 steps" in problems(stopped)


def test_walkers_have_no_r_hat(drawn_fit):
    fit = with_posterior(
        drawn_fit, drawn_fit.tree["posterior"].to_dataset(), np.random.default_rng(0)
    )
    fit.tree.attrs |= {
        "inference": "ensemble",
        "acceptance": 0.4,
        "autocorrelation": json.dumps({"gamma": 12.0, "step": 30.0}),
        "ess": json.dumps({"gamma": 2500.0, "step": 1000.0}),
    }
    found = diagnose(fit)
    assert {row.r_hat for row in found.quantities} == {None}
    assert "no R-hat over them" in found.sentences[0]
    # No more than there are draws, however long the run was.
    assert found.figures == {"autocorrelation_time": 30.0, "min_ess_bulk": 400.0}
    row = found.quantities[0]
    assert row.mcse == pytest.approx(row.sd / 20.0)
    assert found.trusted
    fit.tree.attrs["ess"] = json.dumps({"gamma": 2500.0, "step": 50.0})
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
