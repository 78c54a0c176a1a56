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
        began = time.perf_counter()
        found = run()
        result["seconds"][name] = time.perf_counter() - began
        # Written after each stage: a run that is interrupted has not been for nothing.
        write_json(out / "posterior.json", result)
        say(f"{name}: {result['seconds'][name]:.0f} s")
        return found

    sampled = {
        name: stage(f"sampling {name}", lambda name=name: sample(name, motion, out, seed, result))
        for name in SAMPLED
    }
    names = dict.fromkeys((*STACKED, *SAMPLED, *COMPARED))
    fits = stage("modes", lambda: {name: train(name, motion, seed) for name in names})
    result["compare"] = stage("future", lambda: compare_models(fits, seed))
    weights = np.array([result["compare"]["weights"][name] for name in STACKED])
    result["forecast"] = stage(
        "forecasts", lambda: forecasts(sampled, fits, clips, weights / weights.sum(), seed, say)
    )
    result["clip_posteriors"] = stage(
        "two samplers", lambda: two_samplers(fits["cdm_style"], clips, seed)
    )
    result["sbc"] = stage("calibration", lambda: calibration_study(SIMULATIONS, seed, say))
    write_json(out / "posterior.json", result)
    return result


def sample(name: str, motion: xr.Dataset, out: Path, seed: int, result: dict) -> Fit:
    """Sample a circle model and put its diagnosis into `result`."""
    fit = fit_nuts(MODELS[name], motion, warmup=WARMUP, draws=DRAWS, chains=CHAINS, seed=seed)
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
            fit, lambda clips, name=name: train(name, clips, seed), horizon=FUTURE
        )
        for name, fit in fits.items()
    }
    table = compare(scores).table
    weights = {str(name): float(table.loc[name, "weight"]) for name in table.index}
    return {"leave_future_out": numbers(table), "weights": weights, "horizon": FUTURE}


def forecasts(
    sampled: Mapping[str, Fit],
    fits: Mapping[str, Fit],
    clips: Mapping[str, xr.Dataset],
    weights: np.ndarray,
    seed: int,
    say: Say,
) -> dict[str, Any]:
    """Score forecasts of the test clips: at the mode, over the posterior, and stacked.

    ``map`` and ``posterior`` are the stylistic circle model's; those of the other sampled
    model have its name behind them. ``stacked`` takes modes, but for the circle's posterior.
    """
    kinds: dict[str, list[Scores]] = {}
    for clip, (given, horizon) in LONG.items():
        shown: dict[str, Mixture] = {}
        parts: dict[str, Mixture] = {}
        for name in dict.fromkeys((*STACKED, *SAMPLED)):
            mode = forecast(fits[name], clips[clip], given=given, horizon=horizon)
            parts[name] = Mixture(mode.mean[None], mode.sd[None], np.ones(1))
        for name, fit in sampled.items():
            kind = "" if name == "cdm_style" else f"_{name}"
            over = forecast_posterior(fit, clips[clip], given=given, horizon=horizon, seed=seed)
            shown |= {f"map{kind}": parts[name], f"posterior{kind}": over.mixture}
        mixed = [shown["posterior"] if name == "cdm_style" else parts[name] for name in STACKED]
        shown["stacked"] = stacked(mixed, weights)
        any_fit = fits["cdm_style"]
        true = truth(any_fit, clips[clip], given, horizon)
        assert true is not None, "the study's clips go on long enough"
        n = any_fit.training.encoding.n_angles
        for kind, mixture in shown.items():
            ahead = mixture.part(slice(given, None), slice(n))
            kinds.setdefault(kind, []).append(score(ahead, true[:, :n]))
        say(
            f"{clip}: "
            + ", ".join(f"{kind} {found[-1].error:.2f}" for kind, found in kinds.items())
        )
    out: dict[str, Any] = {}
    for figure, field in FIGURES.items():
        each = {kind: [getattr(one, field) for one in found] for kind, found in kinds.items()}
        out[figure] = {kind: float(np.mean(values)) for kind, values in each.items()}
    out["per_clip"] = {
        clip: {kind: vars(found[i]) for kind, found in kinds.items()} for i, clip in enumerate(LONG)
    }
    out["stacked_mean_error"] = out["mean_error"]["stacked"]
    out["stacking_weights"] = dict(zip(STACKED, map(float, weights), strict=True))
    return out


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
