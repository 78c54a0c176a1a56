"""What data can tell does not change under what they cannot, and is computed right."""

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from scipy.stats import ortho_group

from bayesmotion.evaluate.identified import identified
from bayesmotion.fit import Fit
from bayesmotion.gp.matrix_normal import GaussianProcess

from .conftest import jnp_values, with_posterior


def test_quantities_are_labelled_and_agree_with_the_model(drawn_fit: Fit):
    found = identified(drawn_fit)
    frames, model = drawn_fit.training.frames, drawn_fit.model
    assert {"gamma", "scale", "step", "gram_subject", "kernel", "log_likelihood"} <= set(found)
    assert found["gram_gait"].dims == ("chain", "draw", "level_gait", "other_gait")
    values = jnp_values(drawn_fit, 2, 7)
    one = found.isel(chain=2, draw=7)
    K = model.covariance(frames, values)
    y = jnp.asarray(frames.y)
    density = GaussianProcess(K, values["scale"]).log_prob(y)
    assert float(one["log_likelihood"]) == pytest.approx(float(density))
    style = values["style_subject"]
    np.testing.assert_allclose(one["gram_subject"], style @ style.T)
    i, j = (int(frame) for frame in str(found["frame_pair"].values[3]).split(","))
    noiseless = K - jnp.eye(len(K)) / values["beta"]
    if frames.clip[i] != frames.clip[j]:
        assert float(one["kernel"][3]) == pytest.approx(float(noiseless[i, j]))
    direction = one["phase_direction"].sel(moving_clip="ben-run").values
    away = values["phase"][-1] - values["phase"][0]
    np.testing.assert_allclose(direction, [np.cos(away), np.sin(away)])


def test_turning_the_latents_of_a_draw_changes_nothing_identified(drawn_gp_fit: Fit):
    random = np.random.default_rng(0)
    posterior = drawn_gp_fit.tree["posterior"].to_dataset().copy(deep=True)
    for draw in range(posterior.sizes["draw"]):
        Q = ortho_group.rvs(3, random_state=random)
        posterior["x"].values[:, draw] = posterior["x"].values[:, draw] @ Q
    turned = with_posterior(drawn_gp_fit, posterior, random)
    here, there = identified(drawn_gp_fit), identified(turned)
    assert "distance" in here
    for name in here:
        np.testing.assert_allclose(here[name], there[name], rtol=1e-6, atol=1e-7, err_msg=name)
    # The raw latents did change: it is not the comparison that is blind.
    before, after = (f.tree["posterior"]["x"].values for f in (drawn_gp_fit, turned))
    assert np.abs(before - after).max() > 0.5


def test_fewer_draws_are_the_same_read_forwards_and_back(drawn_fit: Fit):
    some = identified(drawn_fit, most=20)
    assert 0 < some.sizes["chain"] * some.sizes["draw"] <= 20
    tree = drawn_fit.tree.copy()
    turned = tree["posterior"].to_dataset().isel(draw=slice(None, None, -1))
    tree["posterior"] = xr.DataTree(turned)
    back = identified(Fit(drawn_fit.model, drawn_fit.motion, tree), most=20)
    np.testing.assert_array_equal(back["gamma"].values[:, ::-1], some["gamma"].values)
