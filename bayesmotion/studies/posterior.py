"""The posterior of the multifactor models on the six clips of the multifactor study.

Sampling (``cdm_style``; ``cdm_style_own``, whose clips have a drift of their own size;
``gpdm_style`` on one person's clips), how far new people stray, chosen by training people
left out, forecasts of the eight test clips at the mode and averaged over the posterior, two
samplers held against each other on each test clip's own unknowns, models compared by
leaving out the future and by leaving out clips, and simulation-based calibration. Settings
are those of the multifactor study.

Each stage writes its part of ``posterior.json``; stages that are in it are not done again,
and fits and forecasts are kept beside it.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import arviz as az
import numpy as np
import xarray as xr

from ..criticism.diagnostics import diagnose
from ..criticism.scores import Mixture, stacked
from ..criticism.verdict import study as calibration_study
from ..files import write_json
from ..fit import Fit, load
from ..inference.nuts import fit_nuts
from ..inference.sampling import Problem
from ..models.multifactor import Multifactor
from ..models.registry import describe_model
from ..motion import concat, split
from ..tasks.clip_posterior import clip_values, identified, pose_clip, sample_nuts, sample_walkers
from ..tasks.forecast import new_clip
from .multifactor import BALANCED_NOISE, LONG, MODELS, read_clips, train, training_motion
from .posterior_compare import COMPARED, FUTURE, Kind, compare_models, ranks_agree, stacking_weights
from .posterior_forecasts import at_mode, averaged, kept, means, scores
from .posterior_freedom import leave_subjects_out, with_freedom
from .stages import Say, Stages

CHAINS, WARMUP, DRAWS = 4, 500, 500
# A path of its own for every frame of one person's two clips. Its steps are as free as those
# of the balanced dynamics: with a tenth of that noise hundreds of unknowns hang together so
# stiffly that every tree runs to its limit.
PATH_CLIPS = ("02_02", "02_03")
PATH = replace(MODELS["gpdm_style"], dynamics_noise=BALANCED_NOISE)
SIMULATIONS = 100
SAMPLED = ("cdm_style", "cdm_style_own")
# The stylistic circle model, new clips of which stray by a t process.
STUDENT = "cdm_style_student"
FREEDOMS = (None, 64.0, 16.0, 8.0, 4.0, 3.0)
CLIP_CHAINS, CLIP_WARMUP, CLIP_DRAWS = 4, 300, 500
WALKER_WARMUP, WALKER_STEPS = 500, 2500


class Posterior:
    """The study's parts: its fits and forecasts, read where they are there.

    Parameters
    ----------
    data
        Folder that holds ``cmu/``.
    stages
        The results; fits and forecasts are kept in their folder.
    seed
        The one seed.
    """

    def __init__(self, data: Path | None, stages: Stages, seed: int) -> None:
        self.motion, self.clips = training_motion(data), read_clips(list(LONG), data)
        self.stages, self.seed = stages, seed
        self._fits: dict[str, Fit] = {}

    @property
    def freedom(self) -> float | None:
        """Degrees of freedom of new clips that training people choose."""
        found = self.stages.do(
            "freedom",
            work=lambda: leave_subjects_out(
                self.motion, partial(train, "cdm_style", seed=self.seed), FREEDOMS
            ),
        )
        return found["chosen"]

    def mode(self, name: str) -> Fit:
        """Give a model at its mode."""
        if name == STUDENT:
            return with_freedom(self.mode("cdm_style"), self.freedom)
        return self._kept(name, partial(train, name, self.motion, self.seed))

    def sampled(self, name: str) -> Fit:
        """Give draws of a model; a run that is interrupted goes on from its last block.

        ``gpdm_style`` is sampled on `PATH_CLIPS` alone, every frame of its path free.
        """
        if name == STUDENT:
            return with_freedom(self.sampled("cdm_style"), self.freedom)
        model, motion = MODELS[name], self.motion
        if name == "gpdm_style":
            parts = split(motion)
            model, motion = PATH, concat([parts[clip] for clip in PATH_CLIPS])
        part = self.stages.folder / f"{name}_nuts.nc.part"
        part.parent.mkdir(parents=True, exist_ok=True)
        settings = {"warmup": WARMUP, "draws": DRAWS, "chains": CHAINS, "seed": self.seed}
        make = partial(fit_nuts, model, motion, **settings, checkpoint=part, resume=True)
        return self._kept(f"{name}_nuts", make)

    def forecast(self, kind: str, name: str, clip: str) -> Mixture:
        """Forecast a test clip at the ``mode`` of a model or over its ``posterior``."""

        def make() -> Mixture:
            if kind == "mode":
                return at_mode(self.mode(name), clip, self.clips[clip])
            return averaged(self.sampled(name), clip, self.clips[clip], self.seed)

        return kept(self.stages.folder / "forecasts" / f"{name}_{kind}_{clip}.npz", make)

    def stacked(self, clip: str, weights: Mapping[str, float]) -> Mixture:
        """Mix forecasts by weights: the circle's over its posterior, others at the mode."""
        parts = [
            self.forecast("posterior", STUDENT, clip)
            if name == "cdm_style"
            else self.forecast("mode", name, clip)
            for name in weights
        ]
        return stacked(parts, np.array(list(weights.values())))

    def put_scores(self, label: str, forecast: Callable[[str], Mixture], name: str) -> None:
        """Score forecasts of the test clips by a model, under a label."""
        for clip, motion in self.clips.items():
            self.stages.do(
                "forecast",
                "per_clip",
                clip,
                label,
                work=lambda c=clip, m=motion: scores(forecast(c), self.mode(name), c, m),
            )

    def _kept(self, name: str, make: Callable[[], Fit]) -> Fit:
        path = self.stages.folder / f"{name}.nc"
        if name not in self._fits:
            if path.is_file():
                self._fits[name] = load(path)
            else:
                self._fits[name] = make()
                self._fits[name].save(path)
        return self._fits[name]


def reproduce(data: Path | None, out: Path, say: Say = print, seed: int = 0) -> dict:
    """Run the study and write ``posterior.json``, the fits and the forecasts to `out`.

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
    stages = Stages(out / "posterior.json", plan(seed), say)
    study, do = Posterior(data, stages, seed), stages.do
    for name in (*SAMPLED, STUDENT):
        if name in SAMPLED:
            do(name, work=lambda n=name: diagnosis(study.sampled(n)))
        study.put_scores(f"map{label(name)}", partial(study.forecast, "mode", name), name)
        study.put_scores(
            f"posterior{label(name)}", partial(study.forecast, "posterior", name), name
        )
    for clip, motion in study.clips.items():
        do(
            "clip_posteriors",
            clip,
            work=lambda c=clip, m=motion: two_samplers(study.mode("cdm_style"), c, m, seed),
        )
    for name in COMPARED:
        if name != "cdm_style":
            study.put_scores(f"map{label(name)}", partial(study.forecast, "mode", name), name)
    forecast = stages.result["forecast"]
    forecast |= means(forecast["per_clip"])
    points = Stages(out / "points.json", plan(seed), say)
    errors = {name: forecast["mean_error"][f"map{label(name)}"] for name in COMPARED}
    compared: dict[str, Any] = {"horizon": FUTURE, "rank_correlation": {}}
    stages.result["compare"] = compared

    def held_against(kind: Kind) -> None:
        compared[kind] = compare_models(kind, study.mode, study.motion, points, seed)
        compared["rank_correlation"][kind] = ranks_agree(compared[kind], errors)

    held_against("leave_future_out")
    weights = stacking_weights(compared["leave_future_out"])
    study.put_scores("stacked", lambda clip: study.stacked(clip, weights), "cdm_style")
    forecast |= means(forecast["per_clip"])
    forecast["stacking_weights"] = weights
    forecast["stacked_mean_error"] = forecast["mean_error"]["stacked"]
    write_json(stages.path, stages.result)
    do("sbc", work=partial(calibration_study, SIMULATIONS, seed, say))
    do("gpdm_style", work=lambda: diagnosis(study.sampled("gpdm_style")))
    held_against("leave_clips_out")
    write_json(stages.path, stages.result)
    return stages.result


def label(name: str) -> str:
    """Give the end of a model's labels; the stylistic circle model's have none."""
    return "" if name == "cdm_style" else f"_{name}"


def plan(seed: int) -> dict[str, Any]:
    """The settings of the study."""
    return {
        "models": {name: describe_model(MODELS[name]) for name in (*COMPARED, "cdm_style_own")},
        "sampling": {"chains": CHAINS, "warmup": WARMUP, "draws": DRAWS},
        "path": {"clips": list(PATH_CLIPS), "model": describe_model(PATH)},
        "clip": {"chains": CLIP_CHAINS, "warmup": CLIP_WARMUP, "draws": CLIP_DRAWS},
        "walkers": {"warmup": WALKER_WARMUP, "steps": WALKER_STEPS},
        "freedoms": list(FREEDOMS),
        "future": FUTURE,
        "simulations": SIMULATIONS,
        "seed": seed,
    }


def diagnosis(fit: Fit) -> dict[str, Any]:
    """What is said of a sampled fit.

    Beside what is said of the identified quantities stands the largest R-hat of the sites
    as they are, turned and shifted as each chain has them.
    """
    found = diagnose(fit)
    return {
        **found.figures,
        "naive_max_r_hat": naive_r_hat(fit),
        "clips": list(fit.training.clips),
        "seconds": float(fit.tree.attrs["seconds"]),
        "trusted": found.trusted,
        "sentences": list(found.sentences),
        "problems": list(found.problems),
    }


def naive_r_hat(fit: Fit) -> float:
    """Largest R-hat of all sites' entries that vary, without regard to what data can tell."""
    worst = 1.0
    for draws in fit.tree["posterior"].to_dataset().data_vars.values():
        each = draws.values.reshape(*draws.shape[:2], -1)
        moving = each[..., np.ptp(each, axis=(0, 1)) > 0.0]
        worst = max([worst, *(float(az.rhat(column)) for column in np.moveaxis(moving, -1, 0))])
    return worst


def two_samplers(fit: Fit, clip: str, motion: xr.Dataset, seed: int) -> dict[str, Any]:
    """Sample a test clip's own unknowns by NUTS and by an ensemble, and compare means."""
    given, horizon = LONG[clip]
    posed = pose_clip(fit, new_clip(fit, motion, given=given, horizon=horizon))
    return _agreement(fit.model, posed, seed)


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
