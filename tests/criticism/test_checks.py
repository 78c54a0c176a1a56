"""Drawn motions are measured right, look like the recorded ones, and tell a broken model."""

import numpy as np
import pytest
import xarray as xr

from bayesmotion.criticism.checks import predictive_check, prior_sensitivity, statistics
from bayesmotion.errors import InputError
from bayesmotion.fit import Fit
from bayesmotion.motion.synthetic import synthetic_truth

from .conftest import edited, with_posterior


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


def test_replicated_clips_are_like_the_recorded_and_broken_ones_are_not(drawn_fit: Fit):
    good = predictive_check(drawn_fit, "posterior", draws=4, seed=0)
    assert dict(good.drawn.sizes) | {"statistic": 0} == {"draw": 4, "clip": 4, "statistic": 0}
    table = good.table()
    assert table.loc["period", "50 %"] == pytest.approx(table.loc["period", "recorded"], rel=0.1)
    assert table.loc["speed", "50 %"] == pytest.approx(table.loc["speed", "recorded"], rel=0.1)
    # A hundred times the noise makes feet slide more than those recorded, in every draw.
    noisy = edited(drawn_fit, "beta", lambda v: v / 1e4)
    broken = predictive_check(noisy, "posterior", draws=4, seed=0).table()
    assert broken.loc["foot sliding", "below"] == 0.0
    assert broken.loc["foot sliding", "5 %"] > 2 * table.loc["foot sliding", "95 %"]


def test_motions_can_be_drawn_from_the_prior(map_fit: Fit):
    check = predictive_check(map_fit, "prior", draws=3, seed=1)
    again = predictive_check(map_fit, "prior", draws=3, seed=1)
    np.testing.assert_array_equal(check.drawn, again.drawn)
    assert np.isfinite(check.drawn.values).all()
    # The prior knows no one: its draws differ far more than clips of people do.
    spread = check.drawn.sel(statistic="speed").std("draw").mean()
    recorded = check.recorded.sel(statistic="speed").std()
    assert float(spread) > float(recorded)


def test_a_narrow_prior_is_felt(drawn_fit: Fit):
    """By hand: a prior that the draws of gamma follow, data that tell beta alone."""
    posterior = drawn_fit.tree["posterior"].to_dataset()
    fit = with_posterior(drawn_fit, posterior, np.random.default_rng(0))

    def narrow(name: str) -> xr.DataArray:
        log = np.log(posterior[name])
        return -0.5 * ((log - log.mean()) / log.std()) ** 2

    fit.tree["log_prior"] = xr.DataTree(xr.Dataset({"gamma": narrow("gamma")}))
    told = narrow("beta").expand_dims(part=1, axis=2)
    fit.tree["log_likelihood"] = xr.DataTree(xr.Dataset({"y": told}))
    table = prior_sensitivity(fit)
    assert table.loc["gamma", "prior"] > 0.08
    assert table.loc["gamma", "likelihood"] < 0.05
    assert table.loc["beta", "prior"] < 0.05
    assert table.loc["beta", "likelihood"] > 0.08


def test_what_cannot_be_checked_is_told(map_fit: Fit, walkers):
    with pytest.raises(InputError, match=r"log_likelihood|one draw"):
        prior_sensitivity(map_fit)
    unknown = walkers.isel(frame=walkers["clip"].values == "ann-walk")
    text = unknown.attrs["skeletons"].replace('"metres": 1.0', '"metres": null')
    with pytest.raises(InputError, match="how long its unit is"):
        statistics(unknown.assign_attrs(skeletons=text))
