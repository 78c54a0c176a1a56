"""The posterior of the multifactor models on the six clips of the multifactor study.

Sampling (``cdm_style``, and ``cdm_style_own``, whose clips have a drift of their own
size), forecasts of the eight test clips at the mode and averaged over the posterior, two
samplers held against each other on each test clip's own unknowns, models compared by
leaving the future out, and simulation-based calibration. Settings are those of the
multifactor study.
"""

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import arviz as az
import numpy as np
import xarray as xr

from ..criticism.compare import compare, numbers
from ..criticism.diagnostics import diagnose
from ..criticism.future import leave_future_out
from ..criticism.scores import Mixture, Scores, score, stacked
from ..criticism.verdict import study as calibration_study
from ..files import write_json
from ..fit import Fit
from ..inference.nuts import fit_nuts
from ..inference.sampling import Problem
from ..models.multifactor import Multifactor
from ..tasks.clip_posterior import clip_values, identified, pose_clip, sample_nuts, sample_walkers
from ..tasks.forecast import forecast, new_clip, truth
from ..tasks.posterior_forecast import forecast_posterior
from .multifactor import LONG, MODELS, read_clips, train, training_motion

Say = Callable[[str], None]

CHAINS, WARMUP, DRAWS = 4, 500, 500
FUTURE = 10
SIMULATIONS = 100
COMPARED = ("gpdm", "gpdm_style", "bgpdm", "bgpdm_style", "cdm_style")
SAMPLED = ("cdm_style", "cdm_style_own")
STACKED = ("gpdm_style", "bgpdm_style", "cdm_style")
CLIP_CHAINS, CLIP_WARMUP, CLIP_DRAWS = 4, 300, 500
WALKER_WARMUP, WALKER_STEPS = 1500, 3000
FIGURES = {
    "mean_error": "error",
    "crps": "crps",
    "log_score": "log_score",
    "coverage90": "coverage90",
}


def reproduce(data: Path | None, out: Path, say: Say = print, seed: int = 0) -> dict:
    """Run the study and write ``posterior.json`` and the fits to `out`.

    Parameters
    ----------
    data
        Folder that holds ``cmu/``; where None as in `bayesmotion.motion.datasets.cmu`.
    out
        Folder for the results.
    say
        Called with a line after every stage.
    seed
        The one seed.
    """
    motion, clips = training_motion(data), read_clips(list(LONG), data)
    result: dict[str, Any] = {"seed": seed, "seconds": {}}

    def stage(name: str, run: Callable[[], Any]) -> Any:
        # Written before each stage: a run that is interrupted has not been for nothing.
        write_json(out / "posterior.json", result)
        began = time.perf_counter()
        found = run()
        result["seconds"][name] = time.perf_counter() - began
        say(f"{name}: {result['seconds'][name]:.0f} s")
        return found

    fits: dict[str, Fit] = {}
    result["forecast"] = {"per_clip": {clip: {} for clip in LONG}}
    for name in SAMPLED:
        sampled = stage(
            f"sampling {name}", lambda name=name: sample(name, motion, out, seed, result)
        )
        fits[name] = stage(f"mode of {name}", lambda name=name: train(name, motion, seed))
        kind = "" if name == "cdm_style" else f"_{name}"
        mixtures = stage(
            f"forecasts of {name}",
            lambda name=name, fit=sampled: forecasts(fits[name], fit, clips, seed),
        )
        found = {f"map{kind}": mixtures[0], f"posterior{kind}": mixtures[1]}
        put_scores(result["forecast"], found, fits[name], clips, say)
        if name == "cdm_style":
            posterior = mixtures[1]
            result["clip_posteriors"] = stage(
                "two samplers", lambda name=name: two_samplers(fits[name], clips, seed)
            )
    others = [name for name in dict.fromkeys((*STACKED, *COMPARED)) if name not in fits]
    fits |= stage("other modes", lambda: {name: train(name, motion, seed) for name in others})
    result["compare"] = stage("future", lambda: compare_models(fits, seed))
    weights = np.array([result["compare"]["weights"][name] for name in STACKED])
    weights = weights / weights.sum()
    mixed = stage("stacked", lambda: stack_forecasts(fits, posterior, clips, weights))
    put_scores(result["forecast"], {"stacked": mixed}, fits["cdm_style"], clips, say)
    result["forecast"] |= {
        "stacked_mean_error": result["forecast"]["mean_error"]["stacked"],
        "stacking_weights": dict(zip(STACKED, map(float, weights), strict=True)),
    }
    result["sbc"] = stage("calibration", lambda: calibration_study(SIMULATIONS, seed, say))
    write_json(out / "posterior.json", result)
    return result


def sample(name: str, motion: xr.Dataset, out: Path, seed: int, result: dict) -> Fit:
    """Sample a circle model and put its diagnosis into `result`.

    A run that is interrupted goes on from its last block when it is begun again.
    """
    part = out / "fits" / f"{name}_nuts.nc.part"
    part.parent.mkdir(parents=True, exist_ok=True)
    fit = fit_nuts(
        MODELS[name],
        motion,
        warmup=WARMUP,
        draws=DRAWS,
        chains=CHAINS,
        seed=seed,
        checkpoint=part,
        resume=True,
    )
    fit.save(out / "fits" / f"{name}_nuts.nc")
    found = diagnose(fit)
    result[name] = {
        **found.figures,
        "seconds": float(fit.tree.attrs["seconds"]),
        "trusted": found.trusted,
        "sentences": list(found.sentences),
        "problems": list(found.problems),
    }
    return fit


def compare_models(fits: Mapping[str, Fit], seed: int) -> dict[str, Any]:
    """Compare models by the last frames of every training clip, left out and predicted."""
    scores = {
        name: leave_future_out(
            fits[name], lambda clips, name=name: train(name, clips, seed), horizon=FUTURE
        )
        for name in COMPARED
    }
    table = compare(scores).table
    weights = {str(name): float(table.loc[name, "weight"]) for name in table.index}
    return {"leave_future_out": numbers(table), "weights": weights, "horizon": FUTURE}


def mode_forecast(fit: Fit, clip: xr.Dataset, given: int, horizon: int) -> Mixture:
    """Forecast a clip at the mode, as a mixture of one."""
    mode = forecast(fit, clip, given=given, horizon=horizon)
    return Mixture(mode.mean[None], mode.sd[None], np.ones(1))


def forecasts(
    mode: Fit, sampled: Fit, clips: Mapping[str, xr.Dataset], seed: int
) -> tuple[dict[str, Mixture], dict[str, Mixture]]:
    """Forecast the test clips at the mode and averaged over the posterior."""
    at_mode, over = {}, {}
    for clip, (given, horizon) in LONG.items():
        at_mode[clip] = mode_forecast(mode, clips[clip], given, horizon)
        over[clip] = forecast_posterior(
            sampled, clips[clip], given=given, horizon=horizon, seed=seed
        ).mixture
    return at_mode, over


def stack_forecasts(
    fits: Mapping[str, Fit],
    posterior: Mapping[str, Mixture],
    clips: Mapping[str, xr.Dataset],
    weights: np.ndarray,
) -> dict[str, Mixture]:
    """Mix the circle's averaged forecasts with the other models' modes, by their weights."""
    out = {}
    for clip, (given, horizon) in LONG.items():
        parts = [
            posterior[clip]
            if name == "cdm_style"
            else mode_forecast(fits[name], clips[clip], given, horizon)
            for name in STACKED
        ]
        out[clip] = stacked(parts, weights)
    return out


def put_scores(
    found: dict[str, Any],
    kinds: Mapping[str, Mapping[str, Mixture]],
    fit: Fit,
    clips: Mapping[str, xr.Dataset],
    say: Say,
) -> None:
    """Score forecasts of the test clips' angles, clip by clip and on average."""
    n = fit.training.encoding.n_angles
    for kind, mixtures in kinds.items():
        each: list[Scores] = []
        for clip, (given, horizon) in LONG.items():
            true = truth(fit, clips[clip], given, horizon)
            assert true is not None, "the study's clips go on long enough"
            each.append(score(mixtures[clip].part(slice(given, None), slice(n)), true[:, :n]))
            found["per_clip"][clip][kind] = vars(each[-1])
        for figure, field in FIGURES.items():
            mean = float(np.mean([getattr(one, field) for one in each]))
            found.setdefault(figure, {})[kind] = mean
        say(f"{kind}: " + ", ".join(f"{f} {found[f][kind]:.3f}" for f in FIGURES))


def two_samplers(fit: Fit, clips: Mapping[str, xr.Dataset], seed: int) -> dict[str, Any]:
    """Sample each test clip's own unknowns by NUTS and by an ensemble, and compare means."""
    out = {}
    for clip, (given, horizon) in LONG.items():
        posed = pose_clip(fit, new_clip(fit, clips[clip], given=given, horizon=horizon))
        out[clip] = _agreement(fit.model, posed, seed)
    return out


def _agreement(model: Multifactor, posed: Problem, seed: int) -> dict[str, Any]:
    """Difference of the two samplers' means in standard errors, at worst."""
    z = sample_nuts(posed, chains=CLIP_CHAINS, warmup=CLIP_WARMUP, draws=CLIP_DRAWS, seed=seed)
    one = identified(model, clip_values(posed, z["z"]))
    walkers = sample_walkers(posed, warmup=WALKER_WARMUP, steps=WALKER_STEPS, seed=seed)
    steps = np.linspace(0, WALKER_STEPS - 1, min(WALKER_STEPS, 1000)).astype(int)
    # (steps, walkers) as (chain, draw): only means over all of them are taken.
    other = identified(model, clip_values(posed, walkers.values[steps]))
    tau = float(np.max(walkers.autocorrelation))
    worth = walkers.values.shape[0] * walkers.values.shape[1] / tau
    worst, r_hat, ess = 0.0, 1.0, np.inf
    for name, draws in one.items():
        for index in np.ndindex(draws.shape[2:]):
            a, b = draws[(..., *index)], other[name][(..., *index)]
            ess_a = float(az.ess(a))
            error = np.sqrt(a.var() / ess_a + b.var() / worth)
            worst = max(worst, float(abs(a.mean() - b.mean()) / error))
            r_hat, ess = max(r_hat, float(az.rhat(a))), min(ess, ess_a)
    return {
        "worst_difference_in_mcse": worst,
        "nuts_max_r_hat": r_hat,
        "nuts_min_ess": float(ess),
        "nuts_divergences": int(z["diverging"].sum()),
        "ensemble_autocorrelation": tau,
        "ensemble_acceptance": walkers.acceptance,
        "ensemble_long_enough": walkers.trusted,
    }
