"""The posterior of the multifactor models on the six clips of the multifactor study.

Sampling (``cdm_style``, and ``cdm_style_own``, whose clips have a drift of their own
size), forecasts of the eight test clips at the mode and averaged over the posterior, two
samplers held against each other on each test clip's own unknowns, models compared by
leaving out the future and by leaving out clips, and simulation-based calibration. Settings
are those of the multifactor study.
"""

import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import arviz as az
import numpy as np
import xarray as xr

from ..criticism.compare import compare, numbers
from ..criticism.diagnostics import diagnose
from ..criticism.folds import leave_clips_out
from ..criticism.future import leave_future_out
from ..criticism.scores import Mixture, Scores, score, stacked
from ..criticism.verdict import study as calibration_study
from ..files import write_json
from ..fit import Fit
from ..inference.nuts import fit_nuts
from ..inference.sampling import Problem
from ..models.multifactor import Multifactor
from ..motion import split
from ..tasks.clip_posterior import clip_values, identified, pose_clip, sample_nuts, sample_walkers
from ..tasks.forecast import forecast, new_clip, truth
from ..tasks.posterior_forecast import forecast_posterior
from .multifactor import LONG, MODELS, read_clips, train, training_motion
from .multifactor_left_out import lengths_of

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
    modes: dict[str, dict[str, Mixture]] = {}
    result["forecast"] = {"per_clip": {clip: {} for clip in LONG}}
    for name in SAMPLED:
        sampled = stage(f"sampling {name}", partial(sample, name, motion, out, seed, result))
        fits[name] = stage(f"mode of {name}", partial(train, name, motion, seed))
        modes[name] = stage(f"forecasts at the mode of {name}", partial(at_mode, fits[name], clips))
        over = stage(f"forecasts of {name}", partial(averaged, sampled, clips, seed))
        kind = "" if name == "cdm_style" else f"_{name}"
        kinds = {f"map{kind}": modes[name], f"posterior{kind}": over}
        put_scores(result["forecast"], kinds, fits[name], clips, say)
        if name == "cdm_style":
            posterior = over
            result["clip_posteriors"] = stage(
                "two samplers", partial(two_samplers, fits[name], clips, seed)
            )
    for name in (name for name in COMPARED if name not in fits):
        fits[name] = stage(f"mode of {name}", partial(train, name, motion, seed))
        modes[name] = stage(f"forecasts at the mode of {name}", partial(at_mode, fits[name], clips))
        put_scores(result["forecast"], {f"map_{name}": modes[name]}, fits[name], clips, say)
    result["compare"] = stage("future", partial(compare_futures, fits, seed))
    weights = np.array([result["compare"]["weights"][name] for name in STACKED])
    weights = weights / weights.sum()
    mixed = {
        clip: stacked(
            [posterior[clip] if name == "cdm_style" else modes[name][clip] for name in STACKED],
            weights,
        )
        for clip in LONG
    }
    put_scores(result["forecast"], {"stacked": mixed}, fits["cdm_style"], clips, say)
    result["forecast"] |= {
        "stacked_mean_error": result["forecast"]["mean_error"]["stacked"],
        "stacking_weights": dict(zip(STACKED, map(float, weights), strict=True)),
    }
    result["sbc"] = stage("calibration", partial(calibration_study, SIMULATIONS, seed, say))
    result["compare"] |= stage("clips", partial(compare_clips, fits, seed))
    write_json(out / "posterior.json", result)
    return result


def sample(name: str, motion: xr.Dataset, out: Path, seed: int, result: dict) -> Fit:
    """Sample a circle model and put its diagnosis into `result`.

    Beside what is said of the identified quantities stands the largest R-hat of the sites
    as they are, turned and shifted as each chain has them. A run that is interrupted goes
    on from its last block when it is begun again.
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
        "naive_max_r_hat": naive_r_hat(fit),
        "clips": list(fit.training.clips),
        "seconds": float(fit.tree.attrs["seconds"]),
        "trusted": found.trusted,
        "sentences": list(found.sentences),
        "problems": list(found.problems),
    }
    return fit


def naive_r_hat(fit: Fit) -> float:
    """Largest R-hat of all sites' entries that vary, without regard to what data can tell."""
    worst = 1.0
    for draws in fit.tree["posterior"].to_dataset().data_vars.values():
        each = draws.values.reshape(*draws.shape[:2], -1)
        moving = each[..., np.ptp(each, axis=(0, 1)) > 0.0]
        worst = max([worst, *(float(az.rhat(column)) for column in np.moveaxis(moving, -1, 0))])
    return worst


def compare_futures(fits: Mapping[str, Fit], seed: int) -> dict[str, Any]:
    """Compare models by the last frames of every training clip, left out and predicted."""
    scores = {
        name: leave_future_out(fits[name], partial(train, name, seed=seed), horizon=FUTURE)
        for name in COMPARED
    }
    table = compare(scores).table
    weights = {str(name): float(table.loc[name, "weight"]) for name in table.index}
    return {"leave_future_out": numbers(table), "weights": weights, "horizon": FUTURE}


def compare_clips(fits: Mapping[str, Fit], seed: int) -> dict[str, Any]:
    """Compare models by forecasts of every training clip from fits to the others."""
    lengths = {clip: lengths_of(part) for clip, part in split(fits["cdm_style"].motion).items()}
    scores = {
        name: leave_clips_out(fits[name], partial(train, name, seed=seed), lengths=lengths)
        for name in (*COMPARED, "cdm_style_own")
    }
    return {"leave_clips_out": numbers(compare(scores).table)}


def at_mode(fit: Fit, clips: Mapping[str, xr.Dataset]) -> dict[str, Mixture]:
    """Forecast the test clips at the mode, each a mixture of one."""
    out = {}
    for clip, (given, horizon) in LONG.items():
        mode = forecast(fit, clips[clip], given=given, horizon=horizon)
        out[clip] = Mixture(mode.mean[None], mode.sd[None], np.ones(1))
    return out


def averaged(fit: Fit, clips: Mapping[str, xr.Dataset], seed: int) -> dict[str, Mixture]:
    """Forecast the test clips, averaged over the posterior."""
    return {
        clip: forecast_posterior(fit, clips[clip], given=given, horizon=horizon, seed=seed).mixture
        for clip, (given, horizon) in LONG.items()
    }


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
