"""Calibration of a small model in a short form, and controls that it must catch."""

import json
from functools import partial

import arviz as az
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from typer.testing import CliRunner

from bayesmotion.cli import app
from bayesmotion.evaluate.sbc import calibration
from bayesmotion.evaluate.sbc.calibration import _lag_one, calibrate_case, quantities
from bayesmotion.evaluate.sbc.chains import Chains, chain
from bayesmotion.evaluate.sbc.controls import FAULTS, Faults, Wrong
from bayesmotion.evaluate.sbc.rank_test import rank_test, ranks_of, summary
from bayesmotion.evaluate.sbc.uniformity import p_value
from bayesmotion.inference.density import ProgramDensity
from bayesmotion.model import shuffled
from bayesmotion.models.multifactor import Multifactor
from bayesmotion.models.multifactor.settings import OU, Factor, GPDynamics, White
from bayesmotion.plots.calibration import rank_ecdfs

FACTOR = (Factor("subject", 2),)
TRIAL, FRAMES = Multifactor(factors=FACTOR, residual=White()).sbc_case()
SHORT = Chains(warmup=100, draws=20, thin=2, depth=4)


def run(control):
    return calibrate_case(TRIAL, FRAMES, simulations=50, seed=3, control=control, chains=SHORT)


@pytest.fixture(scope="module")
def right():
    return run("none")


@pytest.fixture(scope="module")
def wrong():
    return run("noise")


def test_ranks_are_uniform(right):
    said = rank_test(right)
    assert said.calibrated, said.sentence
    assert {"log_gamma", "log_beta", "log_density", "phase 1", "log_step 2"} <= set(said.p)
    assert all(len(ranks) == 50 for ranks in ranks_of(right).values())


def test_a_broken_noise_term_is_caught(wrong):
    said = rank_test(wrong)
    assert not said.calibrated
    assert said.p["log_beta"] < 1e-3
    # The fit makes up for four times the variance with four times the precision.
    assert np.mean(ranks_of(wrong)["log_beta"]) < 7


@pytest.mark.slow
@pytest.mark.thorough
def test_paths_and_their_dynamics_are_calibrated_and_a_wrong_prior_is_caught():
    """Needs draws of paths together with their dynamics, and the density at unit scale."""
    said = {}
    for control in ("none", "prior"):
        path = GPDynamics(size=2, order=2, noise_sd=0.3)
        trial, data = Multifactor(path, factors=FACTOR, residual=White()).sbc_case()
        found = calibrate_case(trial, data, simulations=50, seed=0, control=control, chains=SHORT)
        said[control] = rank_test(found)
        # The chains move: none passes because it stays at the truth.
        assert summary(found)["largest_autocorrelation"] < 0.9
    assert said["none"].calibrated, said["none"].sentence
    assert {"log_alpha 5", "distance 6", "gram_subject 2"} <= set(said["none"].p)
    assert not said["prior"].calibrated


def test_arviz_draws_the_result_and_so_do_we(right, wrong):
    assert az.plot_ecdf_pit(right, var_names=["log_beta"], backend="none") is not None
    values = right["prior_sbc"]["log_step"].values
    np.testing.assert_array_equal(np.floor(values * 21), right["ranks"]["log_step"].values)
    axes = rank_ecdfs(wrong).axes
    bad = {ax.get_title().split(",")[0] for ax in axes if ax.lines[1:]
           and ax.lines[1].get_color() == "#D55E00"}  # fmt: skip
    assert "log beta" in bad
    told = summary(wrong)
    assert json.loads(json.dumps(told)) == told
    assert told["control"] == "noise"
    assert not told["calibrated"]


def test_the_same_seed_gives_the_same_ranks(right):
    again = run("none")
    assert all(np.array_equal(again["ranks"][n], right["ranks"][n]) for n in right["ranks"])


@pytest.fixture(scope="module")
def draw():
    factors = (*FACTOR, Factor("gait", 2))
    trial, frames = Multifactor(factors=factors, residual=OU(per_clip=False)).sbc_case()
    values, frames = jax.jit(lambda key: trial.draw(trial.model, key, frames))(jax.random.key(2))
    return trial, frames, values


@partial(jax.jit, static_argnums=0)
def quantities_of(trial, faults, frames, values):
    return quantities(Wrong(trial, faults), frames, values)


def test_faults_change_what_they_say_and_nothing_else(draw):
    trial, frames, values = draw
    plain = ProgramDensity(trial.model, program="collapsed", jacobian=True)

    @jax.jit
    def rightly(values):
        at = plain.real(values, (frames,))
        return at, plain(at, (frames,))

    @jax.jit
    def wrongly(faults, values):
        wrong = ProgramDensity(Wrong(trial, faults), jacobian=True)
        real = wrong.real(values, (frames,))
        return real, wrong.natural(real, (frames,)), wrong(real, (frames,))

    at, right = rightly(values)
    right = float(right)

    def density(faults: Faults) -> float:
        real, natural, found = wrongly(faults, values)
        jax.tree.map(np.testing.assert_array_equal, real, at)
        assert float(natural["beta"]) == pytest.approx(float(values["beta"]), rel=1e-12)
        return float(found)

    assert density(Faults()) == pytest.approx(right, rel=1e-12)
    z = float(jnp.log(values["gamma"]))
    narrower = np.log(3.0) - 0.5 * z**2 * (9.0 - 1.0)
    assert density(FAULTS["prior"]) - right == pytest.approx(narrower, rel=1e-8)
    log_y = [
        float(quantities_of(trial, FAULTS[name], frames, values)["log_density"])
        for name in ("noise", "none")
    ]
    noisy = {**values, "beta": values["beta"] / 4.0}
    noisier = quantities_of(trial, Faults(), frames, noisy)["log_density"]
    assert log_y[0] == pytest.approx(float(noisier), rel=1e-10)
    assert log_y[0] != pytest.approx(log_y[1], rel=1e-3)
    # The prior of beta is that of its right value.
    assert density(FAULTS["noise"]) - right == pytest.approx(log_y[0] - log_y[1], rel=1e-8)


def test_frames_are_shuffled_within_their_clips():
    clip = np.repeat([0, 1], 6)
    y = jnp.arange(12.0)[:, None]
    new = np.asarray(shuffled(jax.random.key(0), y, clip))[:, 0]
    assert set(new[:6]) == set(range(6))
    assert set(new[6:]) == set(range(6, 12))
    assert not np.array_equal(new, np.arange(12.0))


def test_quantities_do_not_see_what_no_data_can_tell(draw):
    """Turned style vectors, and a turned circle, give the same numbers."""
    trial, frames, values = draw
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    found = quantities_of(trial, Faults(), frames, values)
    turned = {**values, "style_gait": values["style_gait"] @ turn}
    again = quantities_of(trial, Faults(), frames, turned)
    np.testing.assert_allclose(again["gram_gait"], found["gram_gait"], rtol=1e-10)
    assert found["gram_gait"].shape == (2,)
    assert found["phase"].shape == (2,)
    assert set(found) == {
        "log_gamma", "log_beta", "log_residual_variance", "log_residual_time", "log_step",
        "log_scale", "gram_subject", "gram_gait", "phase", "log_density",
    }  # fmt: skip


def test_a_chain_put_back_at_a_slow_target_has_uniform_ranks():
    """A chain that hardly moves between its draws, on a normal target."""

    class Normal:
        def __call__(self, real, data):
            return -0.5 * jnp.sum(real["u"] ** 2)

    # Trees of one leapfrog and no adaptation: successive draws are close to each other.
    settings = Chains(warmup=0, draws=20, thin=1, depth=1)

    def rank(key):
        start_key, key = jax.random.split(key)
        start = jax.random.normal(start_key, (1,))
        draws, *_ = chain(settings, key, Normal(), {"u": start}, ())
        return jnp.sum(draws["u"] < start), _lag_one(draws["u"])[0]

    ranks, lag = jax.jit(jax.vmap(rank))(jax.random.split(jax.random.key(4), 2000))
    assert np.mean(lag) > 0.3
    assert p_value(np.asarray(ranks), 21) > 1e-3


def test_the_command_tells_the_table_writes_files_and_fails_when_it_must(
    monkeypatch, right, wrong, tmp_path
):
    found = {"none": right, "noise": wrong}
    monkeypatch.setattr(
        calibration, "calibrate_case", lambda *_, control, **settings: found[control]
    )
    options = [
        "--out",
        tmp_path / "r.nc",
        "--json",
        tmp_path / "p.json",
        "--plot",
        tmp_path / "r.png",
    ]
    arguments = ["calibrate", "multifactor", *map(str, options)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert "calibrated as far as 50 simulations tell" in result.stdout
    assert json.loads((tmp_path / "p.json").read_text()) == summary(right)
    assert (tmp_path / "r.png").read_bytes().startswith(b"\x89PNG")
    assert (
        az.from_netcdf(tmp_path / "r.nc")["ranks"]["phase"].shape == right["ranks"]["phase"].shape
    )
    result = CliRunner().invoke(app, ["calibrate", "multifactor", "--control", "noise"])
    assert result.exit_code == 1
    assert "miscalibrated" in result.stdout
    result = CliRunner().invoke(app, ["calibrate", "multifactor", "--control", "luck"])
    assert result.exit_code == 2
    assert "there is no such control" in result.stderr
