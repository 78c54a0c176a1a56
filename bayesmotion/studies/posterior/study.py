"""The posterior of the multifactor models on the six clips of the multifactor study.

Sampling (``cdm_style``; ``cdm_style_own``, whose clips have residuals of their own size;
``gpdm_style`` on one person's clips), how new people differ, chosen by training people left
out, forecasts of the eight test clips at the mode and averaged over the posterior, two
samplers held against each other on each test clip's own unknowns, models compared by
leaving out the future and by leaving out clips, and forecasts stacked by the latter. Settings
are those of the multifactor study. Simulation-based calibration is a study of its own.

Each stage writes its part of ``posterior.json``; stages that are in it are not done again,
and fits and forecasts are kept beside it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import arviz as az
import numpy as np
import xarray as xr
from scipy.stats import special_ortho_group

from ...evaluate.diagnostics import diagnose
from ...files import write_json
from ...fit import Fit, load
from ...inference.optimisation.map import fit_map
from ...inference.sampling.nuts import fit_nuts
from ...inference.sampling.whitening import SamplingProblem
from ...models.multifactor import GPDynamics
from ...motion import concat, split
from ...prediction import Mixture, stacked
from ...registry import describe_model
from ...tasks.forecast import context_of
from ..fits import multifactor_of
from ..multifactor.study import (
    BALANCED_NOISE,
    LONG,
    MAX_STEPS,
    MODELS,
    read_clips,
    train,
    training_motion,
)
from ..stages import Say, Stages
from . import averaged as posterior_averaged
from . import scales as posterior_scales
from .clips import (
    clip_problem,
    clip_values,
    identified,
    sample_nuts,
    sample_walkers,
)
from .compare import (
    COMPARED,
    FUTURE,
    PLAIN,
    STACKED,
    Kind,
    compare_models,
    ranks_agree,
    stacking_weights,
)
from .forecasts import at_mode, averaged, kept, means, scores
from .new_people import VARIANTS, best, leave_subjects_out, no_larger, seen_so
from .scales import both_ways

CHAINS, WARMUP, DRAWS = 4, 500, 500
# A path of its own for every frame of one person's two clips. Its steps are as free as those
# of the balanced dynamics: with a tenth of that noise hundreds of unknowns hang together so
# stiffly that every tree runs to its limit. In a plane chains agree; in space, as in the
# paper, strides lift off the plane one way or the other, and chains seldom change between.
PATH_CLIPS = ("02_02", "02_03")
PATHS = {
    name: replace(MODELS["gpdm_style"], content=GPDynamics(size, noise_sd=BALANCED_NOISE))
    for name, size in (("gpdm_style", 2), ("gpdm_style_space", 3))
}
PATH_WARMUP, PATH_DRAWS, PATH_START = 500, 2000, "typical"
SAMPLED = ("cdm_style", "cdm_style_own")
NOVEL_DIMS = (0, 1)
STUDENT_DF = (None, 64.0, 16.0, 8.0, 4.0, 3.0)
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

    def left_out(self, base: str) -> dict[str, Any]:
        """Give what training people say of how new people differ, by a model of `SAMPLED`."""
        train_fold = partial(self.train_fold, base)
        return self.stages.do(
            "left_out",
            base,
            work=lambda: leave_subjects_out(self.motion, train_fold, NOVEL_DIMS, STUDENT_DF),
        )

    def train_fold(self, base: str, motion: xr.Dataset) -> Fit:
        """Fit a variant's base to some of the training clips, at its mode."""
        model = no_larger(MODELS[base], motion)
        return fit_map(model, motion, seed=self.seed, keep=1, max_steps=MAX_STEPS)

    def seen(self, name: str, fit: Fit) -> Fit:
        """Give a fit of a variant's base as the variant sees new people."""
        variant = VARIANTS[name]
        told = self.left_out(variant.base)[str(variant.novel_dims)]
        return seen_so(fit, variant.novel_dims, told["student_df"] if variant.student else None)

    def train(self, name: str, motion: xr.Dataset) -> Fit:
        """Fit a model of the multifactor study, or a variant, to some of the training clips."""
        if name in MODELS:
            return train(name, motion, self.seed)
        return self.seen(name, self.train_fold(VARIANTS[name].base, motion))

    def mode(self, name: str) -> Fit:
        """Give a model at its mode."""
        if name in VARIANTS and name not in SAMPLED:
            return self.seen(name, self.mode(VARIANTS[name].base))
        return self._kept(name, partial(train, name, self.motion, self.seed))

    def sampled(self, name: str) -> Fit:
        """Give draws of a model; a run that is interrupted goes on from its last block.

        Those of `PATHS` are sampled on `PATH_CLIPS` alone, every frame of the path free.
        """
        if name in VARIANTS and name not in SAMPLED:
            return self.seen(name, self.sampled(VARIANTS[name].base))
        part = self.stages.folder / f"{name}_nuts.nc.part"
        part.parent.mkdir(parents=True, exist_ok=True)
        settings: dict[str, Any] = {"chains": CHAINS, "seed": self.seed, "resume": True}
        settings |= {"checkpoint": part}
        if name in PATHS:
            parts = split(self.motion)
            motion = concat([parts[clip] for clip in PATH_CLIPS])
            settings |= {"warmup": PATH_WARMUP, "draws": PATH_DRAWS, "start": PATH_START}
            make = partial(fit_nuts, PATHS[name], motion, **settings)
        else:
            settings |= {"warmup": WARMUP, "draws": DRAWS}
            make = partial(fit_nuts, MODELS[name], self.motion, **settings)
        return self._kept(f"{name}_nuts", make)

    def forecast(self, kind: str, name: str, clip: str) -> Mixture:
        """Forecast a test clip at the ``mode`` of a model or over its ``posterior``."""

        def make() -> Mixture:
            if kind == "mode":
                return at_mode(self.mode(name), clip, self.clips[clip])
            return averaged(self.sampled(name), clip, self.clips[clip], self.seed)

        return kept(self.stages.folder / "forecasts" / f"{name}_{kind}_{clip}.npz", make)

    def stacked(self, clip: str, weights: Mapping[str, float]) -> Mixture:
        """Mix forecasts by weights: a circle's over its posterior, others at the mode."""
        kinds = {name: "posterior" if name in VARIANTS else "mode" for name in weights}
        parts = [self.forecast(kind, name, clip) for name, kind in kinds.items()]
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
        Folder that holds ``cmu/``; where None as in `bayesmotion.motion.datasets.public.cmu`.
    out
        Folder for the results.
    say
        Called with a line after every stage.
    seed
        The one seed.
    """
    stages = Stages(out / "posterior.json", plan(seed), say)
    study, do = Posterior(data, stages, seed), stages.do
    stages.read(training=study.motion, **study.clips)
    for name in SAMPLED:
        do(name, work=lambda n=name: diagnosis(study.sampled(n)))
        study.left_out(name)
    chosen = best(stages.result["left_out"])
    for name in VARIANTS:
        study.put_scores(f"map{label(name)}", partial(study.forecast, "mode", name), name)
        study.put_scores(
            f"posterior{label(name)}", partial(study.forecast, "posterior", name), name
        )
    for name in dict.fromkeys(("cdm_style", chosen)):
        for clip, motion in study.clips.items():
            do(
                "clip_posteriors",
                name,
                clip,
                work=lambda n=name, c=clip, m=motion: two_samplers(study.mode(n), c, m, seed),
            )
    for name in COMPARED:
        if name != "cdm_style":
            study.put_scores(f"map{label(name)}", partial(study.forecast, "mode", name), name)
    stages.result["forecast"]["chosen"] = chosen
    _compare(study, Stages(out / "points.json", plan(seed), say))
    do("scales", work=partial(both_ways, MODELS["cdm_style"], study.motion, seed))
    for name in PATHS:
        do(name, work=lambda n=name: diagnosis(study.sampled(n)))
    return stages.result


def _compare(study: Posterior, points: Stages) -> None:
    """Compare models by what is left out, stack by clips left out, and score the stack."""
    result = study.stages.result
    forecast = result["forecast"]
    forecast |= means(forecast["per_clip"])
    errors = {name: forecast["mean_error"][f"map{label(name)}"] for name in COMPARED}
    found: dict[str, Any] = {"horizon": FUTURE, "rank_correlation": {}}

    def table(kind: Kind, names: Sequence[str]) -> list[dict[str, Any]]:
        return compare_models(kind, names, study.train, study.mode, study.motion, points)

    kinds: tuple[Kind, ...] = ("leave_future_out", "leave_clips_out")
    for kind in kinds:
        found[kind] = table(kind, COMPARED)
        found["rank_correlation"][kind] = ranks_agree(found[kind], errors)
    weights: dict[str, float] = {}
    for stack, names in (("stacked_plain", PLAIN), ("stacked", STACKED)):
        found[stack] = table("leave_clips_out", names)
        weights = stacking_weights(found[stack])
        study.put_scores(stack, lambda clip, w=weights: study.stacked(clip, w), "cdm_style")
    forecast |= means(forecast["per_clip"])
    forecast["stacking_weights"] = weights
    forecast["stacked_mean_error"] = forecast["mean_error"]["stacked"]
    result["compare"] = found
    write_json(study.stages.path, result)


def label(name: str) -> str:
    """Give the end of a model's labels; the stylistic circle model's have none."""
    return "" if name == "cdm_style" else f"_{name}"


def plan(seed: int) -> dict[str, Any]:
    """The settings of the study."""
    return {
        "models": {name: describe_model(MODELS[name]) for name in (*COMPARED, "cdm_style_own")},
        "sampling": {"chains": CHAINS, "warmup": WARMUP, "draws": DRAWS},
        "path": {
            "clips": list(PATH_CLIPS),
            "models": {name: describe_model(model) for name, model in PATHS.items()},
            "warmup": PATH_WARMUP,
            "draws": PATH_DRAWS,
            "start": PATH_START,
        },
        "clip": {"chains": CLIP_CHAINS, "warmup": CLIP_WARMUP, "draws": CLIP_DRAWS},
        "walkers": {"warmup": WALKER_WARMUP, "steps": WALKER_STEPS},
        "left_out": {"novel_dims": list(NOVEL_DIMS), "student_df": list(STUDENT_DF)},
        "scales": posterior_scales.SETTINGS,
        "forecast": posterior_averaged.SETTINGS,
        "variants": {name: variant._asdict() for name, variant in VARIANTS.items()},
        "future": FUTURE,
        "seed": seed,
    }


def diagnosis(fit: Fit) -> dict[str, Any]:
    """What is said of a sampled fit.

    Beside what is said of the identified quantities stands the largest R-hat of the sites
    as they are. Draws of a path are as good turned in any way: ``turned_max_r_hat`` is that
    of the sites with each chain's path turned in its own.
    """
    found, (model, training) = diagnose(fit), multifactor_of(fit)
    sites = {str(name): one.values for name, one in fit.tree["posterior"].ds.data_vars.items()}
    rotated = {name: _turned(sites[name]) for name in model.rotations}
    return {
        **found.figures,
        "naive_max_r_hat": naive_r_hat(sites),
        **({"turned_max_r_hat": naive_r_hat({**sites, **rotated})} if rotated else {}),
        "clips": list(training.clips),
        "seconds": float(fit.tree.attrs["seconds"]),
        "trusted": found.trusted,
        "sentences": list(found.sentences),
        "problems": list(found.problems),
    }


def naive_r_hat(sites: Mapping[str, np.ndarray]) -> float:
    """Largest R-hat of all sites' entries that vary, without regard to what data can tell."""
    worst = 1.0
    for draws in sites.values():
        each = draws.reshape(*draws.shape[:2], -1)
        moving = each[..., np.ptp(each, axis=(0, 1)) > 0.0]
        worst = max([worst, *(float(az.rhat(column)) for column in np.moveaxis(moving, -1, 0))])
    return worst


def _turned(x: np.ndarray) -> np.ndarray:
    """Turn the draws (chain, draw, N, Q) of every chain by a rotation of its own."""
    rotations = special_ortho_group.rvs(x.shape[-1], size=len(x), random_state=0)
    return np.einsum("cdnp,cpq->cdnq", x, rotations)


def two_samplers(fit: Fit, clip: str, motion: xr.Dataset, seed: int) -> dict[str, Any]:
    """Sample a test clip's own unknowns by NUTS and by an ensemble, and compare means."""
    context, horizon = LONG[clip]
    seen = context_of(motion, context=context, horizon=horizon)
    model, training = multifactor_of(fit)
    return _agreement(clip_problem(fit, model.prepare(seen, training)), seed)


def _agreement(problem: SamplingProblem, seed: int) -> dict[str, Any]:
    """Difference of the two samplers' means in standard errors, at worst."""
    z = sample_nuts(problem, chains=CLIP_CHAINS, warmup=CLIP_WARMUP, draws=CLIP_DRAWS, seed=seed)
    one = identified(problem, clip_values(problem, z["z"]))
    walkers = sample_walkers(problem, warmup=WALKER_WARMUP, steps=WALKER_STEPS, seed=seed)
    steps = np.linspace(0, WALKER_STEPS - 1, min(WALKER_STEPS, 1000)).astype(int)
    # (steps, walkers) as (chain, draw): only means over all of them are taken.
    other = identified(problem, clip_values(problem, walkers.values[steps]))
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
