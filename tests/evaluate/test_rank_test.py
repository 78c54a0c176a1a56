"""What ranks say: p-values, and the power of so many simulations; calibration of any model."""

import json
from dataclasses import asdict
from typing import NamedTuple

import arviz_plots as azp
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from numpyro import distributions as dist

from bayesmotion.errors import InputError
from bayesmotion.evaluate.sbc import calibration
from bayesmotion.evaluate.sbc.calibration import calibrate, calibrate_case
from bayesmotion.evaluate.sbc.chains import Chains
from bayesmotion.evaluate.sbc.controls import FAULTS, Faults, narrowed, noisier, shifted
from bayesmotion.evaluate.sbc.rank_test import power, rank_test, summary
from bayesmotion.evaluate.sbc.uniformity import p_value
from bayesmotion.model import SBCCase, lagged

SHORT = Chains(warmup=100, draws=20, thin=2, depth=4)


def ranked(ranks: np.ndarray) -> xr.DataTree:
    """Give ranks (simulation, quantity) in 0..20 as a calibration leaves them."""
    tree = xr.DataTree.from_dict(
        {"ranks": xr.Dataset({f"q{i}": (("chain", "draw"), r[None])
                              for i, r in enumerate(ranks.T)})}
    )  # fmt: skip
    tree.attrs["chains"] = json.dumps(asdict(SHORT))
    return tree


def test_power_is_what_new_batches_would_give():
    """Of a known fault: the share over fresh batches, each drawn anew."""
    random = np.random.default_rng(0)

    def batch(n: int) -> np.ndarray:
        return np.minimum(np.floor(21 * random.beta(1.0, 1.35, size=(n, 2))), 20).astype(int)

    fresh = np.mean([not rank_test(ranked(batch(100))).calibrated for _ in range(300)])
    found = [power(ranked(batch(500)), 100, subsets=100, seed=i) for i in range(10)]
    assert 0.2 < fresh < 0.9
    error = np.std([f.share for f in found]) / np.sqrt(len(found))
    assert abs(np.mean([f.share for f in found]) - fresh) < 4.0 * np.hypot(error, 0.03)
    # What is told of one estimate's error is no less than what estimates differ by.
    assert np.std([f.share for f in found]) < 1.5 * found[0].error


def test_power_on_uniform_ranks_is_at_most_the_level():
    random = np.random.default_rng(1)
    shares = [power(ranked(random.integers(21, size=(500, 4))), 100, subsets=50, seed=i).share
              for i in range(10)]  # fmt: skip
    assert np.mean(shares) < 0.03


def test_power_needs_simulations():
    ranks = ranked(np.random.default_rng(2).integers(21, size=(60, 1)))
    assert power(ranks, 60).share in (0.0, 1.0)
    with pytest.raises(InputError, match="there are 60"):
        power(ranks, 61)


def test_a_row_late_is_late_in_every_clip():
    y = jnp.arange(14.0).reshape(7, 2)
    moved = lagged(y, np.array([0, 0, 0, 1, 1, 5, 5]))
    np.testing.assert_array_equal(moved[:, 0], [4.0, 0.0, 2.0, 8.0, 6.0, 12.0, 10.0])
    single = lagged(y[:1], np.array([3]))
    np.testing.assert_array_equal(single, y[:1])


class Pair(NamedTuple):
    inputs: jax.Array
    y: jax.Array


def draw_pair(model, key, data):
    return {}, data._replace(y=jnp.arange(4.0)[:, None])


def test_without_a_word_of_clips_outcomes_alone_come_late():
    data = Pair(jnp.arange(4.0), jnp.zeros((4, 1)))
    case = SBCCase(None, draw_pair, lambda key, d: d, lambda m, d, v: {}, "a", ())
    _, seen = draw_pair(None, None, data)
    late = shifted(case, data, seen)
    np.testing.assert_array_equal(late.inputs, data.inputs)
    np.testing.assert_array_equal(late.y[:, 0], [3.0, 0.0, 1.0, 2.0])
    own = SBCCase(None, draw_pair, case.shuffle, case.quantities, "a", (), lambda d: "mine")
    assert shifted(own, data, seen) == "mine"


def test_faults_have_the_sizes_that_are_said():
    assert FAULTS["noise_sd"].noise == pytest.approx(1.44)
    for meaning, value, wrong in (
        ("sd", 2.0, 2.4), ("variance", 4.0, 5.76), ("precision", 0.25, 0.25 / 1.44),
        ("log_odds", 0.7, 0.7 - np.log(1.44)),
    ):  # fmt: skip
        assert float(noisier(jnp.asarray(value), meaning, 1.44)) == pytest.approx(wrong)
    right = dist.LogNormal(jnp.zeros(2), 0.6).to_event(1)
    assert np.allclose(narrowed(right, FAULTS["narrow_prior"].prior_sd).base_dist.scale, 0.4)
    assert Faults() == FAULTS["none"]


@pytest.fixture(scope="module")
def model(mean_cycle):
    """One for all, as others would be compiled anew."""
    return mean_cycle(period_frames=15)


@pytest.fixture(scope="module")
def right(model) -> xr.DataTree:
    return calibrate(model, simulations=100, seed=1, chains=SHORT)


def test_a_model_from_the_page_is_calibrated(right):
    found = rank_test(right)
    assert found.calibrated, found
    assert {"pace", "level 1", "noise 2", "log_density"} <= set(found.p)
    assert repr(found).startswith(found.sentence)
    assert "<table>" in found._repr_html_()
    assert azp.plot_ecdf_pit(right, var_names=["pace"], backend="none") is not None
    assert summary(right)["largest_autocorrelation"] < 0.9


@pytest.mark.parametrize("control", ["frames", "noise", "lag"])
def test_what_is_made_wrong_with_it_is_found(model, control):
    found = calibrate(model, simulations=100, seed=1, control=control, chains=SHORT)
    assert not rank_test(found).calibrated


def test_another_prior_than_the_one_drawn_from_is_found(model, right):
    """Twelve frames tell the pace well: a narrow prior is felt less, but it moves the ranks."""
    found = calibrate(model, simulations=100, seed=1, control="prior", chains=SHORT)
    one, other = (tree["ranks"]["pace"].values.ravel() for tree in (found, right))
    assert p_value(one, 21) < p_value(other, 21)


def test_a_control_that_is_none_is_refused(mean_cycle):
    with pytest.raises(InputError, match="there is none"):
        calibrate(mean_cycle(), control="luck")


def test_settings_reach_the_calibration(model, monkeypatch, tmp_path, run, refused):
    def shorter(*case, chains, **rest):
        assert chains == Chains()
        return calibrate_case(*case, chains=SHORT, **rest)

    monkeypatch.setattr(calibration, "calibrate_case", shorter)
    words = ("calibrate", "mean-cycle", "--simulations", 10, "--json", tmp_path / "c.json",
             "--out", tmp_path / "c.nc")  # fmt: skip
    result = run(*words, "--set", "period_frames=15")
    assert "calibrated as far as 10 simulations tell" in result.stdout, result.output
    tree = xr.open_datatree(tmp_path / "c.nc", engine="h5netcdf")
    assert json.loads(tree.attrs["model"])["period_frames"] == 15.0
    tree.close()
    assert json.loads((tmp_path / "c.json").read_text())["simulations"] == 10
    assert "no such setting" in refused(run(*words, "--set", "colour=red"))
    assert "is no float" in refused(run(*words, "--set", "period_frames=red"))
