"""How new people differ from those known, chosen by training people who are left out.

A trained model is sure of what its factors explain. New people have something of their own
that repeats with the content (`Factor.novel_dims`), deviate slowly (`Multifactor.residual`),
each output by its own amount (`Multifactor.student_df`). As in `multifactor_left_out`
each training subject's clips are forecast by a fit to the others; no test clip has a part
in it. Errors choose among the models, as in the multifactor study, and the log score the
degrees of freedom.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from ...fit import Fit
from ...models.multifactor import Multifactor
from ...motion import concat, split
from ...prediction import score
from ...programs import forget_programs
from ...tasks.forecast import angles_of, forecast
from ..fits import multifactor_of
from ..multifactor.left_out import lengths_of


class Variant(NamedTuple):
    """A model of the multifactor study, and how its new clips are seen.

    base
        Name of the model that is trained.
    novel_dims
        `Factor.novel_dims` of every factor.
    student
        Whether new clips deviate by a t process, with the degrees of freedom chosen.
    """

    base: str
    novel_dims: int = 0
    student: bool = False


# How new people are seen, plainest first; training people choose among the last three.
VARIANTS = {
    "cdm_style": Variant("cdm_style"),
    "cdm_style_own": Variant("cdm_style_own"),
    "cdm_style_student": Variant("cdm_style", student=True),
    "cdm_style_novel": Variant("cdm_style", novel_dims=1, student=True),
    "cdm_style_own_novel": Variant("cdm_style_own", novel_dims=1, student=True),
}


def seen_so(fit: Fit, novel_dims: int, student_df: float | None) -> Fit:
    """Return a fit whose new clips are seen so; the training is the same."""
    model, _ = multifactor_of(fit)
    factors = tuple(replace(factor, novel_dims=novel_dims) for factor in model.style_factors)
    return replace(fit, model=replace(model, factors=factors, student_df=student_df))


def no_larger(model: Multifactor, motion: xr.Dataset) -> Multifactor:
    """Give a model whose style vectors have no more entries than clips have levels.

    With a person left out, vectors of the others would leave an entry that nobody known
    reaches: a novel one.
    """
    factors = tuple(
        replace(factor, size=min(factor.size, len(np.unique(motion[factor.name].values))))
        for factor in model.style_factors
    )
    return replace(model, factors=factors)


def leave_subjects_out(
    motion: xr.Dataset,
    train: Callable[[xr.Dataset], Fit],
    novel_dims: Sequence[int],
    student_dfs: Sequence[float | None],
) -> dict[str, Any]:
    """Score forecasts of the clips of every subject by fits to the others.

    Parameters
    ----------
    motion
        The training clips.
    train
        Fits the model to clips.
    novel_dims
        Numbers of novel dimensions to try.
    student_dfs
        Degrees of freedom to try with each.

    Returns
    -------
    For each number of novel dimensions ``scores``, {degrees of freedom: mean of each figure
    over the clips}, ``error``, the smallest mean error, and ``student_df``, the degrees of
    freedom of the highest log score.
    """
    parts = split(motion)
    subject = {clip: str(part["subject"].values[0]) for clip, part in parts.items()}
    found: dict[tuple[int, float | None], list[dict[str, float]]] = {
        (novel, df): [] for novel in novel_dims for df in student_dfs
    }
    for left in dict.fromkeys(subject.values()):
        # Fits to fewer frames compile anew.
        forget_programs()
        fit = train(concat([part for clip, part in parts.items() if subject[clip] != left]))
        for (novel, df), scores in found.items():
            seen = seen_so(fit, novel, df)
            scores += [_scores(seen, parts[clip]) for clip in parts if subject[clip] == left]
    return {
        str(novel): _chosen({df: _mean(found[novel, df]) for df in student_dfs})
        for novel in novel_dims
    }


def best(found: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> str:
    """Name the variant of the smallest error, of those that deviate by a t process.

    Parameters
    ----------
    found
        For each base what `leave_subjects_out` gives.
    """
    student = [name for name, variant in VARIANTS.items() if variant.student]

    def error(name: str) -> float:
        return found[VARIANTS[name].base][str(VARIANTS[name].novel_dims)]["error"]

    return min(student, key=error)


def _chosen(means: Mapping[float | None, Mapping[str, float]]) -> dict[str, Any]:
    df = max(means, key=lambda one: means[one]["log_score"])
    error = min(one["error"] for one in means.values())
    scores = {str(name): dict(one) for name, one in means.items()}
    return {"scores": scores, "error": error, "student_df": df}


def _mean(scores: Sequence[Mapping[str, float]]) -> dict[str, float]:
    return {name: float(np.mean([one[name] for one in scores])) for name in scores[0]}


def _scores(fit: Fit, clip: xr.Dataset) -> dict[str, float]:
    context, horizon = lengths_of(clip)
    predicted = forecast(fit, clip, context=context, horizon=horizon)
    true, columns = angles_of(fit, clip.isel(frame=slice(context + horizon)), context)
    return score(predicted.mixture.part(slice(context, None), columns), true[context:]).figures()
