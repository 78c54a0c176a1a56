"""NUTS and the ensemble: known posteriors, runs that are killed, checkpoints of other runs."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import arviz as az
import numpy as np
import pytest
import xarray as xr

from bayesmotion.errors import InputError
from bayesmotion.inference.checkpoint import Checkpoint, fingerprint
from bayesmotion.inference.sampling import whitening as sampling
from bayesmotion.inference.sampling.ensemble import fit_ensemble
from bayesmotion.inference.sampling.nuts import fit_nuts
from bayesmotion.models.multifactor import GPDynamics, Multifactor
from bayesmotion.motion.synthetic.walkers import synthetic_walkers

BOTH = ("chain", "draw")

CHILD = """
import importlib.util, sys, time
import numpy as np
import bayesmotion
from bayesmotion.inference.sampling.nuts import fit_nuts
spec = importlib.util.spec_from_file_location("line_model", sys.argv[1])
line = importlib.util.module_from_spec(spec)
spec.loader.exec_module(line)
fit_nuts(
    line.Line(), line.clips(), warmup=60, draws=200, chains=2, seed=4, checkpoint=sys.argv[2],
    resume=True, progress=lambda done, best: time.sleep(0.2),
)
"""


def regression(motion, noise: np.ndarray, output: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance of (a, b) given draws of the noise, by the formula of each."""
    x, y = motion["x"].values, motion["y"].values[:, output]
    design = np.stack([np.ones_like(x), x], axis=1)
    means, variances = [], []
    for one in noise:
        covariance = np.linalg.inv(design.T @ design / one**2 + np.eye(2) / 100.0)
        means.append(covariance @ design.T @ y / one**2)
        variances.append(np.diag(covariance))
    return np.mean(means, axis=0), np.mean(variances, axis=0) + np.var(means, axis=0)


@pytest.fixture(scope="module")
def line_fit(line, line_motion):
    return fit_nuts(line, line_motion, warmup=300, draws=500, chains=2, seed=1)


def assert_exact(fit, motion, ess) -> None:
    """Compare with the conditional posterior, averaged over the draws of the noise."""
    for index, output in enumerate(fit.tree["posterior"]["output"].values):
        of_output = fit.tree["posterior"].sel(output=output)
        noise = of_output["noise"].values.ravel()
        mean, variance = regression(motion, noise[:: max(len(noise) // 300, 1)], index)
        for name, m, v in zip("ab", mean, variance, strict=True):
            draws, count = of_output[name].values.ravel(), ess(name, index)
            assert count > 100
            assert abs(draws.mean() - m) < 4.5 * np.sqrt(v / count)
            assert abs(draws.var() / v - 1.0) < 4.5 * np.sqrt(3.0 / count)


def test_draws_are_from_the_posterior(line_fit, line_motion):
    ess = az.ess(line_fit.tree["posterior"].ds)
    assert_exact(line_fit, line_motion, lambda name, index: float(ess[name][index]))
    assert float(az.rhat(line_fit.tree["posterior"].ds)["b"].max()) < 1.02
    tree = line_fit.tree
    assert json.loads(tree.attrs["warnings"]) == []
    assert tree["posterior"]["mean"].dims == ("chain", "draw", "point", "output")
    stats = tree["sample_stats"]
    assert {
        "lp", "energy", "diverging", "tree_depth", "reached_max_treedepth", "n_steps",
        "acceptance_rate", "step_size",
    } == set(stats.data_vars)  # fmt: skip
    np.testing.assert_array_equal(np.ceil(np.log2(stats["n_steps"] + 1)), stats["tree_depth"])
    # lp is that of the real line: the density of the sites and the Jacobian of the noise.
    parts = tree["log_likelihood"]["y"].sum(("point", "output"))
    whole = parts + sum(tree["log_prior"].data_vars.values())
    jacobian = np.log(tree["posterior"]["noise"]).sum("output")
    np.testing.assert_allclose(stats["lp"], whole + jacobian, rtol=1e-9)


def test_the_ensemble_agrees(line, line_motion):
    fit = fit_ensemble(line, line_motion, warmup=400, steps=1500, draws=1500, seed=1)
    worth = json.loads(fit.tree.attrs["ess"])
    assert fit.tree["posterior"].sizes["chain"] == 1
    # The draws are fewer than the points, and no more independent.
    assert_exact(fit, line_motion, lambda name, index: min(worth[name], 1500.0))
    assert len(np.unique(fit.tree["sample_stats"]["lp"])) > 750


def test_chains_from_the_prior_come_to_the_same_place(line, line_motion, line_fit):
    # Their scales are five hundred times apart, and nothing has told the sampler so.
    fit = fit_nuts(
        line, line_motion, warmup=300, draws=300, chains=2, seed=2, start="prior", mass="diagonal"
    )
    for name in ("a", "b"):
        ours, other = (one.tree["posterior"][name] for one in (fit, line_fit))
        error = np.sqrt(sum((one.std(BOTH) ** 2) / az.ess(one) for one in (ours, other)))
        assert np.all(np.abs(ours.mean(BOTH) - other.mean(BOTH)) < 4.5 * error)


def test_whitening_is_the_inverse_of_the_hessian():
    random = np.random.default_rng(0)
    root = random.normal(size=(4, 4))
    hessian = root @ root.T + np.eye(4)
    factor = sampling.whitening(hessian)
    np.testing.assert_allclose(factor @ factor.T, np.linalg.inv(hessian))
    # Flat and falling directions have no width that is finite.
    flat = sampling.whitening(np.diag([4.0, 0.0, -9.0, 1e-8]))
    np.testing.assert_allclose(np.diag(flat @ flat.T), [0.25, 4.0, 1.0 / 9.0, 4.0])


def test_at_the_mode_the_whitened_hessian_is_one(line, line_motion):
    problem = sampling.sampling_problem(line, line.prepare(line_motion), 0, "map")
    n = problem.unknowns
    step = 1e-3
    points = [np.zeros(n)]
    for i in range(n):
        points += [step * np.eye(n)[i], -step * np.eye(n)[i]]
    density = np.asarray(problem.log_density(np.array(points)))
    slopes = (density[1::2] - density[2::2]) / (2 * step)
    curvatures = -(density[1::2] + density[2::2] - 2 * density[0]) / step**2
    np.testing.assert_allclose(slopes, 0.0, atol=1e-2)
    np.testing.assert_allclose(curvatures, 1.0, atol=1e-3)


@pytest.mark.parametrize("fit_it", [fit_nuts, fit_ensemble])
def test_an_interrupted_run_goes_on_with_the_same_draws(line, line_motion, tmp_path, fit_it):
    settings = {"warmup": 60, "draws": 60, "seed": 4}
    settings |= {"chains": 2} if fit_it is fit_nuts else {"steps": 60}
    whole = fit_it(line, line_motion, **settings)

    def stop(done, best):
        if done >= 80:
            raise KeyboardInterrupt

    part = tmp_path / "fit.nc.part"
    with pytest.raises(KeyboardInterrupt):
        fit_it(line, line_motion, **settings, checkpoint=part, progress=stop)
    done = []
    resumed = fit_it(
        line, line_motion, **settings, checkpoint=part, resume=True,
        progress=lambda count, best: done.append(count),
    )  # fmt: skip
    assert done[0] == 100
    for group in ("posterior", "sample_stats", "log_likelihood"):
        for name, values in whole.tree[group].data_vars.items():
            np.testing.assert_array_equal(resumed.tree[group][name].values, values.values)
    # Another seed, other settings, another model, other data: not this run's checkpoint.
    for other in ({"seed": 5}, {"warmup": 61}):
        with pytest.raises(InputError, match="belongs to a run with other data"):
            fit_it(line, line_motion, **{**settings, **other}, checkpoint=part, resume=True)
    for changed in ((type(line)(5.0), line_motion), (line, line_motion + 1e-12)):
        with pytest.raises(InputError, match="belongs to a run with other data"):
            fit_it(*changed, **settings, checkpoint=part, resume=True)
    part.write_bytes(b"half a file")
    with pytest.raises(InputError, match=r"no \.npz file of a checkpoint"):
        fit_it(line, line_motion, **settings, checkpoint=part, resume=True)


@pytest.mark.parametrize(
    ("fit_it", "more"),
    [(fit_nuts, {"chains": 2}), (fit_nuts, {"chains": 2, "start": "typical"}),
     (fit_ensemble, {"steps": 60})],
)  # fmt: skip
def test_the_mode_is_kept_before_anything_is_drawn(
    line, line_motion, tmp_path, monkeypatch, fit_it, more
):
    settings = {"warmup": 30, "draws": 60, "seed": 4, **more}
    part, save = tmp_path / "fit.nc.part", Checkpoint.save

    def die_after_one(self, arrays):
        save(self, arrays)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Checkpoint, "save", die_after_one)
        with pytest.raises(KeyboardInterrupt):
            fit_it(line, line_motion, **settings, checkpoint=part)
    assert done_in(part) == 0
    whole = fit_it(line, line_motion, **settings)
    with monkeypatch.context() as patch:
        patch.setattr("bayesmotion.inference.sampling.whitening.begin", None)  # no second search
        resumed = fit_it(line, line_motion, **settings, checkpoint=part, resume=True)
    for name, values in whole.tree["posterior"].data_vars.items():
        np.testing.assert_array_equal(resumed.tree["posterior"][name].values, values.values)


def test_a_run_of_another_number_of_threads_is_another(monkeypatch):
    def key() -> str:
        return fingerprint({}, {}, ())

    one = key()
    monkeypatch.setattr(
        "bayesmotion.inference.checkpoint.threadpool_info",
        lambda: [{"user_api": "blas", "num_threads": 4}],
    )
    assert key() != one


@pytest.mark.thorough
def test_kills_lose_nothing(line, line_motion, tmp_path):
    part = tmp_path / "fit.nc.part"
    model = Path(sys.modules[type(line).__module__].__file__)
    command = [sys.executable, "-c", CHILD, str(model), str(part)]
    random = np.random.default_rng(0)
    reached = [0]
    for _ in range(2):
        child = subprocess.Popen(command, env=os.environ, stderr=subprocess.PIPE)
        while child.poll() is None and done_in(part) <= reached[-1]:
            time.sleep(0.02)
        # At any moment of the next block, the writing of the checkpoint among them.
        time.sleep(0.2 * random.uniform())
        assert child.poll() is None, child.stderr.read().decode()
        os.kill(child.pid, signal.SIGKILL)
        child.communicate()
        reached.append(done_in(part))
    assert 0 < reached[1] < reached[2] < 260
    settings = {"warmup": 60, "draws": 200, "chains": 2, "seed": 4}
    resumed = fit_nuts(line, line_motion, **settings, checkpoint=part, resume=True)
    whole = fit_nuts(line, line_motion, **settings)
    for name, values in whole.tree["posterior"].data_vars.items():
        np.testing.assert_array_equal(resumed.tree["posterior"][name].values, values.values)


def done_in(part: Path) -> int:
    """Iterations in a checkpoint, which is whole whenever it is there."""
    if not part.exists():
        return 0
    with np.load(part) as saved:
        return int(saved["done"]) if "done" in saved else 0


def test_too_many_unknowns_for_an_ensemble():
    model = Multifactor(GPDynamics())
    motion = synthetic_walkers(("ann", "ben"), gaits=("walk",), seconds=1.0, frame_rate=20.0)
    with pytest.raises(InputError, match=r"unknowns.*Use nuts"):
        fit_ensemble(model, motion, start="prior", warmup=1, steps=1, draws=1)


def test_sites_without_entries_are_no_trouble(tmp_path):
    """One clip of one subject and gait: its shapes and phases have no entries."""
    walk = synthetic_walkers(("ann",), ("walk",), seconds=1.0, frame_rate=20.0)
    settings = {"warmup": 20, "steps": 20, "draws": 40, "checkpoint": tmp_path / "part"}
    whole = fit_ensemble(Multifactor(), walk, **settings)
    again = fit_ensemble(Multifactor(), walk, **settings, resume=True)
    for fit in (whole, again):
        assert set(json.loads(fit.tree.attrs["ess"])) == {
            "beta", "residual_variance", "residual_time", "gamma", "step",
        }  # fmt: skip
        assert fit.tree["posterior"]["shape_subject"].shape == (1, 40, 0)
    xr.testing.assert_equal(whole.tree["posterior"], again.tree["posterior"])


def test_improper_priors_are_refused():
    motion = synthetic_walkers(("ann", "ben"), gaits=("walk",), seconds=1.0, frame_rate=20.0)
    model = Multifactor(priors="paper")
    with pytest.raises(InputError, match="no prior to integrate over"):
        fit_nuts(model, motion)
    with pytest.raises(InputError, match="'gamma': its prior is improper"):
        fit_nuts(model, motion, integrate=False)


def test_a_search_that_gave_up_goes_on_in_whitened_unknowns(line, line_motion, monkeypatch):
    training = line.prepare(line_motion)
    whole = sampling.sampling_problem(line, training, 0, "map")
    assert whole.converged
    monkeypatch.setattr(sampling, "MODE_STEPS", 4)
    found = sampling.sampling_problem(line, training, 0, "map")
    assert found.converged
    width = np.sqrt(np.sum(np.asarray(whole.transform.factor) ** 2, axis=1))
    assert np.all(np.abs(np.asarray(found.transform.mode) - whole.transform.mode) < 0.02 * width)
    monkeypatch.setattr(sampling, "ROUNDS", 0)
    assert not sampling.sampling_problem(line, training, 0, "map").converged
